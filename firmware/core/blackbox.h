#ifndef FIRMWARE_CORE_BLACKBOX_H_
#define FIRMWARE_CORE_BLACKBOX_H_

/* The black box: while nobody records, the recorder's buffer holds the last second of a fixed
 * choice of signals, in each tick, and keeps it when an error occurs: an incident.
 *
 * An incident is BLACKBOX_BEFORE samples, the tick of the error, and what follows it up to
 * BLACKBOX_SAMPLES, fewer in a smaller buffer. The first one is kept, because it explains the later
 * ones, until it is cleared or a recording takes the buffer.
 *
 * A blackbox_t may lie, with the buffer, in memory that a restart of the processor does not clear:
 * blackbox_init() finds out whether there is an incident in it. Samples carry no CRC while they are
 * taken; blackbox_check() computes one afterwards, piece by piece. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/recorder.h"

enum {
  BLACKBOX_BEFORE = 1500, /* 1 s */
  BLACKBOX_AFTER = 30,    /* 20 ms, with the tick of the error */
  BLACKBOX_SAMPLES = BLACKBOX_BEFORE + BLACKBOX_AFTER
};

typedef struct {
  uint32_t magic; /* BLACKBOX_MAGIC where the others are what a black box wrote */
  uint32_t table; /* hash of the object table */
  recorder_t ring;
  uint32_t tick; /* tick_count at the error; before it that of the last blackbox_follow() */
  uint32_t crc;  /* CRC-32 of the samples in their order, once `checked` reaches their end */
  uint32_t checked;
  uint32_t enabled_tick; /* the last in which the axis was enabled */
  uint16_t later;        /* errors since the incident */
  uint16_t error_code;   /* of the incident: AXIS_ERROR_CODE_ */
  uint16_t error_before; /* of the last blackbox_follow() */
  uint8_t fault;         /* of the incident: AXIS_FAULT_ */
  uint8_t kept;          /* 1: the incident is from before a restart */
  uint8_t was_enabled;   /* 1: enabled_tick is set */
} blackbox_t;

#define BLACKBOX_MAGIC UINT32_C(0x31424246) /* "FBB1" */

/* At power-up. The buffer is the recorder's and outlives the black box; `channels` are the
 * RECORDER_CHANNELS signals recorded. An incident that is there is kept; so is, where
 * `reset_error` (AXIS_ERROR_CODE_) says what reset the chip, a recording under way, as an incident
 * with that error. */
void blackbox_init(blackbox_t *blackbox, void *buffer, uint32_t buffer_bytes,
                   const recorder_channel_t channels[RECORDER_CHANNELS], uint16_t reset_error);

/* Starts to record; `trigger` is error_code. Without room for more than BLACKBOX_AFTER samples
 * nothing is recorded. */
void blackbox_start(blackbox_t *blackbox, const recorder_channel_t channels[RECORDER_CHANNELS],
                    recorder_channel_t trigger);

/* Recording, or an incident, ends: the buffer is somebody else's. */
void blackbox_stop(blackbox_t *blackbox);

static inline bool blackbox_is_recording(const blackbox_t *blackbox) {
  const uint8_t state = blackbox->ring.signals.recorder_state;
  return state == AXIS_RECORDER_STATE_ARMED || state == AXIS_RECORDER_STATE_RECORDING;
}

static inline bool blackbox_has_incident(const blackbox_t *blackbox) {
  return blackbox->ring.signals.recorder_state == AXIS_RECORDER_STATE_DONE;
}

/* One tick: samples the structure at `base`; the error that began in it is noted. Cost: that of a
 * recording of RECORDER_CHANNELS channels. */
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

/* Between ticks: follows the axis, and drops an incident of an axis that was not enabled in the
 * second before. */
void blackbox_follow(blackbox_t *blackbox, bool enabled, uint16_t error_code, uint32_t tick);

/* Between ticks: up to 16 bytes more of the CRC of an incident. True: blackbox->crc is complete. */
bool blackbox_check(blackbox_t *blackbox);

/* An incident whose samples, oldest first, are in the buffer by now, as one from before a restart.
 */
void blackbox_restore(blackbox_t *blackbox, uint32_t tick, uint16_t error_code, uint8_t fault,
                      uint16_t samples, uint16_t trigger_index);

/* Bytes of the samples of an incident in a buffer of that size. */
uint32_t blackbox_bytes(uint32_t buffer_bytes,
                        const recorder_channel_t channels[RECORDER_CHANNELS]);

/* The incident as the finished recording of a recorder with the same buffer. */
void blackbox_show(const blackbox_t *blackbox, recorder_t *recorder);

#endif
