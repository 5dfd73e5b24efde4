#include "firmware/core/blackbox.h"

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects.h"
#include "firmware/objects/value.h"

enum { CHECK_BYTES = 16 };

static void forget(blackbox_t *blackbox) {
  blackbox->tick = 0;
  blackbox->crc = UINT32_MAX;
  blackbox->checked = 0;
  blackbox->later = 0;
  blackbox->error_code = AXIS_ERROR_CODE_NONE;
  blackbox->fault = AXIS_FAULT_NONE;
  blackbox->kept = 0;
}

static uint8_t bytes_of_sample(const recorder_channel_t channels[RECORDER_CHANNELS]) {
  uint8_t bytes = 0;
  for (uint8_t i = 0; i < RECORDER_CHANNELS; i++) {
    bytes = (uint8_t)(bytes + value_bytes(channels[i].type));
  }
  return bytes;
}

/* Returns true if the memory of the black box contains a valid ring buffer with these channels.
 * After a power cut the contents of this memory are arbitrary. */
static bool is_ring(const blackbox_t *blackbox, uint32_t buffer_bytes,
                    const recorder_channel_t channels[RECORDER_CHANNELS]) {
  const recorder_t *ring = &blackbox->ring;
  const recorder_signals_t *signals = &ring->signals;
  return blackbox->magic == BLACKBOX_MAGIC && blackbox->table == AXIS_OBJECTS_HASH32 &&
         blackbox->fault < AXIS_FAULT_COUNT && ring->channel_count == RECORDER_CHANNELS &&
         ring->sample_bytes == bytes_of_sample(channels) &&
         signals->recorder_capacity <= BLACKBOX_SAMPLES &&
         signals->recorder_capacity <= fx_quotient(buffer_bytes, ring->sample_bytes) &&
         signals->recorder_count != 0 && signals->recorder_count <= signals->recorder_capacity &&
         signals->recorder_trigger_index <= signals->recorder_count &&
         ring->first_index < signals->recorder_capacity &&
         signals->recorder_state <= AXIS_RECORDER_STATE_DONE;
}

void blackbox_init(blackbox_t *blackbox, void *buffer, uint32_t buffer_bytes,
                   const recorder_channel_t channels[RECORDER_CHANNELS], uint16_t reset_error) {
  recorder_signals_t *signals = &blackbox->ring.signals;
  const bool is_ours = is_ring(blackbox, buffer_bytes, channels);
  const uint8_t state = signals->recorder_state;
  const bool is_kept =
      is_ours && (state == AXIS_RECORDER_STATE_RECORDING || state == AXIS_RECORDER_STATE_DONE ||
                  (state == AXIS_RECORDER_STATE_ARMED && reset_error != AXIS_ERROR_CODE_NONE));
  blackbox->error_before = AXIS_ERROR_CODE_NONE;
  blackbox->enabled_tick = 0;
  blackbox->was_enabled = 0;
  if (!is_kept) {
    recorder_init(&blackbox->ring, buffer, buffer_bytes);
    blackbox->magic = BLACKBOX_MAGIC;
    blackbox->table = AXIS_OBJECTS_HASH32;
    forget(blackbox);
    return;
  }
  blackbox->ring.buffer = buffer;
  blackbox->ring.buffer_bytes = buffer_bytes;
  recorder_set_channels(&blackbox->ring, channels, RECORDER_CHANNELS);
  if (state == AXIS_RECORDER_STATE_ARMED) {
    signals->recorder_trigger_index = signals->recorder_count - 1;
    blackbox->error_code = reset_error;
  }
  signals->recorder_state = AXIS_RECORDER_STATE_DONE;
  blackbox->kept = 1;
  blackbox->crc = UINT32_MAX;
  blackbox->checked = 0;
}

static uint32_t samples_of(uint32_t buffer_bytes,
                           const recorder_channel_t channels[RECORDER_CHANNELS]) {
  const uint32_t room = fx_quotient(buffer_bytes, bytes_of_sample(channels));
  return (room < BLACKBOX_SAMPLES) ? room : BLACKBOX_SAMPLES;
}

