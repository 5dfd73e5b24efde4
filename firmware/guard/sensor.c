#include "firmware/guard/sensor.h"

void sensor_derive(sensor_t *sensor, const drive_params_t *params) {
  sensor->enabled =
      (uint8_t)(params->force_railed_time != 0 || params->force_jump_max != 0 ||
                params->force_stuck_travel != 0 || params->force_disconnected_code != 0);
  sensor->active &= sensor->enabled;
}

void sensor_guides(sensor_t *sensor, const axis_t *axis, bool guides) {
  if (guides && sensor->active == 0) {
    sensor->code = axis->signals.force_raw;
    sensor->railed_tick = 0;
    sensor->window = SENSOR_WINDOW_NONE;
  }
  sensor->active = guides ? 1 : 0;
}

static bool has_jumped(const sensor_t *sensor, const drive_params_t *params, const axis_t *axis) {
  const int32_t change = (int32_t)axis->signals.force_raw - (int32_t)sensor->code;
  const int32_t change_q8 = fx_scale(change, (uint32_t)16 - axis->params.adc_bits);
  return params->force_jump_max != 0 && !fx_within(change_q8, params->force_jump_max);
}

static bool stays_railed(sensor_t *sensor, const drive_params_t *params, const axis_t *axis) {
  if (params->force_railed_time == 0 || !sensor_is_railed(axis)) {
    sensor->railed_tick = 0;
    return false;
  }
  sensor->railed_tick = (uint16_t)(sensor->railed_tick + 1);
  return sensor->railed_tick >= fx_ticks_from_ms(params->force_railed_time);
}

/* Returns which of the monitored conditions (SENSOR_WINDOW_) is met in this tick. A condition
 * becomes a fault only if it lasts for its time. This function is called in every fourth tick. */
static uint8_t window_of(const sensor_t *sensor, const drive_params_t *params, const axis_t *axis) {
  if (!fx_within(axis->signals.force, axis->params.contact_force)) {
    return (params->force_stuck_travel != 0 && sensor->changed == 0) ? SENSOR_WINDOW_STUCK
                                                                     : SENSOR_WINDOW_NONE;
  }
  const int32_t code = params->force_disconnected_code;
  const int32_t pressing = fx_code_from_q16(axis->net_q16);
  return (code != 0 && !fx_within(pressing, code - 1)) ? SENSOR_WINDOW_DISCONNECTED
                                                       : SENSOR_WINDOW_NONE;
}

static void open_window(sensor_t *sensor, const axis_t *axis, uint8_t window) {
  sensor->window = window;
  sensor->window_tick = 1;
  sensor->start_cnt = axis->signals.position;
}

static uint8_t check_window(sensor_t *sensor, const drive_params_t *params, const axis_t *axis) {
  const uint8_t window = window_of(sensor, params, axis);
  sensor->changed = 0;
  if (window == SENSOR_WINDOW_NONE || window != sensor->window) {
    open_window(sensor, axis, window);
    return AXIS_FAULT_NONE;
  }
  sensor->window_tick = (uint16_t)(sensor->window_tick + 4);
  const int32_t moved = fx_diff_wrap(axis->signals.position, sensor->start_cnt);
  if (window == SENSOR_WINDOW_STUCK) {
    if (!fx_within(moved, params->force_stuck_travel)) {
      return AXIS_FAULT_FORCE_STUCK;
    }
    if (sensor->window_tick >= fx_ticks_from_ms(params->force_stuck_time)) {
      open_window(sensor, axis, window);
    }
    return AXIS_FAULT_NONE;
  }
  if (!fx_within(moved, params->force_disconnected_travel)) {
    open_window(sensor, axis, window);
    return AXIS_FAULT_NONE;
  }
  return (sensor->window_tick >= fx_ticks_from_ms(params->force_disconnected_time))
             ? AXIS_FAULT_FORCE_DISCONNECTED
             : AXIS_FAULT_NONE;
}

void sensor_check_active(sensor_t *sensor, const drive_params_t *params, axis_t *axis,
                         axis_outputs_t *outputs) {
  if (axis->signals.active_mode == AXIS_MODE_DISABLED) {
    sensor->code = axis->signals.force_raw;
    return;
  }
  uint8_t fault = AXIS_FAULT_NONE;
  if (has_jumped(sensor, params, axis)) {
    fault = AXIS_FAULT_FORCE_JUMP;
  } else if (stays_railed(sensor, params, axis)) {
    fault = AXIS_FAULT_FORCE_RAILED;
  }
  sensor->changed |= (uint8_t)(axis->signals.force_raw != sensor->code);
  sensor->code = axis->signals.force_raw;
  if (fault == AXIS_FAULT_NONE && (axis->signals.tick_count & 3) == 2) {
    fault = check_window(sensor, params, axis);
  }
  if (fault != AXIS_FAULT_NONE) {
    axis_trip(axis, fault, outputs);
  }
}
