#ifndef FIRMWARE_CORE_AXIS_H_
#define FIRMWARE_CORE_AXIS_H_

/* One axis. In each tick of 1/1500 s the firmware reads the inputs as counts and outputs a DAC
 * code.
 *
 * axis_tick() is the complete control loop. The result of axis_tick() depends only on the state and
 * the inputs. The function uses no heap, no floating point and no peripherals. Its execution time
 * is bounded: docs/chip/instructions.md states the number of instructions, and
 * tests/firmware/chip/test_budget.py checks this number. The caller owns the state, so any number
 * of axes can run side by side.
 *
 * Parameters are the fields of axis->params and signals are those of axis->signals. The names and
 * types of these fields are generated from firmware/objects/axis_objects.toml. Signals may be read
 * between ticks. Parameters are written by fw_object_write() (firmware/app/fw.h), which refuses
 * values outside the range of the parameter and then calls axis_parameter_written(). axis_tick()
 * does not check the ranges again.
 *
 * Signs: positive motion is towards the workpiece, contact force is positive in compression, and a
 * positive code moves the axis towards the workpiece. With a force set-point of 30 counts and a
 * measured force of 28 counts, a gain of 5 codes per count gives the code +10: the axis presses
 * harder. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis_state.h"

/* Sets the state of an axis at power-up: the axis is disabled, the DAC code is 0, no fault is
 * latched, and all parameters have their defaults. */
void axis_init(axis_t *axis);

/* Computes one tick of an axis.
 *
 * A fitted drive (AXIS_DRIVE_REPORT_FITTED) has power only some ticks after the amplifier is
 * enabled. Until the drive reports that it is on, the axis outputs code 0 with the brake closed,
 * and active_mode remains disabled. The profile, the integral and the excitation begin later. The
 * mode begins in the first tick in which the drive is on. AXIS_DRIVE_REPORT_LIMIT acts on the
 * integral like a limit of the DAC code.
 *
 * When mode becomes disabled without a fault, the brake closes in the same tick, but a brake needs
 * some time until it holds. For brake_engage_ticks the amplifier stays on with output_bias as the
 * only output, active_mode is open_loop, and faults are detected as in every mode.
 *
 * A fault (faults.h) acts in the same tick for every value of latency_ticks: the DAC code becomes
 * 0, the amplifier is switched off and the brake closes. The fault is latched, and the requested
 * mode becomes disabled. A limit (limits.h) changes only the output code. If latency_ticks is 1,
 * the output code is the code that was computed in the previous tick. The present position and the
 * present limit switches limit this code, and limit_reason refers to this code. The bounds of both
 * ticks apply, so that no bound ends one tick too early. The value of output_limit is that of the
 * present tick. Nothing is added to the output after the limits.
 *
 * Resolution: the sum of the command of the control law and the bump bias is rounded once, half up,
 * to a multiple of 2^(12 - dac_bits) code. The output bias, rounded in the same way, is added to
 * the sum, and the result is limited. Limits and bounds are whole codes. dac_fine is the output,
 * and dac_code is dac_fine rounded to a whole code. If dac_bits is 12, both are the same output.
 *
 * Output bias: output_bias is added to the output in each tick in which a mode is active, from the
 * first one on, so that the axis does not fall when the brake opens. Its magnitude is at most half
 * of the range of the DAC, so the law keeps at least the other half, and at most output_limit.
 *
 * Bumpless transfer: when a mode or gain changes, the code computed in that tick equals the code
 * that was output before (output_bias after disabled). The difference between this output and the
 * control law becomes a bias. In each tick the bias decreases by the fraction 2^-n of its value, at
 * least by 1/65536 code, until it is exactly 0. n is the value of bump_decay_shift when the mode or
 * gain changes; a later write does not change an existing bias. If n is 0, there is no bias, and
 * the output steps.
 *
 * A position_setpoint that is written before position mode begins becomes active when position mode
 * begins. Without such a write position_setpoint becomes the present position, so the axis stays at
 * its position. The profile starts from standstill at the present position. A fault discards a
 * set-point that was not active yet, so the user must write the set-point again.
 *
 * Excitation mode starts its waveform (excitation.h) in its first tick.
 *
 * If latency_ticks is 1, a code is output one tick after its computation; enabling, disabling and
 * faults act in the same tick.
 *
 * The memory of the three arguments must not overlap. */
void axis_tick(axis_t *axis, const axis_inputs_t *inputs, axis_outputs_t *outputs);

/* Checks whether a value within its range may be written to the parameter `object` (AXIS_OBJ_).
 * Returns FW_OK or FW_ERROR_RANGE. Returns FW_ERROR_STATE for force_tare while a mode is active and
 * tare_band is not 0. */
int axis_check(const axis_t *axis, uint16_t object, int32_t value);

/* Acts on a write that has changed the parameter `object` (AXIS_OBJ_) from `previous` to `value`. A
 * write of the same value has no effect. The exception is position_setpoint: each write to it gives
 * a new set-point. */
void axis_parameter_written(axis_t *axis, uint16_t object, int32_t previous, int32_t value);

/* Call axis_output_loaded() after dac_bits, output_limit or output_bias were changed without a
 * write, for example when the stored parameters were loaded. `most` is the largest number of bits
 * that the DAC of the board can output. A larger dac_bits is reduced to `most`. */
void axis_output_loaded(axis_t *axis, uint8_t most);

/* Call axis_bank_selected() after the coefficients of the filter bank `number` (1..4, law_bank.h)
 * were copied to axis->law.bank. If `number` is 0, the force law uses only force_gain. In force
 * mode the change of the bank is bumpless, as a change of the gain is. The integral keeps its value
 * if the new bank has integral action. */
void axis_bank_selected(axis_t *axis, uint8_t number);

/* Halves the gain of the force law `halvings` times (0..15), from the next tick on. The gain is
 * force_gain or the gain of the selected filter bank. The change is bumpless. */
void axis_halve_force_gain(axis_t *axis, uint8_t halvings);

/* Latches a fault (AXIS_FAULT_) that was detected outside axis_tick(), unless another fault is
 * already latched. The axis is disabled in the next tick. The latched fault cannot be reset before
 * that tick. */
void axis_fault(axis_t *axis, uint8_t fault);

/* Latches a fault that was detected in the signals of a tick, and sets the outputs of the same tick
 * to the safe state: code 0, amplifier off, brake on. */
void axis_trip(axis_t *axis, uint8_t fault, axis_outputs_t *outputs);

/* Resets the latched fault. The axis stays disabled until a mode is written. If no tick has run
 * since the fault was latched, does not reset the fault and returns false. */
bool axis_fault_reset(axis_t *axis);

#endif