uint32_t blackbox_bytes(uint32_t buffer_bytes,
                        const recorder_channel_t channels[RECORDER_CHANNELS]) {
  return samples_of(buffer_bytes, channels) * bytes_of_sample(channels);
}

void blackbox_start(blackbox_t *blackbox, const recorder_channel_t channels[RECORDER_CHANNELS],
                    recorder_channel_t trigger) {
  recorder_t *ring = &blackbox->ring;
  const uint32_t length = samples_of(ring->buffer_bytes, channels);
  forget(blackbox);
  if (length <= BLACKBOX_AFTER) {
    return;
  }
  ring->params.recorder_length = (uint16_t)length;
  ring->params.recorder_pretrigger = (uint16_t)(length - BLACKBOX_AFTER);
  ring->params.recorder_trigger_edge = AXIS_RECORDER_TRIGGER_EDGE_RISING;
  ring->params.recorder_trigger_level = 1;
  (void)recorder_arm(ring, channels, RECORDER_CHANNELS, trigger);
}

void blackbox_stop(blackbox_t *blackbox) {
  recorder_stop(&blackbox->ring);
  forget(blackbox);
}

void blackbox_restore(blackbox_t *blackbox, uint32_t tick, uint16_t error_code, uint8_t fault,
                      uint16_t samples, uint16_t trigger_index) {
  recorder_t *ring = &blackbox->ring;
  forget(blackbox);
  ring->write_index = 0;
  ring->first_index = 0;
  ring->signals.recorder_capacity = samples;
  ring->signals.recorder_count = samples;
  ring->signals.recorder_trigger_index = trigger_index;
  ring->signals.recorder_state = AXIS_RECORDER_STATE_DONE;
  blackbox->tick = tick;
  blackbox->error_code = error_code;
  blackbox->fault = fault;
  blackbox->kept = 1;
}

void blackbox_follow(blackbox_t *blackbox, bool enabled, uint16_t error_code, uint32_t tick) {
  const bool begins = error_code != AXIS_ERROR_CODE_NONE && error_code != blackbox->error_before;
  blackbox->error_before = error_code;
  if (enabled) {
    blackbox->enabled_tick = tick;
    blackbox->was_enabled = 1;
  }
  if (!blackbox_has_incident(blackbox)) {
    if (blackbox->error_code == AXIS_ERROR_CODE_NONE) {
      blackbox->tick = tick;
    }
    return;
  }
  const bool was_enabled =
      blackbox->was_enabled != 0 && blackbox->tick - blackbox->enabled_tick <= BLACKBOX_BEFORE;
  if (blackbox->kept == 0 && blackbox->checked == 0 && !was_enabled) {
    blackbox_stop(blackbox);
  } else if (begins && (blackbox->checked != 0 || error_code != blackbox->error_code) &&
             blackbox->later < UINT16_MAX) {
    blackbox->later = (uint16_t)(blackbox->later + 1);
  }
}

bool blackbox_check(blackbox_t *blackbox) {
  const recorder_t *ring = &blackbox->ring;
  const uint32_t all = ring->signals.recorder_count * ring->sample_bytes;
  if (blackbox->checked == all) {
    return true;
  }
  uint8_t bytes[CHECK_BYTES];
  const uint32_t count = recorder_bytes(ring, blackbox->checked, bytes, CHECK_BYTES);
  for (uint32_t i = 0; i < count; i++) {
    blackbox->crc = fx_crc32(blackbox->crc, bytes[i]);
  }
  blackbox->checked += count;
  if (blackbox->checked == all) {
    blackbox->crc = ~blackbox->crc;
  }
  return blackbox->checked == all;
}

void blackbox_show(const blackbox_t *blackbox, recorder_t *recorder) {
  const recorder_t *ring = &blackbox->ring;
  recorder_set_channels(recorder, ring->channels, RECORDER_CHANNELS);
  recorder->write_index = ring->write_index;
  recorder->first_index = ring->first_index;
  recorder->signals = ring->signals;
  recorder->params.recorder_decimation = 1;
}
