#ifndef FIRMWARE_DRIVE402_DRIVE402_STATE_H_
#define FIRMWARE_DRIVE402_DRIVE402_STATE_H_

/* The data of the master of one drive: configuration, command, feedback and state. drive402.h has
 * the functions and says how they are used. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/canopen/can.h"
#include "firmware/drive402/drive402_names.h"
#include "firmware/drive402/drive402_sdo.h"
#include "firmware/drive402/drive402_word.h"
#include "firmware/fx/fx.h"

/* Modes of operation (6060h). */
enum { DRIVE402_CSP = 8, DRIVE402_CSV = 9, DRIVE402_CST = 10 };

/* Largest drive402_config_t.scale_shift. */
enum { DRIVE402_SHIFT_MAX = 16 };

typedef struct {
  /* Objects that are written before those of the master, each read back too: limits, units,
   * polarity (607Eh), quick stop option (605Ah). NULL for none. */
  const drive402_entry_t *extra;
  /* Target in units of the drive = target of the command x scale_num / (scale_den x 2^scale_shift),
   * rounded once, half up: floor(x + 1/2). Both are 1..2^31-1. In lowest terms, numerator and
   * denominator have to be below 2^31. */
  uint32_t scale_num;
  uint32_t scale_den;
  /* Largest magnitude of the target in units of the drive, 1..2147483642, in cst 1..32767. */
  int32_t target_max;
  uint16_t heartbeat_ms;         /* period of both heartbeats (1017h), from 1 */
  uint16_t heartbeat_timeout_ms; /* time of both heartbeat consumers (1016h), > heartbeat_ms */
  uint16_t sdo_timeout_ms;       /* longest wait for the answer to an SDO request, from 1; a request
                                  * is sent at most twice */
  /* longest wait for the boot-up message, for the first TPDO, and until an enabled drive is on, a
   * fault reset included; from 1 */
  uint16_t wait_ms;
  /* longest time for which the master commands quick stop before it disables the voltage; the quick
   * stop ends earlier if the drive reports switch on disabled or fault */
  uint16_t quick_stop_ms;
  int16_t abort_option; /* reaction of the drive to the loss of the master, for its object 6007h */
  /* DRIVE402_WITHOUT_ bits: objects that this drive does not have or does not permit to write, and
   * objects that are left out. The drive then has to do the same by settings of its maker. A
   * mapping is still compared. */
  uint16_t without;
  uint16_t differs; /* bits of DRIVE402_DIFFERS_ALL: objects that are written but not compared, and
                     * whose write may be refused */
  uint8_t extra_count;
  uint8_t cycle_ms;    /* bus cycle, an even number 2..100: a multiple of 3 ticks */
  uint8_t mode;        /* DRIVE402_CSP, DRIVE402_CSV or DRIVE402_CST */
  uint8_t rpdo_type;   /* 1: a target acts at the next SYNC; 254, 255: on reception */
  uint8_t node_id;     /* node id of the drive, 1..127 */
  uint8_t own_node_id; /* node id of the master, 1..127 */
  uint8_t scale_shift; /* number of fractional bits of the command's target, 0..16 */
} drive402_config_t;

typedef struct {
  /* csv, cst: speed or torque, csp: position; in units of the axis, see scale_num. It acts while
   * `on` is reported. */
  int32_t target;
  uint8_t enable; /* 1: the drive must reach operation enabled; 0: it must stop */
  uint8_t reset;  /* a change from 0 to 1 resets a fault, or starts again after a failure */
} drive402_command_t;

typedef struct {
  int32_t position_cnt; /* 6064h; wraps at 32 bits */
  int16_t torque;       /* 6077h, per mille of the rated torque */
  /* ticks from the SYNC at which the drive has sampled these values to the next tick; 65535: as
   * long or longer, or never */
  uint16_t age_ticks;
  uint16_t statusword; /* 6041h */
  uint16_t error_code; /* last error code that the drive has sent by EMCY or shown in 603Fh, or 0 */
  uint8_t fitted;      /* 1: the configuration was accepted, so the axis must have a drive */
  /* 1: the drive follows its targets: operation enabled with bits 9 and 12, mode displayed in
   * 6061h, no fault */
  uint8_t on;
  uint8_t fault;     /* 1: something has failed, or the drive is in fault */
  uint8_t limit;     /* 1: statusword bit 11, internal limit active */
  uint8_t saturated; /* 1: the last target was limited to target_max */
  uint8_t phase;     /* DRIVE402_PHASES */
  uint8_t state;     /* DRIVE402_STATES */
  uint8_t reason;    /* DRIVE402_REASONS: the first failure since the last reset */
  /* object whose SDO transfer has failed, or 0; and the abort code of the drive, or 0 */
  uint8_t failed_sub;
  uint16_t failed_index;
  uint32_t abort_code;
} drive402_feedback_t;

