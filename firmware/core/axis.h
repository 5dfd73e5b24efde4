#ifndef FIRMWARE_CORE_AXIS_H_
#define FIRMWARE_CORE_AXIS_H_

/* One axis: counts in, codes out, once per tick of 1/1500 s.
 *
 * axis_tick() is the whole loop. It is a pure function of the state, the inputs and nothing else:
 * no heap, no floating point, no input or output, bounded time (docs/chip/instructions.md has
 * the number of instructions, tests/chip/test_budget.py its limit). The caller owns the state, so
 * any number of axes can run side by side.
 *
 * Parameters are the fields of axis->params and signals those of axis->signals, both generated from
 * firmware/objects/axis_objects.toml. Signals may be read between ticks. Parameters are written
 * through fw_object_write() (firmware/app/fw.h), which refuses what is out of range and then calls
 * axis_parameter_written(); axis_tick() relies on their ranges.
 *
 * Signs: positive motion is toward the workpiece, contact force is positive in compression, a
 * positive code drives toward the workpiece. With f_d = 30 counts and a reading of 28, a gain of 5
 * gives the code +10: the robot presses harder. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis_state.h"

/* Power-up: disabled, code 0, no fault, parameters at their defaults. */
void axis_init(axis_t *axis);

/* One tick.
 *
 * Faults (faults.h) are answered in the same tick: code 0, amplifier off, brake on, whatever
 * latency_ticks is; the fault is latched and the requested mode set back to disabled. Limits
 * (limits.h) only change the code, and only the one put out: with latency_ticks 1 a code computed
 * a tick ago is limited by the present position and switches, and limit_reason refers to it; and by
 * the bounds of both ticks, so that none ends a tick early (output_limit is of the present one).
 * Nothing is added behind them.
 *
 * Taking over a mode or gain: the code computed in that tick equals the one put out just before it
 * (0 after disabled); the difference to the law becomes a bias that shrinks by 2^-n a tick, at
 * least 1/65536 code, to exactly 0. n is the bump_decay_shift at the change: writing another one
 * does not change an existing bias. n = 0: no bias, the change is a step.
 *
 * Entering position mode with a position_setpoint written since position mode was last active
 * makes it active; otherwise position_setpoint is set to the present position, so the axis holds
 * it. The profile starts at rest at the present position. A fault drops a set-point that was not
 * active yet: commands from before a fault must be repeated.
 *
 * Excitation mode starts its waveform (excitation.h) in the tick that enters it.
 *
 * latency_ticks 1: the code goes out one tick after it was computed; enabling, disabling and faults
 * act at once.
 *
 * The three arguments must not overlap. */
void axis_tick(axis_t *axis, const axis_inputs_t *inputs, axis_outputs_t *outputs);

/* Whether a value within its range may be written to the parameter `object` (AXIS_OBJ_): FW_OK,
 * FW_ERROR_RANGE or, a force_tare with a tare_band while a mode is on, FW_ERROR_STATE. */
int axis_check(const axis_t *axis, uint16_t object, int32_t value);

/* Reports that the parameter `object` (AXIS_OBJ_) was `previous` and now is `value`. Writing
 * the same value again changes nothing, except that a position_setpoint is new each time. */
void axis_parameter_written(axis_t *axis, uint16_t object, int32_t previous, int32_t value);

/* axis->law.bank now is that of `number` (1..4, law_bank.h), or force_gain alone is the law (0).
 * Taken over without a bump in force mode, as another gain is; the integral goes on if the new law
 * has one. */
void axis_bank_selected(axis_t *axis, uint8_t number);

/* The gain of the force law, of force_gain and of banks alike, is halved so often (0..15) from the
 * coming tick on. Taken over without a bump. */
void axis_halve_force_gain(axis_t *axis, uint8_t halvings);

/* Latches a fault from outside the axis (AXIS_FAULT_), unless one is latched already; the axis is
 * disabled in the next tick, and the latched fault, older or not, is not cleared before it. */
void axis_fault(axis_t *axis, uint8_t fault);

/* Latches a fault that was found in the signals of a tick, and takes back the outputs of that tick:
 * code 0, amplifier off, brake on. */
void axis_trip(axis_t *axis, uint8_t fault, axis_outputs_t *outputs);

/* Clears the latched fault. The axis stays disabled until a mode is written. False: the fault still
 * waits for the tick that it acts in, and stays. */
bool axis_fault_reset(axis_t *axis);

#endif
