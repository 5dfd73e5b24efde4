#include "firmware/drive/homing.h"

#include "firmware/drive/motion.h"
#include "firmware/drive/units.h"
#include "firmware/fx/fx.h"

/* Events other than digital inputs that end a step of homing. No digital input
 * (AXIS_DIGITAL_INPUTS_) uses their bits. */
enum { CONTACT = 0x40, RETRACTED = 0x80 };

enum { AWAY = -1, TOWARD = 1 };
enum { FAST = 0, SLOW = 1 };
enum { OFF = 0, ON = 1 };

enum { STEPS = 3 };

/* One step of a homing method. The axis moves in one direction until the input `until` has the
 * level `level`, on or off. If the direction is 0, the method does not use this step. */
typedef struct {
  int8_t direction;
  uint8_t speed;
  uint8_t until;
  uint8_t level;
} homing_step_t;

/* A homing method. The reference position is the position at the end of the last step. */
typedef struct {
  int8_t method;
  /* digital inputs that the homing method needs, as AXIS_DIGITAL_INPUTS_ bits; the object
   * inputs_fitted must contain all of them */
  uint8_t needs;
  homing_step_t steps[STEPS];
} homing_method_t;

/* Number of homing methods. The table has the methods in the same order as the object
 * homing_methods. */
enum { METHODS = 11 };
static const homing_method_t methods[METHODS] = {
    {35, 0, {{0}}},
    {37, 0, {{0}}},
    {-1,
     0,
     {{TOWARD, FAST, CONTACT, ON}, {AWAY, FAST, RETRACTED, ON}, {TOWARD, SLOW, CONTACT, ON}}},
    {17,
     AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE,
     {{AWAY, FAST, AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE, ON},
      {TOWARD, SLOW, AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE, OFF}}},
    {18,
     AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE,
     {{TOWARD, FAST, AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE, ON},
      {AWAY, SLOW, AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE, OFF}}},
    {19,
     AXIS_DIGITAL_INPUTS_HOME,
     {{TOWARD, FAST, AXIS_DIGITAL_INPUTS_HOME, ON}, {AWAY, SLOW, AXIS_DIGITAL_INPUTS_HOME, OFF}}},
    {20,
     AXIS_DIGITAL_INPUTS_HOME,
     {{TOWARD, FAST, AXIS_DIGITAL_INPUTS_HOME, ON},
      {AWAY, FAST, AXIS_DIGITAL_INPUTS_HOME, OFF},
      {TOWARD, SLOW, AXIS_DIGITAL_INPUTS_HOME, ON}}},
    {21,
     AXIS_DIGITAL_INPUTS_HOME,
     {{AWAY, FAST, AXIS_DIGITAL_INPUTS_HOME, ON}, {TOWARD, SLOW, AXIS_DIGITAL_INPUTS_HOME, OFF}}},
    {22,
     AXIS_DIGITAL_INPUTS_HOME,
     {{AWAY, FAST, AXIS_DIGITAL_INPUTS_HOME, ON},
      {TOWARD, FAST, AXIS_DIGITAL_INPUTS_HOME, OFF},
      {AWAY, SLOW, AXIS_DIGITAL_INPUTS_HOME, ON}}},
    {33, AXIS_DIGITAL_INPUTS_INDEX, {{AWAY, SLOW, AXIS_DIGITAL_INPUTS_INDEX, ON}}},
    {34, AXIS_DIGITAL_INPUTS_INDEX, {{TOWARD, SLOW, AXIS_DIGITAL_INPUTS_INDEX, ON}}},
};
_Static_assert(METHODS == sizeof((drive_signals_t){0}.homing_methods),
               "60E3h has a place for each");

static bool is_fitted(const cia402_t *drive, const homing_method_t *method) {
  return (method->needs & ~(uint32_t)drive->params.inputs_fitted) == 0;
}

/* Returns the index of the homing method with the number `method`, or METHODS if this method is not
 * available. */
