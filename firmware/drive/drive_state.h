#ifndef FIRMWARE_DRIVE_DRIVE_STATE_H_
#define FIRMWARE_DRIVE_DRIVE_STATE_H_

/* The state of a drive (drive.h). All files of this folder share this state. */

#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/cycle/cycle.h"
#include "firmware/drive/shaper.h"
#include "firmware/fx/fx.h"
#include "firmware/guard/guards.h"

/* States of homing, in this order: idle, requested by the controlword, waiting for standstill of
 * the axis, searching the reference position, done, failed. */
enum {
  CIA402_HOMING_IDLE = 0,
  CIA402_HOMING_ASKED = 1,
  CIA402_HOMING_BEGUN = 2,
  CIA402_HOMING_SEEKING = 3,
  CIA402_HOMING_DONE = 4,
  CIA402_HOMING_ERROR = 5
};

/* Use of the trajectory: not used, followed by the axis, or virtual. A virtual trajectory is only a
 * reference from which the force laws compute errors of position and velocity. */
enum { CIA402_TRACKING_NONE = 0, CIA402_TRACKING_AXIS = 1, CIA402_TRACKING_VIRTUAL = 2 };

/* Longest duration of a ramp to standstill: 10 s. This bound applies to quick stop, fault reaction,
 * shutdown, disable operation, halt and a change of mode. If the deceleration is too small for this
 * duration, the drive uses a larger deceleration. The travel of the ramp is at most its initial
 * speed times 5 s. If the axis does not follow the ramp, the axis is switched off in motion. */
enum { CIA402_STOPPING_TICKS = 15000 };

/* The field `slowing` has the value CIA402_SLOWING in a tick in which a ramp to standstill is
 * active. In the next tick it is 1. */
enum { CIA402_SLOWING = 2 };

/* Number of ticks over which velocity_actual is averaged. */
enum { CIA402_MEAN_TICKS = 16 };

/* A position set-point of profile position mode or of a guarded move (a move that ends at a
 * contact). */
typedef struct {
  int32_t position; /* target position in user units, as the client has written it */
  uint32_t speed;   /* profile velocity of the set-point in user units per second */
} cia402_setpoint_t;

typedef struct {
  int32_t start_cnt;       /* encoder count at which homing began */
  int32_t step_cnt;        /* encoder count at the start of the present step of homing */
  uint32_t remaining_tick; /* number of ticks that remain until homing_timeout */
  uint8_t state;           /* state of homing, CIA402_HOMING_ */
  /* index of the homing method in homing.c; `step`: index of the present step of this method */
  uint8_t method;
  uint8_t step;
} cia402_homing_t;

/* Conversion factors between user units and encoder counts. They are computed from 608Fh, 6091h and
 * 6092h (units.h). */
typedef struct {
  /* number of user units per encoder count; valid only if the field `scaled` is not 0 */
  fx_fraction_t user_of_cnt;
  fx_ratio_t speed_of_user; /* one user unit per second as a speed in Q16 counts per tick */
  /* one user unit per second squared as an acceleration in Q16 counts per tick squared */
  fx_ratio_t rate_of_user;
  uint8_t scaled; /* 0 if the user unit is the encoder count, so that no conversion is needed */
} cia402_units_t;

/* Bounds of the demanded force. Each bound is the smaller one of force_limit and the limit for the
 * direction of the force. A force law without a certificate has an additional, smaller bound. */
typedef struct {
  int32_t least; /* lower bound of the demanded force in per mille of the rated force, -32767..0 */
  int32_t most;  /* upper bound of the demanded force in per mille of the rated force, 0..32767 */
  int32_t least_q8; /* lower bound of the demanded force in 1/256 count of measured force */
  int32_t most_q8;
  /* bound of the force set-point of mode -1 if the force law has no certificate, in 1/256 count of
   * measured force; mode -1 has no other bound */
  int32_t law_q8;
} cia402_force_bounds_t;

/* Copy of the parameters that the drive overrides during a tick, with the values that the user has
 * written. After the tick the drive restores the parameters from this copy. */
typedef struct {
  int32_t position_setpoint;
  int32_t force_setpoint;
  int16_t open_loop_code;
  uint8_t profile_enable;
  uint8_t bump_decay_shift;
  uint8_t active; /* 1 while the drive overrides the parameters whose values are saved here */
} cia402_overridden_t;

typedef struct cia402_mode cia402_mode_t; /* one row of the table of modes of operation (modes.h) */

/* State of the drive. A copy of this structure is a copy of the drive. The signals belong to the
 * latest tick. In every second tick the drive computes the forces, current_actual, velocity_sensor
 * and drive_inputs. In the other ticks the drive computes velocity_actual, and checks whether the
 * target is reached and whether the axis is at standstill. */
