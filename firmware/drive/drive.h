#ifndef FIRMWARE_DRIVE_DRIVE_H_
#define FIRMWARE_DRIVE_DRIVE_H_

/* The CiA 402 drive profile of one axis: state machine, modes of operation and trajectories. The
 * drive writes mode and set-points of the axis before a tick and reads its signals after the tick.
 *
 * The user owns the parameters of the axis. The drive overrides some of them for a tick
 * (set-points, raw_step, a step instead of a bump bias): it writes them before axis_tick() and
 * restores them after it, so that between ticks they have the values that were written. Only `mode`
 * shows what the drive commands, and after a change to mode -4 position_setpoint is the last demand
 * of the drive.
 *
 * A target acts only if it was written for its present use: a target position after cyclic position
 * mode last ended, halted or was homed; a target velocity or force after the last fault. Until then
 * the axis stays at its position.
 *
 * While the first motion test runs, drive_state is operation_enabled, because the power stage is
 * on, but the statusword reports switched on: no target acts, and every stop disables the axis at
 * once instead of along a ramp, which would need the position law.
 *
 * Cost: cia402_before() and cia402_after() together need at most 1000 instructions on a Cortex-M4;
 * the other functions run between ticks and are bounded too. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/drive/shaper.h"
#include "firmware/fx/fx.h"
#include "firmware/guard/guards.h"

/* States of homing: requested by the controlword; begun, when the axis is at standstill; searching
 * the reference position; done; failed. */
enum {
  CIA402_HOMING_IDLE = 0,
  CIA402_HOMING_ASKED = 1,
  CIA402_HOMING_BEGUN = 2,
  CIA402_HOMING_SEEKING = 3,
  CIA402_HOMING_DONE = 4,
  CIA402_HOMING_ERROR = 5
};

/* Whether the axis follows the trajectory, or the force laws only use the trajectory as a reference
 * for the motion of the axis. */
enum { CIA402_TRACKING_NONE = 0, CIA402_TRACKING_AXIS = 1, CIA402_TRACKING_VIRTUAL = 2 };

/* Longest time of a ramp to standstill: 10 s. It applies to quick stop, fault reaction, shutdown,
 * disable operation, halt and a change of mode. If the deceleration is too small for this time, the
 * ramp is steeper; its longest travel is speed times 5 s. If the axis does not follow the ramp, it
 * is switched off in its present motion. */
enum { CIA402_STOPPING_TICKS = 15000 };

/* Value of `slowing` in a tick of a ramp to standstill; in the next tick `slowing` is 1. */
enum { CIA402_SLOWING = 2 };

/* Number of ticks over which velocity_actual is averaged. */
enum { CIA402_MEAN_TICKS = 16 };

/* A set-point of profile position mode or of a guarded move. */
typedef struct {
  int32_t position; /* position in user units, as it was written */
  uint32_t speed;   /* user's units per second */
} cia402_setpoint_t;

typedef struct {
  int32_t start_cnt;       /* encoder count at which homing began */
  int32_t step_cnt;        /* encoder count at which the present step of homing began */
  uint32_t remaining_tick; /* ticks that remain of homing_timeout */
  uint8_t state;           /* CIA402_HOMING_ */
  uint8_t method;          /* index of the method and of its step in homing.c */
  uint8_t step;
} cia402_homing_t;

/* The user units, derived from 608Fh, 6091h and 6092h (units.h). */
typedef struct {
  fx_fraction_t user_of_cnt; /* user units in a count; valid only if `scaled` is 1 */
  fx_ratio_t speed_of_user;  /* Q16 counts per tick in one user unit per second */
  fx_ratio_t rate_of_user;   /* Q16 counts per tick squared in one user unit per second squared */
  uint8_t scaled;            /* 0: the user unit is the encoder count */
} cia402_units_t;

/* Bounds of the demanded force: force_limit, or the limit of the direction if it is smaller; and
 * the force permitted to a force law without a certificate. */
typedef struct {
  int32_t least;    /* lower bound in per mille of the rated force, -32767..0 */
  int32_t most;     /* upper bound in per mille of the rated force, 0..32767 */
  int32_t least_q8; /* lower bound as a measured force in 1/256 count */
  int32_t most_q8;
  /* bound of the force set-point of mode -1 without a certificate, in 1/256 count; mode -1 has no
   * other bound */
  int32_t law_q8;
} cia402_force_bounds_t;

/* Stored values of the parameters of the axis that the drive overrides for the tick. */
typedef struct {
  int32_t position_setpoint;
  int32_t force_setpoint;
  int16_t open_loop_code;
  uint16_t output_limit;
  uint8_t profile_enable;
  uint8_t bump_decay_shift;
  uint8_t active; /* 1: the drive overrides these parameters of the axis now */
} cia402_overridden_t;

