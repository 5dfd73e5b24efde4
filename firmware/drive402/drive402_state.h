#ifndef FIRMWARE_DRIVE402_DRIVE402_STATE_H_
#define FIRMWARE_DRIVE402_DRIVE402_STATE_H_

/* The data of the master of one drive: configuration, command, feedback and state. The functions of
 * the master, and their use, are in drive402.h. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/drive402/drive402_names.h"
#include "firmware/drive402/drive402_sdo.h"
#include "firmware/drive402/drive402_word.h"
#include "firmware/fx/fx.h"

/* Modes of operation (6060h). */
enum { DRIVE402_CSP = 8, DRIVE402_CSV = 9, DRIVE402_CST = 10 };

/* Largest value of drive402_config_t.scale_shift. */
enum { DRIVE402_SHIFT_MAX = 16 };

typedef struct {
  /* Extra objects that are written before the objects of the master, and are also read back:
   * limits, units, polarity (607Eh), quick stop option (605Ah). NULL: no extra objects. */
  const drive402_entry_t *extra;
  /* Target in units of the drive = target of the command x scale_num / (scale_den x 2^scale_shift),
   * rounded once, half up: floor(x + 1/2). scale_num and scale_den are 1..2^31-1. In lowest terms,
   * the numerator and the denominator of this fraction must be below 2^31. */
  uint32_t scale_num;
  uint32_t scale_den;
  /* Largest magnitude of the target in units of the drive, 1..2147483642; in cst mode 1..32767. */
  int32_t target_max;
  uint16_t heartbeat_ms; /* period in ms of the heartbeats of both nodes (1017h), above 0 */
  /* time in ms of the heartbeat consumers of both nodes (1016h), above heartbeat_ms */
  uint16_t heartbeat_timeout_ms;
  /* longest time in ms until the answer to an SDO request, above 0; a request is sent at most
   * twice */
  uint16_t sdo_timeout_ms;
  /* longest time in ms, above 0, until the boot-up message, until the first TPDO, and until an
   * enabled drive is on, including a reset of its fault */
  uint16_t wait_ms;
  /* longest time in ms for which the master commands quick stop before it disables the voltage; the
   * quick stop ends earlier if the drive reports switch on disabled or fault */
  uint16_t quick_stop_ms;
  int16_t abort_option; /* reaction of the drive to the loss of the master, for its object 6007h */
  /* Set of DRIVE402_WITHOUT_ bits for objects that are not written: the drive does not have them or
   * does not permit a write. Settings of the manufacturer must then have the same effect in the
   * drive. A PDO mapping is still compared. */
  uint16_t without;
  /* set of bits of DRIVE402_DIFFERS_ALL for objects that are written but not compared; the drive
   * may refuse the write */
  uint16_t differs;
  uint8_t extra_count;
  /* length of the bus cycle in ms, an even number 2..100, so that it is a multiple of 3 ticks */
  uint8_t cycle_ms;
  uint8_t mode; /* mode of operation, DRIVE402_CSP, DRIVE402_CSV or DRIVE402_CST */
  /* transmission type of the RPDO. 1: a target acts at the next SYNC; 254, 255: a target acts when
   * it is received */
  uint8_t rpdo_type;
  uint8_t node_id;     /* node id of the drive, 1..127 */
  uint8_t own_node_id; /* node id of the master, 1..127 */
  uint8_t scale_shift; /* number of fractional bits of the target in the command, 0..16 */
} drive402_config_t;

typedef struct {
  /* Target in units of the axis (see scale_num): a speed in csv mode, a torque in cst mode, a
   * position in csp mode. The target acts while the feedback reports `on`. */
  int32_t target;
  uint8_t enable; /* 1: the drive must reach the state operation enabled; 0: the drive must stop */
  /* a change from 0 to 1 resets a fault of the drive, or starts the master again after a failure */
  uint8_t reset;
} drive402_command_t;

typedef struct {
  int32_t position_cnt; /* position (6064h) in units of the drive; it wraps at 32 bits */
  int16_t torque;       /* torque (6077h) in per mille of the rated torque */
  /* number of ticks from the SYNC at which the drive sampled these values to the next tick; 65535:
   * 65535 ticks or more, or no values yet */
  uint16_t age_ticks;
  uint16_t statusword; /* statusword (6041h) of the drive */
  /* last error code of the drive, from an emergency message or from 603Fh; 0: none */
  uint16_t error_code;
  uint8_t fitted; /* 1: the configuration was accepted, so the axis must have a drive */
  /* 1: the drive follows its targets. It is in the state operation enabled without a fault, bits 9
   * and 12 of the statusword are 1, and 6061h displays the mode */
  uint8_t on;
  uint8_t fault; /* 1: the master has detected a failure, or the drive is in the state fault */
  /* 1: an internal limit of the drive is active (bit 11 of the statusword is 1) */
  uint8_t limit;
  uint8_t saturated; /* 1: the last target was limited to target_max */
  uint8_t phase;     /* phase of the master, one of DRIVE402_PHASES */
  uint8_t state;     /* state of the drive, one of DRIVE402_STATES */
  uint8_t reason;    /* reason of the first failure since the last reset, one of DRIVE402_REASONS */
  /* failed_sub, failed_index: object whose SDO transfer has failed, or 0; abort_code: abort code of
   * the drive, or 0 */
  uint8_t failed_sub;
  uint16_t failed_index;
  uint32_t abort_code;
} drive402_feedback_t;

