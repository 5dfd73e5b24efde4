#ifndef FIRMWARE_DRIVE_DRIVE_H_
#define FIRMWARE_DRIVE_DRIVE_H_

/* The CiA 402 drive profile over one axis: state machine, modes of operation, trajectories. It
 * writes the axis' mode and set-points before a tick and reads its signals after it.
 *
 * Parameters of the axis stay the user's. What the drive needs to put there for a tick (set-points,
 * raw_step, a step instead of a bump bias) overrides them: written before axis_tick() and restored
 * after it, so that between ticks they read as they were written. Only `mode` shows what the drive
 * commands, and at a change to mode -4 position_setpoint is the drive's last demand.
 *
 * A target acts only if it was written for what uses it: a target position since cyclic position
 * was last exited, halted or homed, target velocity and force since the last fault. Until then the
 * axis stays where it is.
 *
 * While the test before the first motion runs, drive_state is operation_enabled, since the power
 * stage is on, but the statusword shows switched on: no target is acted on, and every stop disables
 * the axis at once instead of along a ramp, which would need the position law.
 *
 * Cost: cia402_before() and cia402_after() together at most 1000 instructions on a Cortex-M4; the
 * others run between ticks and are bounded too. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/drive/shaper.h"
#include "firmware/fx/fx.h"
#include "firmware/guard/guards.h"

/* Homing: requested by the controlword; begun, once the axis stands; seeking its place; done or
 * failed. */
enum {
  CIA402_HOMING_IDLE = 0,
  CIA402_HOMING_ASKED = 1,
  CIA402_HOMING_BEGUN = 2,
  CIA402_HOMING_SEEKING = 3,
  CIA402_HOMING_DONE = 4,
  CIA402_HOMING_ERROR = 5
};

/* Whether the trajectory moves the axis, or only what the force laws measure the axis against. */
enum { CIA402_TRACKING_NONE = 0, CIA402_TRACKING_AXIS = 1, CIA402_TRACKING_VIRTUAL = 2 };

/* Every ramp to a stand (quick stop, fault reaction, shutdown, disable operation, halt, another
 * mode) takes 10 s at most: where the deceleration is too small for it, the ramp is steeper, so
 * that speed times 5 s is the longest way. An axis that does not follow it is switched off as it
 * is. */
enum { CIA402_STOPPING_TICKS = 15000 };

/* The value of `slowing` in a tick of a ramp to a stand; in the tick after it, it is 1. */
enum { CIA402_SLOWING = 2 };

/* The mean of velocity_actual. */
enum { CIA402_MEAN_TICKS = 16 };

/* Of a set-point of profile position or guarded move. */
typedef struct {
  int32_t position; /* as written, in user's units */
  uint32_t speed;   /* user's units per second */
} cia402_setpoint_t;

typedef struct {
  int32_t start_cnt;       /* where homing began */
  int32_t step_cnt;        /* where its present step began */
  uint32_t remaining_tick; /* of homing_timeout */
  uint8_t state;           /* CIA402_HOMING_ */
  uint8_t method;          /* row and step of homing.c */
  uint8_t step;
} cia402_homing_t;

/* The user's units, derived from 608Fh, 6091h and 6092h (units.h). */
typedef struct {
  fx_fraction_t user_of_cnt; /* user's units in a count; only if scaled */
  fx_ratio_t speed_of_user;  /* Q16 per tick in a user's unit per second */
  fx_ratio_t rate_of_user;   /* Q16 per tick squared in a user's unit per second squared */
  uint8_t scaled;            /* 0: the user's unit is the count */
} cia402_units_t;

/* Of the demanded force: force_limit, or the smaller limit of that direction; and what is permitted
 * to a law without a certificate. */
typedef struct {
  int32_t least;    /* per mille, -32767..0 */
  int32_t most;     /* 0..32767 */
  int32_t least_q8; /* the same as a reading, 1/256 count */
  int32_t most_q8;
  int32_t law_q8; /* without a certificate, of mode -1, which has no other bound */
} cia402_force_bounds_t;

