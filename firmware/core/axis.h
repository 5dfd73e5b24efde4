#ifndef FIRMWARE_CORE_AXIS_H_
#define FIRMWARE_CORE_AXIS_H_

/* One axis: its inputs are counts and its outputs are codes, once in each tick of 1/1500 s.
 *
 * axis_tick() is the complete control loop. It depends only on the state and the inputs: it uses no
 * heap, no floating point, no input or output, and its time is bounded (docs/chip/instructions.md
 * has the number of instructions, tests/chip/test_budget.py its limit). The caller owns the state,
 * so any number of axes can run side by side.
 *
 * Parameters are the fields of axis->params and signals are those of axis->signals;
 * firmware/objects/axis_objects.toml generates both. Signals may be read between ticks. Parameters
 * are written by fw_object_write() (firmware/app/fw.h), which refuses a value out of range and then
 * calls axis_parameter_written(); axis_tick() relies on these ranges.
 *
 * Signs: positive motion is towards the workpiece, contact force is positive in compression, and a
 * positive code moves the axis towards the workpiece. With a force set-point of 30 counts and a
 * measured force of 28 counts, a gain of 5 codes per count gives the code +10: the axis presses
 * harder. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis_state.h"

/* Sets the state of an axis at power-up: it is disabled, with code 0, no fault and default
 * parameters. */
void axis_init(axis_t *axis);

/* Computes one tick.
 *
 * A fault (faults.h) acts in the same tick for every value of latency_ticks: the code becomes 0,
 * the amplifier is switched off and the brake closes. The fault is latched, and the requested mode
 * becomes disabled. A limit (limits.h) changes only the code that is output. With latency_ticks 1
 * this is the code computed in the previous tick: the present position and switches limit it,
 * limit_reason refers to it, and the bounds of both ticks apply, so that no bound ends one tick too
 * early (output_limit is that of the present tick). Nothing is added after the limits.
 *
 * Bumpless transfer: when a mode or gain changes, the computed code of that tick equals the code
 * that was output before it (0 after disabled). The difference to the control law becomes a bias
 * that decays by 2^-n in each tick, at least by 1/65536 code, to exactly 0. n is bump_decay_shift
 * at the time of the change: a later write does not change an existing bias. With n = 0 there is no
 * bias, and the output steps.
 *
 * A position_setpoint that was written after position mode was last active becomes active when
 * position mode begins; otherwise position_setpoint is set to the present position, so the axis
 * stays there. The profile starts from standstill at the present position. A fault discards a
 * set-point that was not active yet: a command from before a fault must be repeated.
 *
 * Excitation mode starts its waveform (excitation.h) in its first tick.
 *
 * With latency_ticks 1 a code is output one tick after its computation; enabling, disabling and
 * faults act at once.
 *
 * The memory of the three arguments must not overlap. */
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