static uint8_t find(const cia402_t *drive, int32_t method) {
  for (uint8_t i = 0; i < METHODS; i++) {
    if (methods[i].method == method) {
      return is_fitted(drive, &methods[i]) ? i : (uint8_t)METHODS;
    }
  }
  return METHODS;
}

bool homing_is_offered(const cia402_t *drive, int32_t method) {
  return method == 0 || find(drive, method) < METHODS;
}

void homing_list(cia402_t *drive) {
  for (uint8_t i = 0; i < METHODS; i++) {
    drive->signals.homing_methods[i] = is_fitted(drive, &methods[i]) ? methods[i].method : 0;
  }
}

void homing_start(cia402_t *drive) { drive->homing.state = CIA402_HOMING_ASKED; }

static bool moves(uint8_t method) {
  return method < METHODS && methods[method].steps[0].direction != 0;
}

void homing_interrupt(cia402_t *drive) {
  const uint8_t state = drive->homing.state;
  const bool begins = state == CIA402_HOMING_ASKED || state == CIA402_HOMING_BEGUN;
  if (state == CIA402_HOMING_SEEKING ||
      (begins && moves(find(drive, drive->params.homing_method)))) {
    drive->homing.state = CIA402_HOMING_IDLE;
  }
}

static const homing_step_t *step_of(const cia402_t *drive) {
  return &methods[drive->homing.method].steps[drive->homing.step];
}

static trajectory_limits_t limits_of(const cia402_t *drive, uint8_t speed) {
  const int32_t rate = units_rate_q16(drive, drive->params.homing_acceleration);
  return (trajectory_limits_t){.speed = cia402_speed_q16(drive, drive->params.homing_speed[speed]),
                               .acceleration = rate,
                               .deceleration = rate};
}

static void brake(cia402_t *drive) {
  const trajectory_limits_t limits = cia402_limits(drive, 0);
  trajectory_ramp(&drive->trajectory, 0, &limits);
}

/* Stops the trajectory at the position of the axis, so that the trajectory is not ahead of the
 * axis. */
static void stand(cia402_t *drive, const axis_t *axis) {
  profile_set(&drive->trajectory, axis->signals.position);
}

/* Makes the encoder count of the latest tick the reference position. In user units the reference
 * position is home_offset. */
static void set_home(cia402_t *drive, const axis_t *axis) {
  drive->origin_cnt =
      fx_diff_wrap(cia402_count(drive, drive->params.home_offset), axis->signals.position);
  drive->position_written = 0; /* The target position is discarded, because it referred to the
                                * previous origin. */
  drive->homing.state = CIA402_HOMING_DONE;
  drive->homed = 1;
}

static uint32_t travel_since(const axis_t *axis, int32_t place_cnt) {
  return fx_magnitude(fx_diff_wrap(axis->signals.position, place_cnt));
}

static bool has_ended(const cia402_t *drive, const axis_t *axis, const homing_step_t *step) {
  switch (step->until) {
    case CONTACT:
      return drive->signals.contact != 0;
    case RETRACTED:
      return travel_since(axis, drive->homing.step_cnt) >= drive->params.homing_retract;
    default:
      return ((axis->signals.digital_inputs & step->until) != 0) == (step->level == ON);
  }
}

/* Returns true if a limit switch or a soft limit prevents a motion of the axis in this
 * direction. */
static bool is_blocked(const axis_t *axis, int8_t direction) {
  const uint8_t reason = axis->signals.limit_reason;
  const uint8_t inputs = axis->signals.digital_inputs;
  return (direction == TOWARD) ? (inputs & AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE) != 0 ||
                                     reason == AXIS_LIMIT_REASON_POSITION_MAX
                               : (inputs & AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE) != 0 ||
                                     reason == AXIS_LIMIT_REASON_POSITION_MIN;
}

/* Returns true if an obstacle blocks the axis. The axis is then behind its trajectory by more than
 * the travel in a quarter of a second. Without an obstacle this does not happen if the bandwidth of
 * the position loop is more than 4 rad/s. */