/* The axis' parameters that are overridden for the tick, as they are stored. */
typedef struct {
  int32_t position_setpoint;
  int32_t force_setpoint;
  int16_t open_loop_code;
  uint16_t output_limit;
  uint8_t profile_enable;
  uint8_t bump_decay_shift;
  uint8_t active; /* 1: they are overridden */
} cia402_overridden_t;

typedef struct cia402_mode cia402_mode_t; /* a row of modes.h */

/* Copying it copies the drive. Signals are those of the latest tick; but the forces,
 * current_actual, velocity_sensor and drive_inputs are made anew in every second tick only, and in
 * the others velocity_actual, and it is judged whether the target is reached and the axis stands.
 */
typedef struct {
  drive_params_t params;
  drive_signals_t signals;
  const cia402_mode_t *mode; /* the row of modes_of_operation_display */
  profile_t trajectory;      /* in encoder counts; holds unless tracking is none */
  profile_t shaped;          /* the same, shaped, once motion_shaper has begun */
  int32_t origin_cnt;        /* count of the user's position minus encoder count, before
                                polarity */
  int32_t lead_cnt;          /* of the axis before its trajectory, for velocity_offset */
  cia402_units_t units;
  /* Parameters in the units of the trajectory, Q16 per tick and per tick squared. */
  int32_t speed_max;
  int32_t acceleration;
  int32_t deceleration;
  int32_t quick_deceleration;
  int32_t stop_step; /* least step of the ramp to a stand under way, so that it ends in time */
  fx_ratio_t reading_of_force; /* 1/256 count of the reading per per mille */
  fx_ratio_t force_of_reading; /* and back */
  cia402_force_bounds_t force_bounds;
  uint16_t law_force;         /* bound of the force that is asked for, per mille of force_limit */
  uint16_t law_output;        /* bound of the code that the law puts out */
  int32_t force_ramp_q16;     /* per mille, Q16 */
  int32_t force_demand_q16;   /* the same, shaped */
  cia402_setpoint_t setpoint; /* being pursued, or pursued last */
  cia402_setpoint_t buffered; /* the one after it */
  uint32_t dwell_remaining;   /* ticks that the force law goes on without contact */
  uint32_t interpolation_remaining; /* ticks until the cyclic target is to be reached */
  uint32_t outside_tick;            /* ticks that the following error was outside its window */
  uint32_t reached_tick;            /* ticks that the target has been reached */
  uint32_t standing_tick;           /* ticks that the axis has stood */
  int32_t velocity_sum;             /* counts in the last CIA402_MEAN_TICKS ticks, modulo 2^32 */
  int32_t velocities[CIA402_MEAN_TICKS];
  shaper_t force_shaper;  /* of modes 4 and 10 in per mille, Q16; of mode -1 in 1/256 count */
  shaper_t motion_shaper; /* of the trajectory's speed */
  guards_t guards;
  cia402_homing_t homing;
  cia402_overridden_t overridden;
  uint8_t velocity_next;      /* slot of the oldest */
  uint8_t tracking;           /* CIA402_TRACKING_ */
  uint8_t setpoint_active;    /* 1: setpoint is being pursued */
  uint8_t setpoint_buffered;  /* 1: buffered holds one */
  uint8_t acknowledged;       /* 1: the new set-point of this controlword was taken */
  uint8_t settling_tick;      /* ticks that the trajectory has stood in slowing down */
  uint16_t stopping_tick;     /* ticks of a quick stop or fault reaction */
  uint8_t slowing;            /* not 0: a ramp to a stand was under way in the last tick */
  uint8_t leaving;            /* 1: slows down to change to leaving_to */
  uint8_t leaving_to;         /* AXIS_DRIVE_STATE_ */
  uint8_t fault;              /* AXIS_FAULT_ that the fault reaction will latch */
  uint8_t controlled;         /* 1: a force mode was on in the last tick */
  uint8_t pressing;           /* 1: the force law is on in tq, cst */
  int8_t pressed;             /* there: sign of the reading at the latest contact */
  uint8_t stopped_by_contact; /* 1: the guarded move ended at the workpiece */
  uint8_t limited;            /* 1: a bound of the drive has limited a target */
  uint8_t uncertified;        /* 1: the force law has no certificate; law_force, law_output apply */
  uint8_t restricted;         /* 1: they apply; judged in every second tick */
  uint8_t unsupervised;       /* 1: enabled for an owner whose end nobody would notice */
  uint8_t position_written;   /* 1: the target was written for what uses it; and so on */
  uint8_t velocity_written;
  uint8_t force_written;
} cia402_t;

