#include "firmware/port/host/axis_host.h"

#include <stdlib.h>

struct axis_host {
  fw_t fw;
  uint8_t recorder_buffer[FW_RECORDER_BYTES];
};

axis_host_t *axis_host_create_with(const fw_config_t *config) {
  axis_host_t *host = calloc(1, sizeof(*host));
  if (host != NULL) {
    fw_config_t own = *config;
    if (own.recorder_buffer == NULL) {
      own.recorder_buffer = host->recorder_buffer;
      own.recorder_bytes = sizeof(host->recorder_buffer);
    }
    fw_init(&host->fw, &own);
  }
  return host;
}

axis_host_t *axis_host_create(void) {
  const fw_config_t on_no_bus = {0};
  return axis_host_create_with(&on_no_bus);
}

void axis_host_destroy(axis_host_t *host) { free(host); }

void axis_host_tick(axis_host_t *host, const axis_inputs_t *inputs, axis_outputs_t *outputs) {
  fw_tick(&host->fw, inputs, outputs);
}

int axis_host_read(const axis_host_t *host, uint16_t object, int32_t *value) {
  return fw_object_read(&host->fw, object, value);
}

const axis_signals_t *axis_host_signals(const axis_host_t *host) { return &host->fw.axis.signals; }

const fw_t *axis_host_firmware(const axis_host_t *host) { return &host->fw; }

int axis_host_write(axis_host_t *host, uint16_t object, int32_t value) {
  return fw_object_write(&host->fw, FW_SOURCE_LOCAL, object, value);
}

int axis_host_recorder_read(const axis_host_t *host, uint32_t index,
                            int32_t values[RECORDER_CHANNELS]) {
  return fw_recorder_read(&host->fw, index, values);
}

void axis_host_can_receive(axis_host_t *host, const can_frame_t *frame) {
  fw_can_receive(&host->fw, frame);
}

bool axis_host_can_transmit(axis_host_t *host, can_frame_t *frame) {
  return fw_can_transmit(&host->fw, frame);
}

void axis_host_can_lost(axis_host_t *host, uint16_t frames) { fw_can_lost(&host->fw, frames); }

void axis_host_can_bus(axis_host_t *host, uint8_t state) { fw_can_bus(&host->fw, state); }

void axis_host_modbus_receive(axis_host_t *host, const uint8_t *bytes, uint16_t count) {
  fw_modbus_receive(&host->fw, bytes, count);
}

uint16_t axis_host_modbus_transmit(axis_host_t *host, uint8_t *bytes, uint16_t room) {
  return fw_modbus_transmit(&host->fw, bytes, room);
}

void axis_host_overrun(axis_host_t *host) { fw_overrun(&host->fw, 0); }
