#ifndef TESTS_FUZZ_NODE_H_
#define TESTS_FUZZ_NODE_H_

/* A whole firmware on a CAN bus, for the fuzzers of the CANopen node. */

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/app/fw.h"

enum { NODE_ID = 5 };

typedef struct {
  fw_t fw;
  axis_inputs_t inputs;
  axis_outputs_t outputs;
  uint8_t recorder[FW_RECORDER_BYTES];
  uint32_t programs[FW_PROGRAM_BYTES / sizeof(uint32_t)];
  cycle_part_t results[FW_RESULTS];
  uint32_t curve[FW_CURVE_BYTES / sizeof(uint32_t)];
} node_t;

static inline void node_init_as(node_t *node, uint8_t node_id) {
  memset(node, 0, sizeof(*node));
  const fw_config_t config = {
      .recorder_buffer = node->recorder,
      .recorder_bytes = sizeof(node->recorder),
      .node_id = node_id,
      .buses = 1,
      .program_memory = node->programs,
      .program_bytes = sizeof(node->programs),
      .result_memory = node->results,
      .result_bytes = sizeof(node->results),
      .curve_memory = node->curve,
      .curve_bytes = sizeof(node->curve),
  };
  fw_init(&node->fw, &config);
  node->inputs.sensor_valid = 1;
  node->inputs.din = AXIS_DIGITAL_INPUTS_ENABLE;
}

static inline void node_init(node_t *node) { node_init_as(node, NODE_ID); }

/* Stops the fuzzer: a property does not hold. */
static inline void require(int holds) {
  if (!holds) {
    abort();
  }
}

static inline void node_send(node_t *node, uint16_t id, const uint8_t *data, uint8_t length) {
  can_frame_t frame = {.id = id, .length = length};
  memcpy(frame.data, data, length);
  fw_can_receive(&node->fw, &frame);
}

static inline void node_tick(node_t *node, uint32_t ticks) {
  for (uint32_t i = 0; i < ticks; i++) {
    fw_tick(&node->fw, &node->inputs, &node->outputs);
  }
}

/* The node's share of many ticks: nothing else of the firmware moves. */
static inline void node_wait(node_t *node, uint32_t ticks) {
  node_tick(node, 1);
  for (uint32_t i = 1; i < ticks; i++) {
    const canopen_axis_t axis = {.error_code = node->fw.drive.signals.error_code,
                                 .fault = node->fw.axis.signals.fault};
    canopen_tick_begin(&node->fw.canopen, &node->fw.objects, false, false);
    while (canopen_is_behind(&node->fw.canopen)) {
      (void)canopen_tick_timers(&node->fw.canopen, false);
      canopen_tick_end(&node->fw.canopen, &node->fw.objects, &axis);
    }
  }
}

/* Expedited download over the default server, 0 or the abort code. Other frames are dropped. */
static inline uint32_t node_write(node_t *node, uint16_t index, uint8_t sub, uint32_t value,
                                  uint8_t bytes) {
  const uint8_t data[8] = {(uint8_t)(0x23 | (4 - bytes) << 2),
                           (uint8_t)index,
                           (uint8_t)(index >> 8),
                           sub,
                           (uint8_t)value,
                           (uint8_t)(value >> 8),
                           (uint8_t)(value >> 16),
                           (uint8_t)(value >> 24)};
  can_frame_t frame;
  while (fw_can_transmit(&node->fw, &frame)) {
  }
  node_send(node, 0x600 + NODE_ID, data, 8);
  while (fw_can_transmit(&node->fw, &frame)) {
    if (frame.id == 0x580 + NODE_ID) {
      require(frame.length == 8 && (frame.data[0] == 0x60 || frame.data[0] == 0x80));
      return (frame.data[0] == 0x60)
                 ? 0
                 : (uint32_t)frame.data[4] | (uint32_t)frame.data[5] << 8 |
                       (uint32_t)frame.data[6] << 16 | (uint32_t)frame.data[7] << 24;
    }
  }
  return UINT32_MAX; /* stopped */
}

#endif
