#include "firmware/core/recorder.h"

#include <stdbool.h>

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects_drive.h"
#include "firmware/objects/value.h"

void recorder_init(recorder_t *recorder, void *buffer, uint32_t buffer_bytes) {
  value_store_defaults(&recorder->params, AXIS_BLOCK_RECORDER_PARAMETER);
  value_store_defaults(&recorder->signals, AXIS_BLOCK_RECORDER_SIGNAL);
  recorder->buffer = buffer;
  recorder->buffer_bytes = buffer_bytes;
  recorder->channel_count = 0;
}

void recorder_set_channels(recorder_t *recorder, const recorder_channel_t *channels,
                           uint8_t count) {
  uint8_t sample_bytes = 0;
  for (uint8_t i = 0; i < count; i++) {
    const uint8_t bytes = value_bytes(channels[i].type);
    recorder->channels[i] = channels[i];
    recorder->channels[i].bytes = bytes;
    sample_bytes = (uint8_t)(sample_bytes + bytes);
  }
  recorder->channel_count = count;
  recorder->sample_bytes = sample_bytes;
  recorder->wide_count = 0;
  while (sample_bytes >= 4) {
    sample_bytes = (uint8_t)(sample_bytes - recorder->channels[recorder->wide_count].bytes);
    recorder->wide_count = (uint8_t)(recorder->wide_count + 1);
  }
}

/* Converts a value of the trigger signal, so that an unsigned comparison of two converted values
 * gives the order of the signal values. */
static uint32_t ordered(const recorder_t *recorder, int32_t value) {
  return (uint32_t)value ^ recorder->trigger_flip;
}

/* Computes the edge, the mask and the level of the trigger from the parameters. This is done once
 * for all ticks of a recording. */
static void set_trigger(recorder_t *recorder, recorder_channel_t trigger) {
  const uint8_t edge = recorder->params.recorder_trigger_edge;
  const bool starts = edge == AXIS_RECORDER_TRIGGER_EDGE_EXCITATION_START;
  const bool either = edge == AXIS_RECORDER_TRIGGER_EDGE_EITHER;
  recorder->trigger = trigger;
  recorder->trigger_primed = 0;
  recorder->trigger_rising = starts || either || edge == AXIS_RECORDER_TRIGGER_EDGE_RISING;
  recorder->trigger_falling = either || edge == AXIS_RECORDER_TRIGGER_EDGE_FALLING;
  recorder->trigger_flip = (trigger.type == AXIS_TYPE_U32) ? 0 : UINT32_C(0x80000000);
  recorder->trigger_level = ordered(recorder, starts ? AXIS_EXCITATION_STATE_RAMPING_UP
                                                     : recorder->params.recorder_trigger_level);
}

void recorder_prime(recorder_t *recorder, int32_t value) {
  recorder->trigger_previous = ordered(recorder, value);
  recorder->trigger_primed = 1;
}

/* Asserts the invariants of a recording: the buffer has room for a sample, the indices of samples
 * are below the capacity, and the number of samples is at most the capacity. */
static inline void assert_recording(const recorder_t *recorder) {
  const recorder_signals_t *signals = &recorder->signals;
  const uint32_t capacity = signals->recorder_capacity;
  fx_assert(recorder->channel_count > 0 && recorder->channel_count <= RECORDER_CHANNELS);
  fx_assert(recorder->wide_count <= recorder->channel_count);
  fx_assert(capacity > 0 && (uint64_t)capacity * recorder->sample_bytes <= recorder->buffer_bytes);
  fx_assert(recorder->write_index < capacity && recorder->first_index < capacity);
  fx_assert(signals->recorder_count <= capacity && recorder->samples_remaining <= capacity);
  fx_assert(signals->recorder_trigger_index <= signals->recorder_count);
}

int recorder_arm(recorder_t *recorder, const recorder_channel_t *channels, uint8_t count,
                 recorder_channel_t trigger) {
  if (count == 0 || count > RECORDER_CHANNELS) {
    return -1;
  }
  uint8_t sample_bytes = 0;
  for (uint8_t i = 0; i < count; i++) {
    sample_bytes = (uint8_t)(sample_bytes + value_bytes(channels[i].type));
  }
  const uint32_t room = fx_quotient(recorder->buffer_bytes, sample_bytes);
  const uint32_t wanted = recorder->params.recorder_length;
  const uint32_t capacity = (wanted == 0) ? room : wanted;
  if (capacity == 0 || capacity > room || recorder->params.recorder_pretrigger >= capacity) {
    return -1;
  }
  recorder_set_channels(recorder, channels, count);
  set_trigger(recorder, trigger);
  recorder->decimation_remaining = 0;
  recorder->write_index = 0;
  recorder->first_index = 0;
  recorder->samples_remaining = 0;
  recorder->signals = (recorder_signals_t){.recorder_capacity = capacity,
                                           .recorder_state = AXIS_RECORDER_STATE_ARMED};
  return 0;
}

void recorder_stop(recorder_t *recorder) {
  recorder->signals = (recorder_signals_t){.recorder_state = AXIS_RECORDER_STATE_IDLE};
}

/* Returns true in the tick in which the trigger signal crosses the trigger level in the selected
 * direction. */
