#ifndef FIRMWARE_CORE_BLACKBOX_H_
#define FIRMWARE_CORE_BLACKBOX_H_

/* The black box. While no recording is armed, the buffer of the recorder keeps the last second of
 * fixed signals, sampled in each tick. When an error occurs the black box keeps them: this is an
 * incident.
 *
 * An incident consists of BLACKBOX_BEFORE samples, the sample of the tick of the error, and the
 * following samples up to BLACKBOX_SAMPLES, or fewer in a smaller buffer. The first incident is
 * kept, because it explains the later errors, until it is cleared or a recording uses the buffer.
 *
 * A blackbox_t may be placed with its buffer in memory that a restart of the processor does not
 * clear; blackbox_init() then finds an incident in it. The samples have no CRC while they are
 * recorded; blackbox_check() computes it afterwards in small steps. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/recorder.h"

enum {
  BLACKBOX_BEFORE = 1500, /* 1 s */
  BLACKBOX_AFTER = 30,    /* 20 ms, including the tick of the error */
  BLACKBOX_SAMPLES = BLACKBOX_BEFORE + BLACKBOX_AFTER
};

typedef struct {
  uint32_t magic; /* BLACKBOX_MAGIC if the black box has written the other fields */
  uint32_t table; /* hash of the object table */
  recorder_t ring;
  uint32_t tick; /* tick_count at the error; before an error that of the last blackbox_follow() */
  /* CRC-32 of the samples in their order, complete when `checked` has reached the last sample */
  uint32_t crc;
  uint32_t checked;
  uint32_t enabled_tick; /* last tick in which the axis was enabled */
  uint16_t later;        /* number of errors after the incident */
  uint16_t error_code;   /* error of the incident: AXIS_ERROR_CODE_ */
  uint16_t error_before; /* error code at the last blackbox_follow() */
  uint8_t fault;         /* fault of the incident: AXIS_FAULT_ */
  uint8_t kept;          /* 1: the incident happened before a restart */
  uint8_t was_enabled;   /* 1: enabled_tick is set */
} blackbox_t;

#define BLACKBOX_MAGIC UINT32_C(0x31424246) /* "FBB1" */

/* Initialises the black box at power-up. The buffer is that of the recorder and must outlive the
 * black box; `channels` are the RECORDER_CHANNELS signals that are recorded. An incident in the
 * buffer is kept. A recording that a reset interrupted becomes an incident with the error
 * `reset_error` (AXIS_ERROR_CODE_), unless `reset_error` is none. */
void blackbox_init(blackbox_t *blackbox, void *buffer, uint32_t buffer_bytes,
                   const recorder_channel_t channels[RECORDER_CHANNELS], uint16_t reset_error);

/* Starts to record; the error is that of the signal `trigger`, which is error_code. If the buffer
 * has room for at most BLACKBOX_AFTER samples, nothing is recorded. */
void blackbox_start(blackbox_t *blackbox, const recorder_channel_t channels[RECORDER_CHANNELS],
                    recorder_channel_t trigger);

/* Ends recording and discards an incident, because another module now uses the buffer. */
void blackbox_stop(blackbox_t *blackbox);

static inline bool blackbox_is_recording(const blackbox_t *blackbox) {
  const uint8_t state = blackbox->ring.signals.recorder_state;
  return state == AXIS_RECORDER_STATE_ARMED || state == AXIS_RECORDER_STATE_RECORDING;
}

static inline bool blackbox_has_incident(const blackbox_t *blackbox) {
  return blackbox->ring.signals.recorder_state == AXIS_RECORDER_STATE_DONE;
}

/* Samples the structure at `base` in one tick and notes an error that began in this tick. It costs
 * as much as a recording of RECORDER_CHANNELS channels. */
static inline void blackbox_tick(blackbox_t *blackbox, const void *base, uint8_t fault,
                                 uint16_t error_code, uint32_t tick) {
  recorder_tick(&blackbox->ring, base);
  if (error_code != blackbox->error_code &&
      blackbox->ring.signals.recorder_state != AXIS_RECORDER_STATE_ARMED &&
      blackbox->error_code == AXIS_ERROR_CODE_NONE) {
    blackbox->error_code = error_code;
    blackbox->fault = fault;
    blackbox->tick = tick;
  }
}

/* Call it between ticks. It updates the state of the axis and discards an incident if the axis was
 * not enabled in the second before the error. */
void blackbox_follow(blackbox_t *blackbox, bool enabled, uint16_t error_code, uint32_t tick);

/* Call it between ticks. It adds at most 16 bytes to the CRC of an incident and returns true when
 * blackbox->crc is complete. */
bool blackbox_check(blackbox_t *blackbox);

/* Adopts an incident whose samples are already in the buffer, oldest first; it is then marked as an
 * incident before a restart. */
void blackbox_restore(blackbox_t *blackbox, uint32_t tick, uint16_t error_code, uint8_t fault,
                      uint16_t samples, uint16_t trigger_index);

/* Returns the number of bytes of the samples of an incident in a buffer of the given size. */
uint32_t blackbox_bytes(uint32_t buffer_bytes,
                        const recorder_channel_t channels[RECORDER_CHANNELS]);

/* Presents the incident as a completed recording of a recorder with the same buffer. */
void blackbox_show(const blackbox_t *blackbox, recorder_t *recorder);

#endif