/* since_sync before the first SYNC, which no TPDO can have answered. */
enum { DRIVE402_NO_SYNC = UINT16_MAX };

/* Entries of the master's own configuration, and frames in a tick, at most: SYNC, RPDO, heartbeat,
 * and an NMT command or SDO request, but never both. */
enum { DRIVE402_ENTRIES = 25, DRIVE402_FRAMES = 4 };

typedef struct {
  const drive402_config_t *config;
  fx_fraction_t scale;
  drive402_entry_t entries[DRIVE402_ENTRIES];
  drive402_sdo_t sdo;
  can_frame_t frames[DRIVE402_FRAMES]; /* frames to send in this tick, the next one first */
  uint8_t frame_count;
  uint8_t frame_next;

  uint8_t phase;
  uint8_t reason;
  uint8_t failed_sub;
  uint16_t failed_index;
  uint32_t abort_code;
  uint32_t refused;               /* SDO abort code of the last download; 0 without one */
  uint32_t read_only;             /* bit n: entry n of the master is compared, but not written */
  uint32_t uncompared;            /* bit n: entry n of the master is written, but not compared */
  uint32_t wait_ticks;            /* number of ticks until the present wait (wait_ms) ends */
  uint32_t own_heartbeat_ticks;   /* number of ticks until the master sends its next heartbeat */
  uint32_t drive_heartbeat_ticks; /* number of ticks until the heartbeat of the drive counts as
                                   * missing */
  uint32_t stop_ticks;            /* number of ticks until the voltage is disabled after a quick
                                   * stop */
  uint32_t read_ticks;            /* number of ticks until object 6061h or 603Fh is read again */
  uint16_t cycle_ticks;
  uint16_t since_sync; /* ticks from the last SYNC to the next tick; 65535 before the first one */
  uint16_t age_ticks;
  uint16_t statusword;
  uint16_t error_code;
  uint16_t controlword; /* last controlword that was sent */
  uint16_t needed;      /* bits of the statusword that must be 1 before targets act */
  int32_t position_cnt;
  int16_t torque;
  uint8_t state;
  uint8_t entry_count;    /* number of the master's own entries */
  uint16_t entry;         /* number of the entry in the present SDO transfer; extra entries are
                           * numbered first */
  uint8_t command_sent;   /* 1: the NMT command of this phase was sent */
  uint8_t operational;    /* 1: the drive has reported the state operational by a heartbeat, in this
                           * phase or later */
  uint8_t sampled;        /* 1: a TPDO was received since the start of the node */
  uint8_t tpdos;          /* number of TPDOs received since the last SYNC, at most 255 */
  uint8_t tpdo_bytes;     /* length of a TPDO */
  uint8_t other_length;   /* 1: a TPDO of another length was received since the start of the node */
  uint8_t missing;        /* number of consecutive SYNCs without a TPDO as the answer, at most 2 */
  uint8_t doubled;        /* number of consecutive cycles with more than one TPDO, at most 2 */
  uint8_t mode_displayed; /* 1: the last read of 6061h gave the configured mode */
  uint8_t was_on;         /* 1: `on` in the last tick */
  uint8_t resets_fault;   /* 1: controlwords in the state fault reset the fault */
  uint8_t saturated;
  uint8_t reset_asked;   /* 1: a fault of the drive will be reset once the drive is running */
  uint8_t reset_before;  /* `reset` of the last command */
  uint8_t failed_before; /* 1: the cyclic frames of the last tick already reacted to the failure */
} drive402_t;

/* Keeps the first failure since the last reset. */
static inline void drive402_fail(drive402_t *master, uint8_t reason) {
  if (master->reason == DRIVE402_NONE) {
    master->reason = reason;
  }
}

/* Returns true if the statusword reports that the drive is enabled, obeys and follows its
 * target. */
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

/* Returns the place for another frame of this tick, with identifier and length. */
static inline can_frame_t *drive402_frame(drive402_t *master, uint16_t id, uint8_t length) {
  can_frame_t *frame = &master->frames[master->frame_count];
  master->frame_count++;
  frame->id = id;
  frame->length = length;
  frame->remote = 0;
  return frame;
}

/* Counts ticks down to 0. */
static inline void drive402_count_down(uint32_t *ticks) {
  if (*ticks > 0) {
    (*ticks)--;
  }
}

#endif