static bool triggered(recorder_t *recorder, const void *base) {
  if (recorder->params.recorder_trigger_edge == AXIS_RECORDER_TRIGGER_EDGE_IMMEDIATE) {
    return true;
  }
  const uint32_t level = recorder->trigger_level;
  const uint32_t before = recorder->trigger_previous;
  const uint32_t now =
      ordered(recorder, value_load(base, recorder->trigger.offset, recorder->trigger.type));
  if (recorder->trigger_primed == 0) {
    recorder->trigger_primed = 1;
    recorder->trigger_previous = now;
    return false;
  }
  recorder->trigger_previous = now;
  return (before < level) ? recorder->trigger_rising && now >= level
                          : before > level && recorder->trigger_falling && now <= level;
}

static void store_sample(recorder_t *recorder, const void *base) {
  assert_recording(recorder);
  /* Samples are stored with the least significant byte first, which is the byte order of the
   * processor. */
  uint8_t *to = recorder->buffer + recorder->write_index * recorder->sample_bytes;
  const recorder_channel_t *channel = recorder->channels;
  /* Four bytes are copied for each value of the sample. If a value has fewer bytes, the next value
   * overwrites the surplus bytes. This needs fewer instructions than a check of the width of each
   * value. */
  for (uint32_t left = recorder->wide_count; left != 0; left--) {
    fx_copy_4(to, (const uint8_t *)base + channel->offset);
    to += channel->bytes;
    channel++;
  }
  const recorder_channel_t *end = &recorder->channels[recorder->channel_count];
  for (; channel != end; channel++) {
    const uint8_t *at = (const uint8_t *)base + channel->offset;
    const uint32_t bytes = channel->bytes;
    if (bytes == 2) {
      fx_copy_2(to, at);
    } else {
      to[0] = at[0];
    }
    to += bytes;
  }
  recorder->write_index += 1;
  if (recorder->write_index == recorder->signals.recorder_capacity) {
    recorder->write_index = 0;
  }
}

/* Starts the recording at the trigger. The samples before the trigger are kept, and the rest of the
 * buffer remains for samples after the trigger. */
static void start_recording(recorder_t *recorder) {
  recorder_signals_t *signals = &recorder->signals;
  signals->recorder_state = AXIS_RECORDER_STATE_RECORDING;
  signals->recorder_trigger_index = signals->recorder_count;
  recorder->samples_remaining = signals->recorder_capacity - signals->recorder_count;
}

void recorder_tick(recorder_t *recorder, const void *base) {
  recorder_signals_t *signals = &recorder->signals;
  if (signals->recorder_state != AXIS_RECORDER_STATE_ARMED &&
      signals->recorder_state != AXIS_RECORDER_STATE_RECORDING) {
    return;
  }
  if (signals->recorder_state == AXIS_RECORDER_STATE_ARMED && triggered(recorder, base)) {
    start_recording(recorder);
  }
  if (recorder->decimation_remaining != 0) {
    recorder->decimation_remaining -= 1;
    return;
  }
  recorder->decimation_remaining = (uint16_t)(recorder->params.recorder_decimation - 1);
  if (signals->recorder_state == AXIS_RECORDER_STATE_RECORDING) {
    store_sample(recorder, base);
    signals->recorder_count += 1;
    recorder->samples_remaining -= 1;
    if (recorder->samples_remaining == 0) {
      signals->recorder_state = AXIS_RECORDER_STATE_DONE;
    }
    return;
  }
  /* While the recorder is armed, the ring buffer contains the last `pretrigger` samples. */
  if (recorder->params.recorder_pretrigger == 0) {
    return;
  }
  store_sample(recorder, base);
  if (signals->recorder_count < recorder->params.recorder_pretrigger) {
    signals->recorder_count += 1;
  } else {
    recorder->first_index += 1;
    if (recorder->first_index == signals->recorder_capacity) {
      recorder->first_index = 0;
    }
  }
}

int recorder_read(const recorder_t *recorder, uint32_t index, int32_t values[RECORDER_CHANNELS]) {
  const recorder_signals_t *signals = &recorder->signals;
  if (signals->recorder_state != AXIS_RECORDER_STATE_DONE || index >= signals->recorder_count) {
    return -1;
  }
  const uint32_t to_end = signals->recorder_capacity - recorder->first_index;
  const uint32_t slot = (index < to_end) ? recorder->first_index + index : index - to_end;
  const uint8_t *from = recorder->buffer + slot * recorder->sample_bytes;
  for (uint8_t i = 0; i < recorder->channel_count; i++) {
    const uint8_t type = recorder->channels[i].type;
    const uint8_t bytes = value_bytes(type);
    values[i] = value_from_bits(fx_load_le(from, bytes), type);
    from += bytes;
  }
  return recorder->channel_count;
}

uint32_t recorder_bytes(const recorder_t *recorder, uint32_t offset, uint8_t *bytes,
                        uint32_t count) {
  const recorder_signals_t *signals = &recorder->signals;
  if (signals->recorder_state != AXIS_RECORDER_STATE_DONE) {
    return 0;
  }
  const uint32_t all = signals->recorder_count * recorder->sample_bytes;
  const uint32_t ring = signals->recorder_capacity * recorder->sample_bytes;
  uint32_t given = 0;
  while (given < count && offset < all) {
    uint32_t at = recorder->first_index * recorder->sample_bytes + offset;
    if (at >= ring) {
      at -= ring;
    }
    bytes[given] = recorder->buffer[at];
    given += 1;
    offset += 1;
  }
  return given;
}
