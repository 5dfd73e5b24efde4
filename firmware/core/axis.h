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

/* Whether a value within its range may be written to the parameter `object` (AXIS_OBJ_): FW_OK or
 * FW_ERROR_RANGE. FW_ERROR_STATE refuses force_tare with a tare_band while a mode is active. */
int axis_check(const axis_t *axis, uint16_t object, int32_t value);

/* Reports that the parameter `object` (AXIS_OBJ_) was `previous` and now is `value`. A write of an
 * equal value has no effect, except that each write to position_setpoint gives a new set-point. */
void axis_parameter_written(axis_t *axis, uint16_t object, int32_t previous, int32_t value);

/* axis->law.bank now has the coefficients of bank `number` (1..4, law_bank.h); with number 0,
 * force_gain alone is the force law. In force mode the change is bumpless, like a change of gain;
 * the integral keeps its value if the new law has integral action. */
void axis_bank_selected(axis_t *axis, uint8_t number);

/* Halves the gain of the force law, force_gain or the gain of a bank, `halvings` times (0..15) from
 * the next tick on. The change is bumpless. */
void axis_halve_force_gain(axis_t *axis, uint8_t halvings);

/* Latches a fault from outside the axis (AXIS_FAULT_), unless a fault is already latched. The axis
 * is disabled in the next tick; the latched fault, old or new, cannot be reset before this tick. */
void axis_fault(axis_t *axis, uint8_t fault);

/* Latches a fault that was found in the signals of a tick, and sets the outputs of this tick to the
 * safe state: code 0, amplifier off, brake on. */
void axis_trip(axis_t *axis, uint8_t fault, axis_outputs_t *outputs);

/* Resets the latched fault. The axis remains disabled until a mode is written. Returns false if the
 * fault has not acted in a tick yet; the fault then remains. */
bool axis_fault_reset(axis_t *axis);

#endif
