#ifndef FIRMWARE_CORE_FAULTS_H_
#define FIRMWARE_CORE_FAULTS_H_

/* Faults are conditions that disable the axis in the same tick in which the firmware detects
 * them. */

#include <stdint.h>

#include "firmware/core/axis_state.h"
#include "firmware/fx/fx.h"

/* Returns true if the magnitude of a value exceeds `limit`. If `limit` is 0, the result is always
 * false. */
static inline bool fault_exceeds(int32_t value, int32_t limit) {
  return limit != 0 && !fx_within(value, limit);
}

/* Returns the fault (AXIS_FAULT_) of a tick in which a mode drives the amplifier, or none. The
 * first condition that is true determines the fault:
 *   enable_lost      the enable chain is open
 *   adc_range        an ADC code is 2^adc_bits or more
 *   limit_switches   both limit switches are on at the same time, which indicates a broken wire
 *   overspeed        |velocity| > speed_max, unless speed_max is 0
 *   force_max        |force| > force_max, unless force_max is 0
 *   following_error  |position_error| > following_error_max in position mode, unless
 *                    following_error_max is 0
 * The faults of fault_detect_drive() are checked after these faults. axis_tick() checks
 * sensor_invalid before all other faults, in every mode and before it uses a sensor value. The
 * signals must be those of the present tick. */
static inline uint8_t fault_detect(const axis_params_t *params, const axis_signals_t *signals,
                                   const axis_inputs_t *inputs) {
  const uint8_t both_switches =
      AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE | AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE;
  if ((inputs->din & AXIS_DIGITAL_INPUTS_ENABLE) == 0) {
    return AXIS_FAULT_ENABLE_LOST;
  }
  if (!fx_fits_bits(inputs->adc_code[0] | inputs->adc_code[1], params->adc_bits)) {
    return AXIS_FAULT_ADC_RANGE;
  }
  if ((inputs->din & both_switches) == both_switches) {
    return AXIS_FAULT_LIMIT_SWITCHES;
  }
  if (fault_exceeds(signals->velocity, params->speed_max)) {
    return AXIS_FAULT_OVERSPEED;
  }
  if (fault_exceeds(signals->force, params->force_max)) {
    return AXIS_FAULT_FORCE_MAX;
  }
  /* The position error is 0 in every mode except position mode. */
  if (fault_exceeds(signals->position_error, params->following_error_max)) {
    return AXIS_FAULT_FOLLOWING_ERROR;
  }
  return AXIS_FAULT_NONE;
}

/* Returns the fault (AXIS_FAULT_) of a tick in which a mode other than disabled is requested: a
 * fault of the drive, or a sensor value that is too old. The first condition that is true
 * determines the fault:
 *   drive_fault      the drive reports a fault of its own
 *   drive_lost       the drive was on and is off
 *   drive_not_ready  the drive is off drive_on_ticks_max ticks after the amplifier was enabled
 *   position_old     position_age > position_age_max
 *   force_old        force_age > force_age_max
 * The first three faults need AXIS_DRIVE_REPORT_FITTED. While a fitted drive is off, the ages are
 * not checked, because no control law uses the position or the force. active_mode must be the mode
 * of the previous tick. */
static inline uint8_t fault_detect_drive(const axis_t *axis, const axis_inputs_t *inputs) {
  const axis_params_t *params = &axis->params;
  if ((inputs->drive & AXIS_DRIVE_REPORT_FITTED) != 0 &&
      (inputs->drive & AXIS_DRIVE_REPORT_FAULT) != 0) {
    return AXIS_FAULT_DRIVE_FAULT;
  }
  if (axis_drive_is_off(inputs->drive)) {
    if (axis->signals.active_mode != AXIS_MODE_DISABLED) {
      return AXIS_FAULT_DRIVE_LOST;
    }
    if (axis->drive_wait_tick >= params->drive_on_ticks_max) {
      return AXIS_FAULT_DRIVE_NOT_READY;
    }
    return AXIS_FAULT_NONE;
  }
  if (inputs->position_age > params->position_age_max) {
    return AXIS_FAULT_POSITION_OLD;
  }
  if (inputs->force_age > params->force_age_max) {
    return AXIS_FAULT_FORCE_OLD;
  }
  return AXIS_FAULT_NONE;
}

#endif
