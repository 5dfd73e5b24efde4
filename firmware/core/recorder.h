#ifndef FIRMWARE_CORE_RECORDER_H_
#define FIRMWARE_CORE_RECORDER_H_

/* The recorder stores up to 8 values of a structure, sampled every `decimation` ticks, in a buffer
 * of the caller.
 *
 * States: idle -> armed (samples overwrite the oldest ones until the trigger) -> recording (the
 * rest of the buffer is filled) -> done. The values are stored one after the other, least
 * significant byte first, each with the width of its type: 32 KiB hold 16384 samples of one 16-bit
 * code, or 2048 samples of four 32-bit values.
 *
 * The first sample is taken in the first tick after arming, and then one every `decimation` ticks,
 * independent of the trigger. The trigger condition is checked in every tick, so no trigger is
 * missed; the first sample at or after the trigger has the index recorder_trigger_index. A trigger
 * before `pretrigger` samples were taken is accepted, and the recording then has fewer samples
 * before the trigger.
 *
 * With the edge excitation_start the caller passes the signal excitation_state to recorder_arm() as
 * the trigger. If the recorder is armed before the excitation starts, a sample after
 * recorder_trigger_index shows the waveform at the age of (index - recorder_trigger_index) times
 * the decimation, in ticks. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_objects.h"

enum { RECORDER_CHANNELS = 8 };

/* Position and type of a value in the sampled structure. */
typedef struct {
  uint16_t offset; /* offset in bytes from the start of the structure */
  uint8_t type;    /* AXIS_TYPE_ */
  uint8_t bytes;   /* size of the type; recorder_arm() sets it */
} recorder_channel_t;

typedef struct {
  recorder_params_t params;
  recorder_signals_t signals;
  uint8_t *buffer;
  uint32_t buffer_bytes;
  recorder_channel_t channels[RECORDER_CHANNELS];
  recorder_channel_t trigger;
  uint8_t channel_count;
  /* number of the first channels after whose start a sample still has 4 bytes or more */
  uint8_t wide_count;
  uint8_t sample_bytes;
  uint8_t trigger_primed; /* 1: trigger_previous has the value of the last tick */
  bool trigger_rising;    /* true: a rising edge starts the recording; next field: a falling edge */
  bool trigger_falling;
  /* mask for level and previous value, so that an unsigned comparison gives their order */
  uint32_t trigger_flip;
  uint32_t trigger_level;
  uint32_t trigger_previous;
  uint16_t decimation_remaining; /* ticks until the next sample */
  uint32_t write_index;          /* slot of the next sample, 0..capacity-1 */
  uint32_t first_index;          /* slot of sample 0 */
  /* number of samples after the trigger that are still to be taken */
  uint32_t samples_remaining;
} recorder_t;

/* Initialises an idle recorder without channels. The buffer belongs to the caller and must outlive
 * the recorder; it needs no alignment and may be empty. */
void recorder_init(recorder_t *recorder, void *buffer, uint32_t buffer_bytes);

/* Starts a recording of channels[0..count-1] with the settings of recorder->params; the edge
 * "immediate" does not read `trigger`. Returns 0. Returns -1 and changes nothing if count is 0 or
 * above RECORDER_CHANNELS, if the buffer holds no sample, or if pretrigger or length exceed the
 * buffer (after pretrigger, the sample of the trigger needs room too). */
int recorder_arm(recorder_t *recorder, const recorder_channel_t *channels, uint8_t count,
                 recorder_channel_t trigger);

/* Sets the `count` channels of a recording, 1 to RECORDER_CHANNELS. */
void recorder_set_channels(recorder_t *recorder, const recorder_channel_t *channels, uint8_t count);

/* Sets the value of the trigger signal before the first tick of an armed recorder, so that an edge
 * in this tick is detected. */
void recorder_prime(recorder_t *recorder, int32_t value);

/* Makes the recorder idle at once; a completed recording can then no longer be read. */
void recorder_stop(recorder_t *recorder);

/* Computes one tick of the recorder: samples the structure at `base`. It may read up to 3 bytes
 * after a value. */
void recorder_tick(recorder_t *recorder, const void *base);

/* Reads sample `index` (0 is the oldest) of a completed recording into values[0..channel_count-1];
 * an unsigned 32-bit value keeps its bits. Returns the number of channels, or -1 if the recording
 * is not complete or has no such sample. */
int recorder_read(const recorder_t *recorder, uint32_t index, int32_t values[RECORDER_CHANNELS]);

/* Reads up to `count` bytes of a completed recording from `offset`, oldest sample first. Returns
 * the number of bytes read. */
uint32_t recorder_bytes(const recorder_t *recorder, uint32_t offset, uint8_t *bytes,
                        uint32_t count);

#endif