/* Power-up: parameters at their defaults, switch on disabled. */
void cia402_init(cia402_t *drive);

/* Adopts the state of an axis that ran without its drive, and stored parameters; to be called
 * before the first tick of the drive. */
void cia402_wake(cia402_t *drive, const axis_t *axis);

/* Before axis_tick(): the targets of the tick; then what depends on its inputs; and after it. */
void cia402_before(cia402_t *drive, axis_t *axis);
static inline void cia402_with_inputs(cia402_t *drive, axis_t *axis, const axis_inputs_t *inputs) {
  guards_limit(&drive->guards, &drive->params, &drive->signals, axis, inputs);
}
void cia402_after(cia402_t *drive, axis_t *axis);

/* After axis_tick(), before its outputs are put out: takes them back where a reading of this tick
 * is a fault. */
static inline void cia402_control(cia402_t *drive, axis_t *axis, axis_outputs_t *outputs) {
  guards_check(&drive->guards, &drive->params, &drive->signals, axis, outputs);
}

/* Whether a value within its range may be written to an object of the drive: FW_OK or
 * FW_ERROR_RANGE. */
int cia402_check(const cia402_t *drive, uint16_t object, int32_t value);

/* An object of the drive was `previous` and now is `value`; a controlword is carried out here. */
void cia402_written(cia402_t *drive, axis_t *axis, uint16_t object, int32_t previous,
                    int32_t value);

/* excitation_run was written: FW_OK or FW_ERROR_STATE. */
int cia402_excite(cia402_t *drive, const axis_t *axis, bool start);

/* Somebody who may only stop the axis wrote a controlword: of what it asks for, halt and the way to
 * a lower state are carried out; the controlword in force stays, but for the halt bit. False: the
 * axis cannot move, and nothing is to be stopped. */
bool cia402_stop(cia402_t *drive, axis_t *axis, uint16_t controlword);

/* Shows who stopped the axis (AXIS_STOPPED_BY_), until a controlword is carried out or a native
 * mode is on. False: somebody is shown already. */
bool cia402_hold(cia402_t *drive, const axis_t *axis, uint8_t by);

/* Whether a controlword would enable an axis that is not, or no longer to be, enabled. */
bool cia402_would_enable(const cia402_t *drive, uint16_t controlword);

/* Whether it would stop the axis, by its state or by a halt that `previous` did not have. */
bool cia402_would_stop(const cia402_t *drive, uint16_t controlword, uint16_t previous);

/* The warning that nobody would notice the end of the owner, while the axis is enabled. */
void cia402_warn_unsupervised(cia402_t *drive, const axis_t *axis, bool unsupervised);

/* The force law has no certificate: in every mode that controls force what is asked for is bounded
 * to `force` per mille of force_limit and the output of the law to a code of +-`output`, with a
 * warning. And: it has one. */
void cia402_restrict_law(cia402_t *drive, uint16_t force, uint16_t output);
void cia402_release_law(cia402_t *drive);

/* The native `mode` was written (by the port itself): the state follows. */
void cia402_native_mode(cia402_t *drive, axis_t *axis, uint8_t mode);

/* fault_reset was given outside the controlword: FW_OK, or FW_ERROR_STATE while the fault still
 * waits for its tick. */
int cia402_fault_reset(cia402_t *drive, axis_t *axis);

/* Targets written for the modes of the drive do not act until they are written again; their offsets
 * are 0. */
void cia402_forget_targets(cia402_t *drive);

/* The owner of the axis is lost: carries out abort_connection_option, with this fault, if the axis
 * is enabled; whether there was anything to do. The owner's commands are discarded, unless the axis
 * is to continue. */
bool cia402_owner_lost(cia402_t *drive, axis_t *axis, uint8_t fault);

/* Code of a fault (AXIS_FAULT_) for error_code and for emergencies. */
uint16_t cia402_error_code(uint8_t fault);

#endif