/* Value of since_sync before the first SYNC. No TPDO can be an answer to a SYNC then. */
enum { DRIVE402_NO_SYNC = UINT16_MAX };

/* Largest number of entries in the master's own configuration, and largest number of frames in a
 * tick. These frames are SYNC, RPDO, heartbeat, and either an NMT command or an SDO request. */
enum { DRIVE402_ENTRIES = 25, DRIVE402_FRAMES = 4 };

typedef struct {
  const drive402_config_t *config;
  fx_fraction_t scale;
  drive402_entry_t entries[DRIVE402_ENTRIES];
  drive402_sdo_t sdo;
  can_frame_t frames[DRIVE402_FRAMES]; /* frames to send in this tick, in their order */
  uint8_t frame_count;
  uint8_t frame_next;

  uint8_t phase;
  uint8_t reason;
  uint8_t failed_sub;
  uint16_t failed_index;
  uint32_t abort_code;
  /* SDO abort code with which the last download was refused; 0: it was not refused */
  uint32_t refused;
  /* bit n is 1: the value of entry n of the configuration is compared with the drive's value,
   * but not written */
  uint32_t read_only;
  /* bit n is 1: entry n of the configuration is written to the drive, but its value is not
   * compared */
  uint32_t uncompared;
  /* number of ticks until the master no longer waits for the drive (wait_ms) */
  uint32_t wait_ticks;
  uint32_t own_heartbeat_ticks;   /* number of ticks until the master sends its next heartbeat */
  uint32_t drive_heartbeat_ticks; /* number of ticks until the heartbeat of the drive counts as
                                   * missing */
  uint32_t stop_ticks;            /* number of ticks until the voltage is disabled after a quick
                                   * stop */
  uint32_t read_ticks;            /* number of ticks until object 6061h or 603Fh is read again */
  uint16_t cycle_ticks;
  /* number of ticks from the last SYNC to the next tick; 65535 before the first SYNC */
  uint16_t since_sync;
  uint16_t age_ticks;
  uint16_t statusword;
  uint16_t error_code;
  uint16_t controlword; /* last controlword that was sent */
  uint16_t needed;      /* bits of the statusword that must be 1 before the drive accepts targets */
  int32_t position_cnt;
  int16_t torque;
  uint8_t state;
  /* number of entries that the master itself adds to the configuration, without extra entries */
  uint8_t entry_count;
  /* number of the entry whose SDO transfer is in progress; extra entries have the lowest numbers */
  uint16_t entry;
  /* 1: the NMT command that belongs to the present phase of the master was sent */
  uint8_t command_sent;
  /* 1: the last heartbeat of the drive has reported the NMT state operational */
  uint8_t operational;
  uint8_t sampled;      /* 1: a TPDO was received since the start of the node */
  uint8_t tpdos;        /* number of TPDOs received since the last SYNC, at most 255 */
  uint8_t tpdo_bytes;   /* expected length of a TPDO in bytes */
  uint8_t other_length; /* 1: a TPDO of another length was received since the start of the node */
  /* number of consecutive SYNCs that the drive has not answered with a TPDO, at most 2 */
  uint8_t missing;
  uint8_t doubled;        /* number of consecutive bus cycles with more than one TPDO, at most 2 */
  uint8_t mode_displayed; /* 1: the last read of 6061h gave the configured mode */
  uint8_t was_on;         /* 1: the feedback reported `on` in the last tick */
  /* 1: the drive is in the state fault, and the controlword resets the fault */
  uint8_t resets_fault;
  uint8_t saturated;
  uint8_t reset_asked;   /* 1: a fault of the drive will be reset once the drive is running */
  uint8_t reset_before;  /* value of the field `reset` in the command of the last tick */
  uint8_t failed_before; /* 1: the cyclic frames of the last tick already reacted to the failure */
} drive402_t;

/* Stores the reason of a failure, unless a failure has already occurred since the last reset. */
static inline void drive402_fail(drive402_t *master, uint8_t reason) {
  if (master->reason == DRIVE402_NONE) {
    master->reason = reason;
  }
}

/* Returns true if the statusword reports that the drive is enabled, obeys the controlword and
 * follows its target. */
static inline bool drive402_follows(const drive402_t *master) {
  return master->state == DRIVE402_OPERATION_ENABLED &&
         (master->statusword & master->needed) == master->needed;
}

/* Returns true while the drive follows its targets. */
static inline bool drive402_is_on(const drive402_t *master) {
  return master->phase == DRIVE402_RUNNING && master->reason == DRIVE402_NONE &&
         drive402_follows(master) && master->mode_displayed != 0 &&
         master->controlword == DRIVE402_ENABLE_OPERATION;
}

/* Adds a frame with the identifier `id` and the length `length` to the frames of this tick, and
 * returns it. The caller writes its data. */
static inline can_frame_t *drive402_frame(drive402_t *master, uint16_t id, uint8_t length) {
  can_frame_t *frame = &master->frames[master->frame_count];
  master->frame_count++;
  frame->id = id;
  frame->length = length;
  frame->remote = 0;
  return frame;
}

/* Decreases a number of remaining ticks by 1, unless it is already 0. */
static inline void drive402_count_down(uint32_t *ticks) {
  if (*ticks > 0) {
    (*ticks)--;
  }
}

#endif
