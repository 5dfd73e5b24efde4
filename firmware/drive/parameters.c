#include "firmware/drive/parameters.h"

#include "firmware/drive/homing.h"
#include "firmware/drive/modes.h"
#include "firmware/drive/units.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/access.h"

/* WHOLE: 100 %, in per mille. OUTPUT_MAX: the value of output_limit with which the DAC code is not
 * limited. */
enum { WHOLE = 1000, OUTPUT_MAX = 2048 };

static void derive_rates(cia402_t *drive) {
  const drive_params_t *params = &drive->params;
  drive->speed_max = units_speed_q16(drive, params->velocity_max);
  drive->acceleration = units_rate_q16(drive, params->trajectory_acceleration);
  drive->deceleration = units_rate_q16(drive, params->trajectory_deceleration);
  drive->quick_deceleration = units_rate_q16(drive, params->quick_stop_deceleration);
}

static void derive_forces(cia402_t *drive) {
  const drive_params_t *params = &drive->params;
  /* rated_force is in mN, so the same number is one per mille of the rated force in uN. One count
   * of measured force is force_scale uN. A measured force is stored in 1/256 count. */
  drive->reading_of_force = fx_ratio(params->rated_force, params->force_scale, 8);
  drive->force_of_reading = fx_ratio(params->force_scale, params->rated_force, -8);
  const int32_t limit = params->force_limit;
  const int32_t most = fx_clamp(params->force_limit_positive, 0, limit);
  const int32_t least = -fx_clamp(params->force_limit_negative, 0, limit);
  const int32_t permitted =
      (int32_t)fx_quotient((uint32_t)params->force_limit * drive->law_force, WHOLE);
  const int32_t law_least = fx_clamp(least, -permitted, 0);
  const int32_t law_most = fx_clamp(most, 0, permitted);
  drive->force_bounds =
      (cia402_force_bounds_t){.least = law_least,
                              .most = law_most,
                              .least_q8 = fx_ratio_apply(law_least, drive->reading_of_force, 0),
                              .most_q8 = fx_ratio_apply(law_most, drive->reading_of_force, 0),
                              .law_q8 = fx_ratio_apply(permitted, drive->reading_of_force, 0)};
}

static void permit(cia402_t *drive, bool certified, uint16_t force, uint16_t output) {
  drive->uncertified = certified ? 0 : 1;
  drive->law_force = force;
  drive->law_output = output;
  derive_forces(drive);
}

void cia402_restrict_law(cia402_t *drive, uint16_t force, uint16_t output) {
  permit(drive, false, force, output);
}

void cia402_release_law(cia402_t *drive) { permit(drive, true, WHOLE, OUTPUT_MAX); }

static void derive_shapers(cia402_t *drive) {
  const drive_params_t *params = &drive->params;
  drive->signals.force_shaper_state =
      shaper_set(&drive->force_shaper, params->force_shaper_impulses,
                 params->force_shaper_amplitude, params->force_shaper_delay);
  drive->signals.motion_shaper_state =
      shaper_set(&drive->motion_shaper, params->motion_shaper_impulses,
                 params->motion_shaper_amplitude, params->motion_shaper_delay);
}

void parameters_derive(cia402_t *drive) {
  units_derive(drive);
  derive_rates(drive);
  derive_forces(drive);
  derive_shapers(drive);
  homing_list(drive);
  guards_derive(&drive->guards, &drive->params, &drive->signals);
}

bool parameters_written(cia402_t *drive, uint16_t object) {
  guards_derive(&drive->guards, &drive->params, &drive->signals);
  switch (object) {
    case AXIS_OBJ_POLARITY:
      return true;
    case AXIS_OBJ_RATED_FORCE:
    case AXIS_OBJ_FORCE_SCALE:
    case AXIS_OBJ_FORCE_LIMIT:
    case AXIS_OBJ_FORCE_LIMIT_POSITIVE:
    case AXIS_OBJ_FORCE_LIMIT_NEGATIVE:
      derive_forces(drive);
      return false;
    case AXIS_OBJ_VELOCITY_MAX:
    case AXIS_OBJ_TRAJECTORY_ACCELERATION:
    case AXIS_OBJ_TRAJECTORY_DECELERATION:
    case AXIS_OBJ_QUICK_STOP_DECELERATION:
      derive_rates(drive);
      return false;
    case AXIS_OBJ_INPUTS_FITTED:
      homing_list(drive);
      return false;
    default:
      if (object >= AXIS_OBJ_FORCE_SHAPER_IMPULSES && object <= AXIS_OBJ_MOTION_SHAPER_DELAY_3) {
        derive_shapers(drive);
        return false;
      }
      if (!units_depend_on(object)) {
        return false;
      }
      units_derive(drive);
      derive_rates(drive);
      return true;
  }
}

int cia402_check(const cia402_t *drive, uint16_t object, int32_t value) {
  bool right = true;
  switch (object) {
    case AXIS_OBJ_MODES_OF_OPERATION:
      right = cia402_mode_exists(value);
      break;
    case AXIS_OBJ_QUICK_STOP_OPTION:
      right = value <= STOP_QUICK || value >= QUICK_STOP_STAY;
      break;
    case AXIS_OBJ_HOMING_METHOD:
      right = homing_is_offered(drive, value);
      break;
    case AXIS_OBJ_POSITION_LIMIT_MIN:
      right = value <= drive->params.position_limit_max;
      break;
    case AXIS_OBJ_POSITION_LIMIT_MAX:
      right = value >= drive->params.position_limit_min;
      break;
    case AXIS_OBJ_POLARITY:
      right = (value & ~(AXIS_POLARITY_POSITION | AXIS_POLARITY_VELOCITY)) == 0;
      break;
    default:
      right = !units_depend_on(object) || units_fit(&drive->params, object, value);
      break;
  }
  return right ? FW_OK : FW_ERROR_RANGE;
}