typedef struct cia402_mode cia402_mode_t; /* a row of modes.h */

/* State of the drive. A copy of this structure is a copy of the drive. Signals are those of the
 * latest tick. In every second tick the drive computes the forces, current_actual, velocity_sensor
 * and drive_inputs; in the other ticks it computes velocity_actual and checks whether the target is
 * reached and the axis is at standstill. */
typedef struct {
  drive_params_t params;
  drive_signals_t signals;
  const cia402_mode_t *mode; /* row of the mode in modes_of_operation_display */
  profile_t trajectory;      /* trajectory in encoder counts; valid unless tracking is none */
  /* trajectory after input shaping, valid once motion_shaper has begun */
  profile_t shaped;
  /* count of the user position minus encoder count, before the polarity is applied */
  int32_t origin_cnt;
  /* lead of the axis before its trajectory in counts, from velocity_offset */
  int32_t lead_cnt;
  cia402_units_t units;
  /* Limits of the trajectory in Q16 counts per tick and per tick squared, derived from the
   * parameters. */
  int32_t speed_max;
  int32_t acceleration;
  int32_t deceleration;
  int32_t quick_deceleration;
  /* smallest decrease per tick of the present ramp to standstill, so that the ramp ends in time */
  int32_t stop_step;
  /* counts/256 of measured force in one per mille of the rated force */
  fx_ratio_t reading_of_force;
  fx_ratio_t force_of_reading; /* per mille of the rated force in one measured count/256 */
  cia402_force_bounds_t force_bounds;
  /* bound of the demanded force without a certificate, in per mille of force_limit */
  uint16_t law_force;
  uint16_t law_output;        /* bound of the DAC code of the force law without a certificate */
  int32_t force_ramp_q16;     /* demanded force after the ramp, in per mille, Q16 */
  int32_t force_demand_q16;   /* demanded force after ramp and input shaping, in per mille, Q16 */
  cia402_setpoint_t setpoint; /* active or last set-point of profile position mode */
  cia402_setpoint_t buffered; /* next set-point of profile position mode */
  uint32_t dwell_remaining;   /* ticks for which the force law still acts after a loss of contact */
  uint32_t interpolation_remaining; /* ticks until the cyclic target is to be reached */
  /* ticks for which the following error has been outside its window */
  uint32_t outside_tick;
  uint32_t reached_tick;  /* ticks for which the target has been reached */
  uint32_t standing_tick; /* ticks for which the axis has been at standstill */
  /* counts travelled in the last CIA402_MEAN_TICKS ticks, modulo 2^32 */
  int32_t velocity_sum;
  int32_t velocities[CIA402_MEAN_TICKS];
  /* shaper of the force demand: in modes 4 and 10 in per mille, Q16; in mode -1 in 1/256 count */
  shaper_t force_shaper;
  shaper_t motion_shaper; /* shaper of the speed of the trajectory */
  guards_t guards;
  cia402_homing_t homing;
  cia402_overridden_t overridden;
  uint8_t velocity_next;     /* slot of the oldest velocity sample */
  uint8_t tracking;          /* CIA402_TRACKING_ */
  uint8_t setpoint_active;   /* 1: the drive moves to `setpoint` */
  uint8_t setpoint_buffered; /* 1: `buffered` has a set-point that the drive has not started yet */
  uint8_t acknowledged;      /* 1: the new set-point of this controlword was accepted */
  /* ticks for which the trajectory has been at standstill at the end of a ramp */
  uint8_t settling_tick;
  uint16_t stopping_tick; /* ticks since a quick stop or fault reaction began */
  uint8_t slowing;        /* not 0: the last tick belonged to a ramp to standstill */
  /* 1: a ramp to standstill runs, and the drive then changes to leaving_to */
  uint8_t leaving;
  uint8_t leaving_to;         /* AXIS_DRIVE_STATE_ */
  uint8_t fault;              /* AXIS_FAULT_ that is latched when the fault reaction ends */
  uint8_t controlled;         /* 1: a force mode was active in the last tick */
  uint8_t pressing;           /* 1: the force law is active in mode 4 or 10 */
  int8_t pressed;             /* sign of the measured force at the latest contact in mode 4 or 10 */
  uint8_t stopped_by_contact; /* 1: the guarded move ended at the workpiece */
  uint8_t limited;            /* 1: the drive has limited a target to a bound */
  /* 1: the force law has no certificate, so the bounds law_force and law_output apply */
  uint8_t uncertified;
  /* 1: the bounds law_force and law_output act in this tick; this is decided in every second
   * tick */
  uint8_t restricted;
  /* 1: the axis was enabled by an owner whose loss no watchdog or heartbeat would detect */
  uint8_t unsupervised;
  /* 1: target_position was written for its present use; the next fields say the same of other
   * targets */
  uint8_t position_written;
  uint8_t velocity_written;
  uint8_t force_written;
} cia402_t;

