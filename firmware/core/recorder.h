#ifndef FIRMWARE_CORE_RECORDER_H_
#define FIRMWARE_CORE_RECORDER_H_

/* The recorder. Every `decimation` ticks it copies up to 8 values of a structure as one sample into
 * a buffer of the caller.
 *
 * States: idle -> armed -> recording -> done. In the state armed, new samples overwrite the oldest
 * samples until the trigger. In the state recording, samples fill the rest of the buffer. The
 * values of a sample are stored one after the other, least significant byte first, each with the
 * width of its type. 32 KiB have room for 16384 samples of one 16-bit value, or 2048 samples of
 * four 32-bit values.
 *
 * The first sample is taken in the first tick after arming. Then one sample is taken every
 * `decimation` ticks, independent of the trigger. The recorder checks the trigger condition in
 * every tick, so no trigger is missed. recorder_trigger_index is the index of the first sample at
 * or after the trigger. If the trigger occurs before `pretrigger` samples were stored, the
 * recording has fewer samples before the trigger.
 *
 * For the trigger edge excitation_start, the caller passes the signal excitation_state to
 * recorder_arm() as the trigger signal. If the recorder is armed before the excitation starts, a
 * sample after recorder_trigger_index shows the waveform at the age of (index -
 * recorder_trigger_index) * decimation ticks. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_objects_recorder.h"

enum { RECORDER_CHANNELS = 8 };

/* A channel of the recorder: the position and the type of a recorded value in the sampled
 * structure. */
typedef struct {
  uint16_t offset; /* offset of the value in bytes from the start of the structure */
  uint8_t type;    /* type of the value, AXIS_TYPE_ */
  uint8_t bytes;   /* size in bytes of the recorded value; recorder_arm() sets it */
} recorder_channel_t;

typedef struct {
  recorder_params_t params;
  recorder_signals_t signals;
  uint8_t *buffer;
  uint32_t buffer_bytes;
  recorder_channel_t channels[RECORDER_CHANNELS];
  recorder_channel_t trigger;
  uint8_t channel_count;
  /* number of channels, from the first on, whose values can be copied as 4 bytes without a write
   * beyond the end of the sample */
  uint8_t wide_count;
  uint8_t sample_bytes;
  /* 1 if the field trigger_previous contains the value of the trigger signal in the last tick */
  uint8_t trigger_primed;
  /* trigger_rising: true if a rising edge starts the recording; trigger_falling: true if a falling
   * edge starts the recording */
  bool trigger_rising;
  bool trigger_falling;
  /* mask that converts a value of the trigger signal for an unsigned comparison; applied to
   * trigger_level and trigger_previous */
  uint32_t trigger_flip;
  uint32_t trigger_level;
  uint32_t trigger_previous;
  uint16_t decimation_remaining; /* number of ticks until the recorder takes its next sample */
  uint32_t write_index;          /* index of the next sample in the ring buffer, 0..capacity-1 */
  uint32_t first_index;          /* index of the oldest sample in the ring buffer */
  /* number of samples after the trigger that the recorder still has to store */
  uint32_t samples_remaining;
} recorder_t;

/* Initialises a recorder that is idle and has no channels. The buffer belongs to the caller and
 * must outlive the recorder. It needs no alignment and may be empty. */
void recorder_init(recorder_t *recorder, void *buffer, uint32_t buffer_bytes);

/* Arms the recorder for channels[0..count-1] with the settings in recorder->params. With the
 * trigger edge "immediate", `trigger` is not used. Returns 0 on success. Returns -1 and changes
 * nothing if count is 0 or above RECORDER_CHANNELS, if the buffer is too small for one sample, or
 * if pretrigger or length exceed the buffer. The buffer must have room for at least one sample
 * after the pretrigger samples. */
int recorder_arm(recorder_t *recorder, const recorder_channel_t *channels, uint8_t count,
                 recorder_channel_t trigger);

/* Sets the channels of a recording. Their number `count` is 1 to RECORDER_CHANNELS. */
void recorder_set_channels(recorder_t *recorder, const recorder_channel_t *channels, uint8_t count);

/* Sets the previous value of the trigger signal before the first tick of an armed recorder, so that
 * the recorder detects an edge in the first tick. */
void recorder_prime(recorder_t *recorder, int32_t value);

/* Makes the recorder idle immediately. A recording that was completed before can then no longer be
 * read. */
void recorder_stop(recorder_t *recorder);

/* Computes one tick of the recorder for the structure at `base`. The function may read up to 3
 * bytes beyond the end of each value. */
void recorder_tick(recorder_t *recorder, const void *base);

/* Reads the sample `index` of a completed recording into values[0..channel_count-1]; index 0 is the
 * oldest sample. An unsigned 32-bit value keeps its bits. Returns the number of channels, or -1 if
 * the recording is not complete or has no sample with this index. */
int recorder_read(const recorder_t *recorder, uint32_t index, int32_t values[RECORDER_CHANNELS]);

/* Copies up to `count` bytes of a completed recording into `bytes`, from the byte offset `offset`
 * on. The recording begins with the oldest sample. Returns the number of bytes read. */
uint32_t recorder_bytes(const recorder_t *recorder, uint32_t offset, uint8_t *bytes,
                        uint32_t count);

#endif
