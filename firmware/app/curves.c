#include "firmware/app/curves.h"

#include "firmware/drive/cycle_mode.h"
#include "firmware/fx/fx.h"

enum {
  DATA_WORDS = AXIS_OBJ_CYCLE_DATA_16 - AXIS_OBJ_CYCLE_DATA_1 + 1,
  POINT_BYTES = sizeof(cycle_curve_point_t),
  SHOWN_POINTS = 5
};
_Static_assert(SHOWN_POINTS *POINT_BYTES <= 4 * DATA_WORDS, "points that cycle_data shows");

static void show_size(fw_t *fw) {
  fw->device_signals.cycle_curve_points = (uint16_t)fw->curve.count;
  fw->device_signals.cycle_curve_thinned = fw->curve.thinned;
}

void curves_init(fw_t *fw) {
  cycle_curve_init(&fw->curve, fw->config.curve_memory, fw->config.curve_bytes);
  fw->curve_cycle = fw->drive.signals.cycle_count;
  show_size(fw);
}

/* Begins the recording of the curve when a cycle has started. */
static void begin(fw_t *fw) {
  const cycle_curve_steps_t steps = {.travel = fw->device.cycle_curve_step_travel,
                                     .force = fw->device.cycle_curve_step_force,
                                     .time = fw->device.cycle_curve_step_time};
  fw->curve_cycle = fw->drive.signals.cycle_count;
  cycle_curve_begin(&fw->curve, &steps, fw->drive.cycle.begin_tick);
  canopen_domain_replaced(&fw->canopen, DICTIONARY_CURVE);
}

void curves_between(fw_t *fw, uint8_t first) {
  const cycle_t *cycle = &fw->drive.cycle;
  if (fw->curve_cycle != fw->drive.signals.cycle_count) {
    begin(fw);
  }
  const int32_t zero_travel = fx_diff_wrap(cycle->zero_cnt, cycle->begin_cnt);
  for (uint8_t i = first; i != cycle->evaluated; i++) {
    cycle_curve_take(&fw->curve, &cycle->samples[i & (CYCLE_SAMPLES - 1)], zero_travel);
  }
  if (cycle->state == CYCLE_DONE) {
    cycle_curve_end(&fw->curve);
  }
  show_size(fw);
}

int curves_check(const fw_t *fw, uint16_t object) {
  const bool is_refused = object == AXIS_OBJ_CYCLE_CURVE_FIRST && cycle_mode_is_busy(&fw->drive);
  return is_refused ? FW_ERROR_STATE : FW_OK;
}

void curves_written(fw_t *fw, uint16_t object) {
  if (object == AXIS_OBJ_CYCLE_CURVE_FIRST) {
    uint32_t *data = fw->device.cycle_data;
    for (uint32_t i = 0; i < DATA_WORDS; i++) {
      data[i] = 0;
    }
    void *bytes = data;
    (void)cycle_curve_bytes(&fw->curve, fw->device.cycle_curve_first * (uint32_t)POINT_BYTES,
                            (uint8_t *)bytes, SHOWN_POINTS * POINT_BYTES);
  }
}

int32_t curves_size(const fw_t *fw) {
  if (cycle_mode_is_busy(&fw->drive)) {
    return FW_ERROR_STATE;
  }
  return (fw->curve.count == 0) ? FW_ERROR_NO_DATA : (int32_t)(fw->curve.count * POINT_BYTES);
}