static bool is_behind(const cia402_t *drive, const axis_t *axis, int32_t speed_q16) {
  const int32_t place = fx_cnt_from_q32(drive->trajectory.position_q32);
  return travel_since(axis, place) > (uint32_t)fx_floor_shift(fx_per_s_from_q16(speed_q16), 2) + 16;
}

static bool is_pressed(const cia402_t *drive, const axis_t *axis) {
  const int32_t most = fx_ratio_apply(drive->params.force_limit, drive->reading_of_force, 0);
  return !fx_within(axis->signals.force, most);
}

/* Returns true if homing on contact has failed. It fails only while the axis moves towards the
 * workpiece, because the axis may always retract. */
static bool contact_fails(const cia402_t *drive, const axis_t *axis, const homing_step_t *step) {
  return step->until == CONTACT &&
         (is_pressed(drive, axis) ||
          (step->speed == SLOW &&
           fx_floor_shift((int32_t)travel_since(axis, drive->homing.step_cnt), 1) >
               (int32_t)drive->params.homing_retract));
}

static void fail(cia402_t *drive) { drive->homing.state = CIA402_HOMING_ERROR; }

static void begin_step(cia402_t *drive, const axis_t *axis, uint8_t step) {
  drive->homing.step = step;
  drive->homing.step_cnt = axis->signals.position;
}

static void end_step(cia402_t *drive, axis_t *axis, const homing_step_t *step) {
  const uint8_t next = (uint8_t)(drive->homing.step + 1);
  if (step->until == CONTACT || is_blocked(axis, step->direction)) {
    stand(drive, axis);
  } else {
    brake(drive);
  }
  if (step->until == RETRACTED && drive->signals.contact != 0) {
    fail(drive);
  } else if (next < STEPS && step[1].direction != 0) {
    begin_step(drive, axis, next);
  } else {
    set_home(drive, axis);
  }
}

static void seek(cia402_t *drive, axis_t *axis) {
  const homing_step_t *step = step_of(drive);
  const trajectory_limits_t limits = limits_of(drive, step->speed);
  drive->homing.remaining_tick -= 1;
  if (contact_fails(drive, axis, step)) {
    stand(drive, axis);
    fail(drive);
  } else if (has_ended(drive, axis, step)) {
    end_step(drive, axis, step);
  } else if (is_blocked(axis, step->direction) || is_behind(drive, axis, limits.speed)) {
    stand(drive, axis);
    fail(drive);
  } else if (drive->homing.remaining_tick == 0 ||
             travel_since(axis, drive->homing.start_cnt) > drive->params.homing_travel) {
    brake(drive);
    fail(drive);
  } else {
    trajectory_ramp(&drive->trajectory, (step->direction < 0) ? -limits.speed : limits.speed,
                    &limits);
  }
}

/* Starts a homing method as soon as the axis is at standstill. Methods 35 and 37 use the position
 * at standstill as the reference position. */
static void begin(cia402_t *drive, axis_t *axis) {
  brake(drive);
  if (!motion_stands(drive)) {
    return;
  }
  const uint8_t method = find(drive, drive->params.homing_method);
  if (method == METHODS) {
    fail(drive);
  } else if (!moves(method)) {
    set_home(drive, axis);
  } else {
    drive->homing.state = CIA402_HOMING_SEEKING;
    drive->homing.method = method;
    drive->homing.start_cnt = axis->signals.position;
    drive->homing.remaining_tick = fx_ticks_from_ms(drive->params.homing_timeout);
    begin_step(drive, axis, 0);
  }
}

void homing_run(cia402_t *drive, axis_t *axis) {
  switch (drive->homing.state) {
    case CIA402_HOMING_BEGUN:
      begin(drive, axis);
      break;
    case CIA402_HOMING_SEEKING:
      seek(drive, axis);
      break;
    default:
      brake(drive);
      break;
  }
}