/* Sets the state of the drive at power-up: default parameters, state switch on disabled. */
void cia402_init(cia402_t *drive);

/* Adopts the state of an axis that ran without its drive, and the stored parameters. Call it before
 * the first tick of the drive. */
void cia402_wake(cia402_t *drive, const axis_t *axis);

/* The steps of the drive in a tick. Before axis_tick(): the first function sets the targets, the
 * second one the values that depend on the inputs. After axis_tick(): the third function reads the
 * signals. */
void cia402_before(cia402_t *drive, axis_t *axis);
static inline void cia402_with_inputs(cia402_t *drive, axis_t *axis, const axis_inputs_t *inputs) {
  guards_limit(&drive->guards, &drive->params, &drive->signals, axis, inputs);
}
void cia402_after(cia402_t *drive, axis_t *axis);

/* Call it after axis_tick() and before the outputs are written. If a sensor value of this tick is a
 * fault, it sets the outputs to the safe state. */
static inline void cia402_control(cia402_t *drive, axis_t *axis, axis_outputs_t *outputs) {
  guards_check(&drive->guards, &drive->params, &drive->signals, axis, outputs);
}

/* Whether a value within its range may be written to an object of the drive: FW_OK or
 * FW_ERROR_RANGE. */
int cia402_check(const cia402_t *drive, uint16_t object, int32_t value);

/* Acts on a write to an object of the drive, whose value was `previous` and now is `value`. A
 * controlword is carried out here. */
void cia402_written(cia402_t *drive, axis_t *axis, uint16_t object, int32_t previous,
                    int32_t value);

/* Acts on a write to excitation_run, which starts or stops the excitation: FW_OK or
 * FW_ERROR_STATE. */
int cia402_excite(cia402_t *drive, const axis_t *axis, bool start);

/* Acts on a controlword of a source that does not own the axis and may only stop it. Only halt and
 * a transition to a lower state are carried out; the controlword of the owner stays active, except
 * for its halt bit. Returns false if the axis cannot move and there is nothing to stop. */
bool cia402_stop(cia402_t *drive, axis_t *axis, uint16_t controlword);

/* Reports in stopped_by (AXIS_STOPPED_BY_) which source stopped the axis, until a controlword is
 * carried out or a native mode is active. Returns false if stopped_by already names a source. */
bool cia402_hold(cia402_t *drive, const axis_t *axis, uint8_t by);

/* Whether a controlword would enable an axis that is not enabled, or that is about to be
 * disabled. */
bool cia402_would_enable(const cia402_t *drive, uint16_t controlword);

/* Whether a controlword would stop the axis: by a change of state, or by a halt bit that `previous`
 * did not have. */
bool cia402_would_stop(const cia402_t *drive, uint16_t controlword, uint16_t previous);

/* Sets the warning that the loss of the owner would not be detected while the axis is enabled;
 * clears it if `unsupervised` is false. */
void cia402_warn_unsupervised(cia402_t *drive, const axis_t *axis, bool unsupervised);

/* Restricts a force law without a certificate, or removes the restriction. While restricted, every
 * mode that controls force limits the demanded force to `force` per mille of force_limit and the
 * code of the law to +-`output`, and shows a warning. */
void cia402_restrict_law(cia402_t *drive, uint16_t force, uint16_t output);
void cia402_release_law(cia402_t *drive);

/* The port itself has written the native `mode`: adapts the drive state to it. */
void cia402_native_mode(cia402_t *drive, axis_t *axis, uint8_t mode);

/* Resets a fault without the controlword. Returns FW_OK, or FW_ERROR_STATE if the latched fault has
 * not acted in a tick yet. */
int cia402_fault_reset(cia402_t *drive, axis_t *axis);

/* Discards the targets of the drive modes: they do not act until they are written again. Their
 * offsets become 0. */
void cia402_forget_targets(cia402_t *drive);

/* The owner of the axis is lost: if the axis is enabled, carries out abort_connection_option with
 * the fault `fault`. Unless the option lets the axis continue, the commands of the owner are
 * discarded. Returns whether the axis had to be stopped. */
bool cia402_owner_lost(cia402_t *drive, axis_t *axis, uint8_t fault);

/* Returns the code of a fault (AXIS_FAULT_) for error_code and for emergency messages. */
uint16_t cia402_error_code(uint8_t fault);

#endif