typedef struct {
  drive_params_t params;
  drive_signals_t signals;
  /* row of the active mode of operation in the table of modes */
  const cia402_mode_t *mode;
  profile_t trajectory; /* trajectory in encoder counts; valid unless `tracking` is none */
  /* trajectory after input shaping; valid after the first step of motion_shaper */
  profile_t shaped;
  /* origin of the user positions in counts: position before the polarity is applied, minus encoder
   * count */
  int32_t origin_cnt;
  /* distance in counts by which the position set-point leads the trajectory because of
   * velocity_offset */
  int32_t lead_cnt;
  cia402_units_t units;
  /* Limits of the trajectory, computed from the parameters: speed in Q16 counts per tick,
   * acceleration and decelerations in Q16 counts per tick squared. */
  int32_t speed_max;
  int32_t acceleration;
  int32_t deceleration;
  int32_t quick_deceleration;
  /* smallest decrease per tick, of the speed or of the force, with which the present ramp to
   * standstill ends in time */
  int32_t stop_step;
  /* factor that converts a force in per mille of the rated force to 1/256 count of measured
   * force */
  fx_ratio_t reading_of_force;
  /* factor that converts 1/256 count of measured force to a force in per mille of the rated
   * force */
  fx_ratio_t force_of_reading;
  cia402_force_bounds_t force_bounds;
  /* bound of the demanded force for a force law without a certificate, in per mille of
   * force_limit */
  uint16_t law_force;
  /* bound of the magnitude of the DAC code for a force law without a certificate */
  uint16_t law_output;
  int32_t force_ramp_q16; /* demanded force after the ramp, in Q16 per mille of the rated force */
  /* demanded force after ramp and input shaping, in Q16 per mille of the rated force */
  int32_t force_demand_q16;
  cia402_setpoint_t setpoint; /* active or last set-point of profile position mode */
  cia402_setpoint_t buffered; /* next set-point of profile position mode */
  /* number of ticks for which the force law will remain active after a contact loss */
  uint32_t dwell_remaining;
  /* number of ticks until the axis must reach the target of cyclic position mode */
  uint32_t interpolation_remaining;
  /* number of ticks for which the following error has been outside its window */
  uint32_t outside_tick;
  uint32_t reached_tick;  /* number of ticks for which the target has been reached */
  uint32_t standing_tick; /* number of ticks for which the axis has been at standstill */
  /* sum of the travel in the last CIA402_MEAN_TICKS ticks, in counts, modulo 2^32 */
  int32_t velocity_sum;
  int32_t velocities[CIA402_MEAN_TICKS];
  /* input shaper of the demanded force. Its values are in Q16 per mille of the rated force in modes
   * 4 and 10, and in 1/256 count in mode -1 */
  shaper_t force_shaper;
  shaper_t motion_shaper; /* input shaper of the speed of the trajectory */
  guards_t guards;
  cia402_homing_t homing;
  cycle_t cycle; /* press cycle of mode -9 */
  /* selected cycle program; it has passed its check. NULL: no program */
  const cycle_header_t *program;
  /* reason (AXIS_CYCLE_STATE_) why the firmware permits no start of a cycle; idle: a start is
   * permitted */
  uint8_t cycle_lock;
  /* offset of the force that a tare of the cycle has measured, in 1/256 per mille of the rated
   * force */
  int32_t cycle_offset_q8;
  /* reason (AXIS_CYCLE_STATE_) why the last start of a cycle was refused; idle: it was not
   * refused */
  uint8_t cycle_refusal;
  /* CRC of the selected filter bank of the force law; 0: no bank is selected */
  uint32_t law_crc;
  /* CRC of the active filter bank at the start of the cycle, from cycle_mode_bank() */
  uint32_t cycle_bank_crc;
  cia402_overridden_t overridden;
  uint8_t velocity_next;   /* index of the oldest velocity sample in `velocities` */
  uint8_t tracking;        /* how the trajectory is used, a CIA402_TRACKING_ value */
  uint8_t setpoint_active; /* 1 if the drive moves to the position in `setpoint` */
  /* 1 if `buffered` contains a set-point that the drive has not started yet */
  uint8_t setpoint_buffered;
  /* 1 if the drive has accepted the new set-point of the present controlword */
  uint8_t acknowledged;
  /* number of ticks for which the trajectory has been at standstill at the end of a ramp */
  uint8_t settling_tick;
  uint16_t stopping_tick; /* number of ticks since a quick stop or fault reaction began */
  uint8_t slowing;        /* 1 or more if a ramp to standstill was active in the last tick */
  /* 1 if a ramp to standstill is active and the drive changes to the state leaving_to after this
   * ramp */
  uint8_t leaving;
  /* state (AXIS_DRIVE_STATE_) to which the drive changes when `leaving` is 1 and the ramp has
   * ended */
  uint8_t leaving_to;
  uint8_t fault; /* fault (AXIS_FAULT_) that is latched at the end of the fault reaction */
  /* 1 after homing has found the reference position; 0 again when the sensors become invalid */
  uint8_t homed;
  uint8_t controlled; /* 1 if a force mode was active in the last tick */
  uint8_t pressing;   /* 1 if the force law is active in mode 4 or 10 */
  int8_t pressed;     /* sign of the measured force at the latest contact in mode 4 or 10 */
  /* 1 if the guarded move ended because the axis touched the workpiece */
  uint8_t stopped_by_contact;
  uint8_t limited; /* 1 if a target exceeded a bound, so that the drive has limited the target */
  /* 1 if the force law has no certificate, so that the bounds law_force and law_output apply */
  uint8_t uncertified;
  /* 1 if the bounds law_force and law_output act in this tick; updated in every second tick */
  uint8_t restricted;
  /* 1 if neither a watchdog nor a heartbeat would detect the loss of the owner that enabled the
   * axis */
  uint8_t unsupervised;
  /* position_written, velocity_written, force_written: 1 if the target was written since it was
   * last discarded. Otherwise the target does not act */
  uint8_t position_written;
  uint8_t velocity_written;
  uint8_t force_written;
} cia402_t;

#endif
