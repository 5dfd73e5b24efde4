#ifndef FIRMWARE_CORE_RECORDER_H_
#define FIRMWARE_CORE_RECORDER_H_

/* Recorder: up to 8 values of a structure, sampled at a decimation into a buffer of the caller.
 *
 * idle -> armed (samples go round, waiting for the trigger) -> recording (the remainder is filled)
 * -> done. Values are packed one after the other, least significant byte first, each as wide as its
 * type, so 32 KiB hold 16384 samples of one 16-bit code or 2048 of four 32-bit ones.
 *
 * The first sample is taken in the first tick after arming and then every `decimation` ticks,
 * without regard to the trigger. The trigger is watched in every tick, so none is missed; the first
 * sample at or after it has the index recorder_trigger_index. A trigger that comes before
 * `pretrigger` samples were taken is accepted and leaves fewer of them.
 *
 * The edge excitation_start is that of excitation_state, handed to recorder_arm() as the trigger:
 * of every sample from recorder_trigger_index on, the age of the waveform is its distance from
 * there times the decimation, if the recorder is armed before the excitation is started. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/generated/axis_objects.h"

enum { RECORDER_CHANNELS = 8 };

/* Where a value lies in the sampled structure. */
typedef struct {
  uint16_t offset; /* bytes from its start */
  uint8_t type;    /* AXIS_TYPE_ */
  uint8_t bytes;   /* of the type; recorder_arm() fills it in */
} recorder_channel_t;

typedef struct {
  recorder_params_t params;
  recorder_signals_t signals;
  uint8_t *buffer;
  uint32_t buffer_bytes;
  recorder_channel_t channels[RECORDER_CHANNELS];
  recorder_channel_t trigger;
  uint8_t channel_count;
  uint8_t wide_count; /* the first of them, behind whose start a sample has 4 bytes or more */
  uint8_t sample_bytes;
  uint8_t trigger_primed; /* trigger_previous holds the value of the last tick */
  bool trigger_rising;    /* edges that count */
  bool trigger_falling;
  uint32_t trigger_flip; /* of level and previous value, so that unsigned comparisons order them */
  uint32_t trigger_level;
  uint32_t trigger_previous;
  uint16_t decimation_remaining; /* ticks until the next sample */
  uint32_t write_index;          /* slot of the next sample, 0..capacity-1 */
  uint32_t first_index;          /* slot of sample 0 */
  uint32_t samples_remaining;    /* until done, once triggered */
} recorder_t;

/* Idle, without channels. The buffer stays with the caller and must outlive the recorder; it needs
 * no alignment and may be empty. */
void recorder_init(recorder_t *recorder, void *buffer, uint32_t buffer_bytes);

/* Starts a recording of channels[0..count-1] with the settings of recorder->params; trigger is not
 * read for the edge "immediate". Returns 0, or -1 and stays as it was if count is 0 or above
 * RECORDER_CHANNELS, the buffer holds no sample, or pretrigger or length ask for more than it
 * holds (pretrigger must leave room for the trigger's own sample). */
int recorder_arm(recorder_t *recorder, const recorder_channel_t *channels, uint8_t count,
                 recorder_channel_t trigger);

/* The channels that a recording of `count` has, 1 to RECORDER_CHANNELS. */
void recorder_set_channels(recorder_t *recorder, const recorder_channel_t *channels, uint8_t count);

/* The value of the trigger's source before the first tick of an armed recorder, so that an edge in
 * that tick counts. */
void recorder_prime(recorder_t *recorder, int32_t value);

/* Idle at once; a recording that was done can no longer be read. */
void recorder_stop(recorder_t *recorder);

/* One tick: samples the structure at `base`, of which up to 3 bytes behind a value may be read. */
void recorder_tick(recorder_t *recorder, const void *base);

/* Sample `index` (0 the oldest) of a recording that is done: values[0..channel_count-1], u32 as the
 * same 32 bits. Returns the number of channels, or -1 if it is not done or has no such sample. */
int recorder_read(const recorder_t *recorder, uint32_t index, int32_t values[RECORDER_CHANNELS]);

/* The same recording as bytes, oldest sample first: up to `count` of them from `offset`. Returns
 * how many there were. */
uint32_t recorder_bytes(const recorder_t *recorder, uint32_t offset, uint8_t *bytes,
                        uint32_t count);

#endif
