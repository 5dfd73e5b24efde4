#ifndef FIRMWARE_CORE_BLACKBOX_H_
#define FIRMWARE_CORE_BLACKBOX_H_

/* The black box. While no recording is armed, the black box samples a fixed set of signals in each
 * tick, and keeps the samples of the last second in the buffer of the recorder. When an error
 * occurs, the black box keeps these samples. The samples of an error are an incident.
 *
 * An incident has BLACKBOX_SAMPLES samples, or fewer in a smaller buffer: BLACKBOX_BEFORE samples
 * before the error, the sample of the tick of the error, and samples after the error. The black box
 * keeps the first incident, because the first incident explains later errors. The incident is lost
 * when a client clears it or a recording uses the buffer.
 *
 * A blackbox_t and its buffer may be placed in memory that a restart of the processor does not
 * clear; blackbox_init() then finds an incident in this memory. The samples have no CRC during
 * recording; afterwards blackbox_check() computes the CRC in small steps. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/recorder.h"
#include "firmware/objects/generated/axis_objects_drive.h"

enum {
  /* number of samples that the black box keeps from before the error: 1 s */
  BLACKBOX_BEFORE = 1500,
  /* number of samples that the black box takes from the tick of the error on: 20 ms */
  BLACKBOX_AFTER = 30,
  BLACKBOX_SAMPLES = BLACKBOX_BEFORE + BLACKBOX_AFTER
};

typedef struct {
  /* BLACKBOX_MAGIC if the black box has initialised the other fields of this structure */
  uint32_t magic;
  uint32_t table; /* hash of the object table of the firmware that recorded the samples */
  recorder_t ring;
  /* value of tick_count at the error; without an error, tick_count at the last call of
   * blackbox_follow() */
  uint32_t tick;
  /* CRC-32 of the samples, beginning with the oldest sample; complete when `checked` has reached
   * the last sample */
  uint32_t crc;
  uint32_t checked;
  uint32_t enabled_tick; /* tick_count of the last tick in which the axis was enabled */
  uint16_t later;        /* number of errors that occurred after the incident */
  uint16_t error_code;   /* error code of the incident, AXIS_ERROR_CODE_ */
  uint16_t error_before; /* error code at the last call of blackbox_follow() */
  uint8_t fault;         /* fault of the incident, AXIS_FAULT_ */
  uint8_t kept;          /* 1 if the incident is older than the last restart */
  uint8_t was_enabled;   /* 1 if the field enabled_tick is valid */
} blackbox_t;

#define BLACKBOX_MAGIC UINT32_C(0x31424246) /* "FBB1" */

/* Initialises the black box at power-up. The buffer is the buffer of the recorder and must outlive
 * the black box. `channels` are the RECORDER_CHANNELS recorded signals. An incident in the buffer
 * is kept. If a reset interrupted a recording of the black box, the recorded samples become an
 * incident with the error code `reset_error` (AXIS_ERROR_CODE_), unless `reset_error` is none. */
void blackbox_init(blackbox_t *blackbox, void *buffer, uint32_t buffer_bytes,
                   const recorder_channel_t channels[RECORDER_CHANNELS], uint16_t reset_error);

/* Starts the recording of the black box. The black box detects an error by the channel `trigger`,
 * the channel of the signal error_code. If the buffer has room for at most BLACKBOX_AFTER samples,
 * the black box records nothing. */
void blackbox_start(blackbox_t *blackbox, const recorder_channel_t channels[RECORDER_CHANNELS],
                    recorder_channel_t trigger);

/* Stops the recording of the black box and discards an incident. Call this function before another
 * module uses the buffer. */
void blackbox_stop(blackbox_t *blackbox);

static inline bool blackbox_is_recording(const blackbox_t *blackbox) {
  const uint8_t state = blackbox->ring.signals.recorder_state;
  return state == AXIS_RECORDER_STATE_ARMED || state == AXIS_RECORDER_STATE_RECORDING;
}

static inline bool blackbox_has_incident(const blackbox_t *blackbox) {
  return blackbox->ring.signals.recorder_state == AXIS_RECORDER_STATE_DONE;
}

/* Takes one sample of the structure at `base`, and stores an error that began in this tick. This
 * takes as long as a tick of the recorder with RECORDER_CHANNELS channels. */
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

/* Updates the black box between ticks: stores the state of the axis, and discards an incident if
 * the axis was not enabled in the last second before the error. */
void blackbox_follow(blackbox_t *blackbox, bool enabled, uint16_t error_code, uint32_t tick);

/* Adds at most 16 more bytes of the samples to the CRC of an incident. Call this function between
 * ticks. Returns true when blackbox->crc is complete. */
bool blackbox_check(blackbox_t *blackbox);

/* Adopts an incident whose samples are already in the buffer, oldest sample first. The black box
 * then marks the incident as older than the last restart. */
void blackbox_restore(blackbox_t *blackbox, uint32_t tick, uint16_t error_code, uint8_t fault,
                      uint16_t samples, uint16_t trigger_index);

/* Returns the number of bytes that the samples of an incident need in a buffer of `buffer_bytes`
 * bytes. */
uint32_t blackbox_bytes(uint32_t buffer_bytes,
                        const recorder_channel_t channels[RECORDER_CHANNELS]);

/* Shows the incident to clients as a completed recording of `recorder`. The black box and the
 * recorder use the same buffer. */
void blackbox_show(const blackbox_t *blackbox, recorder_t *recorder);

#endif
