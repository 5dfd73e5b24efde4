#include "firmware/port/host/axis_host.h"

#include <stdlib.h>

#include "firmware/fx/fx.h"

typedef struct {
  /* The firmware must be the first member of this structure, because the caller uses the address of
   * the firmware as the address of the whole axis. */
  fw_t fw;
  blackbox_t blackbox;
  uint8_t recorder_buffer[FW_RECORDER_BYTES];
  uint32_t programs[FW_PROGRAM_BYTES / sizeof(uint32_t)];
  cycle_part_t results[FW_RESULTS];
  uint32_t curve[FW_CURVE_BYTES / sizeof(uint32_t)];
} axis_host_t;

fw_t *axis_host_create_with(const fw_config_t *config) {
  axis_host_t *host = calloc(1, sizeof(*host));
  if (host == NULL) {
    return NULL;
  }
  fw_config_t own = *config;
  if (own.recorder_buffer == NULL) {
    own.recorder_buffer = host->recorder_buffer;
    own.recorder_bytes = sizeof(host->recorder_buffer);
  }
  if (own.blackbox == NULL && own.buses != 0) {
    own.blackbox = &host->blackbox;
  }
  if (own.program_memory == NULL) {
    own.program_memory = host->programs;
    own.program_bytes = sizeof(host->programs);
  }
  if (own.result_memory == NULL) {
    own.result_memory = host->results;
    own.result_bytes = sizeof(host->results);
  }
  if (own.curve_memory == NULL) {
    own.curve_memory = host->curve;
    own.curve_bytes = sizeof(host->curve);
  }
  fw_init(&host->fw, &own);
  return &host->fw;
}

fw_t *axis_host_create(void) {
  const fw_config_t on_no_bus = {0};
  return axis_host_create_with(&on_no_bus);
}

int16_t axis_host_dac_code(const axis_outputs_t *outputs, int bits) {
  const uint32_t shift = (uint32_t)(AXIS_DAC_BITS_MAX - bits);
  return (int16_t)fx_floor_shift(outputs->dac_fine + fx_floor_shift(1 << shift, 1), shift);
}

void axis_host_destroy(fw_t *fw) { free(fw); }
