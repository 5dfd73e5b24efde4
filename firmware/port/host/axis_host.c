#include "firmware/port/host/axis_host.h"

#include <stdlib.h>

struct axis_host {
  fw_t fw;
  uint8_t recorder_buffer[FW_RECORDER_BYTES];
};

axis_host_t *axis_host_create(void) {
  axis_host_t *host = calloc(1, sizeof(*host));
  if (host != NULL) {
    fw_init(&host->fw, host->recorder_buffer, sizeof(host->recorder_buffer));
  }
  return host;
}

void axis_host_destroy(axis_host_t *host) { free(host); }

void axis_host_tick(axis_host_t *host, const axis_inputs_t *inputs, axis_outputs_t *outputs) {
  fw_tick(&host->fw, inputs, outputs);
}

int axis_host_read(const axis_host_t *host, uint16_t object, int32_t *value) {
  return fw_object_read(&host->fw, object, value);
}

int axis_host_write(axis_host_t *host, uint16_t object, int32_t value) {
  return fw_object_write(&host->fw, object, value);
}

int axis_host_recorder_read(const axis_host_t *host, uint32_t index,
                            int32_t values[RECORDER_CHANNELS]) {
  return fw_recorder_read(&host->fw, index, values);
}
