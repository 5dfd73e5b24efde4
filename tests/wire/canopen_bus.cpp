// The firmware on a CAN bus in process, for clients written in Python (test_canopen_client.py).

#include <cstring>

#include "firmware/port/host/firmware.hpp"

namespace {

struct Axis {
  fw_t fw{};
  axis_inputs_t inputs{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
  uint8_t recorder[FW_RECORDER_BYTES]{};
  uint32_t programs[FW_PROGRAM_BYTES / sizeof(uint32_t)]{};
  cycle_part_t results[FW_RESULTS]{};
  uint32_t curve[FW_CURVE_BYTES / sizeof(uint32_t)]{};
};

}  // namespace

#define EXPORTED extern "C" __attribute__((visibility("default")))

EXPORTED void *axis_new(uint8_t node_id) {
  auto *axis = new Axis;
  fw_config_t config{};
  config.recorder_buffer = axis->recorder;
  config.recorder_bytes = sizeof(axis->recorder);
  config.program_memory = axis->programs;
  config.program_bytes = sizeof(axis->programs);
  config.result_memory = axis->results;
  config.result_bytes = sizeof(axis->results);
  config.curve_memory = axis->curve;
  config.curve_bytes = sizeof(axis->curve);
  config.node_id = node_id;
  config.buses = 1;
  fw_init(&axis->fw, &config);
  return axis;
}

EXPORTED void axis_delete(void *axis) { delete static_cast<Axis *>(axis); }

EXPORTED void axis_ticks(void *axis, uint32_t ticks) {
  auto *self = static_cast<Axis *>(axis);
  axis_outputs_t outputs{};
  for (uint32_t i = 0; i < ticks; ++i) fw_tick(&self->fw, &self->inputs, &outputs);
}

EXPORTED void axis_receive(void *axis, uint16_t id, uint8_t remote, const uint8_t *data,
                           uint8_t length) {
  can_frame_t frame{};
  frame.id = id;
  frame.remote = remote;
  frame.length = length;
  std::memcpy(frame.data, data, length);
  fw_can_receive(&static_cast<Axis *>(axis)->fw, &frame);
}

// Fills in 8 bytes; returns length and identifier * 16, or -1.
EXPORTED int32_t axis_transmit(void *axis, uint8_t *data) {
  can_frame_t frame{};
  if (!fw_can_transmit(&static_cast<Axis *>(axis)->fw, &frame)) return -1;
  std::memcpy(data, frame.data, 8);
  return frame.id * 16 + frame.length;
}
