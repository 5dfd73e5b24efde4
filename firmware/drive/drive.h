#ifndef FIRMWARE_DRIVE_DRIVE_H_
#define FIRMWARE_DRIVE_DRIVE_H_

/* The CiA 402 drive profile of one axis: state machine, modes of operation and trajectories. The
 * drive writes the mode and the set-points of the axis before a tick, and reads the signals of the
 * axis after the tick.
 *
 * The parameters of the axis have the values that the user has written. During a tick the drive
 * overrides some of these parameters: the set-points, raw_step, and bump_decay_shift if the output
 * must step without a bump bias. The drive writes them before axis_tick() and restores them after
 * axis_tick(), so between ticks they have the values of the user. There are two exceptions: `mode`
 * is the mode that the drive commands, and after a change to mode -4 position_setpoint is the last
 * position that the drive demanded.
 *
 * A target acts only if it was written for its present use. A target position must be written after
 * the last end of cyclic position mode, the last halt and the last homing. A target velocity or
 * target force must be written after the last fault. Without such a write the axis stays at its
 * position.
 *
 * During the first motion test drive_state is operation_enabled, because the power stage is on, but
 * the statusword reports switched on. No target acts during the test. Every stop then disables the
 * axis immediately, because a ramp would need the position law.
 *
 * Execution time: cia402_before() and cia402_after() together need at most 1000 instructions on a
 * Cortex-M4. The other functions run between ticks, and their execution time is bounded too. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/drive/drive_state.h"
#include "firmware/drive/modes.h"
#include "firmware/drive/parameters.h"
#include "firmware/guard/guards.h"

/* Sets the state of the drive at power-up: all parameters have their defaults, and the drive state
 * is switch on disabled. */
void cia402_init(cia402_t *drive);

/* Initialises the drive from the stored parameters and from an axis that has run without the drive.
 * Call this function before the first tick of the drive. */
void cia402_wake(cia402_t *drive, const axis_t *axis);

/* The three steps of the drive in a tick. The first two functions are called before axis_tick():
 * the first one sets the targets, and the second one sets the values that depend on the inputs. The
 * third function is called after axis_tick() and reads the signals. */
void cia402_before(cia402_t *drive, axis_t *axis);
static inline void cia402_with_inputs(cia402_t *drive, axis_t *axis, const axis_inputs_t *inputs) {
  guards_limit(&drive->guards, &drive->params, &drive->signals, axis, inputs);
}
void cia402_after(cia402_t *drive, axis_t *axis);

/* Checks the signals of a tick after axis_tick() and before the outputs are written. If a sensor
 * value of this tick causes a fault, the function sets the outputs to the safe state. */
static inline void cia402_control(cia402_t *drive, axis_t *axis, axis_outputs_t *outputs) {
  guards_check(&drive->guards, &drive->params, &drive->signals, axis, outputs);
}

/* Reacts to a write that has changed an object of the drive from `previous` to `value`. If the
 * object is the controlword, carries out its command. */
void cia402_written(cia402_t *drive, axis_t *axis, uint16_t object, int32_t previous,
                    int32_t value);

/* Carries out a controlword of a command source that is not the owner of the axis and may only stop
 * the axis. Only a halt or a transition to a lower state is carried out. The controlword of the
 * owner stays active, except for its halt bit. Returns false if the axis cannot move and nothing
 * had to be stopped. */
bool cia402_stop(cia402_t *drive, axis_t *axis, uint16_t controlword);

/* Reports in stopped_by (AXIS_STOPPED_BY_) the source that stopped the axis. The report ends when a
 * controlword is carried out or a native mode becomes active. Returns false if stopped_by already
 * names a source. */
bool cia402_hold(cia402_t *drive, const axis_t *axis, uint8_t by);

/* Returns true if a controlword would enable an axis that is not enabled, or an axis that will be
 * disabled after a ramp. */
bool cia402_would_enable(const cia402_t *drive, uint16_t controlword);

/* Returns true if a controlword would stop the axis by a change of the drive state, or by a halt
 * bit that was 0 in the controlword `previous`. */
bool cia402_would_stop(const cia402_t *drive, uint16_t controlword, uint16_t previous);

/* Sets the warning that the axis is enabled, but the firmware would not detect that the owner of
 * the axis no longer responds. Clears the warning if `unsupervised` is false. */
void cia402_warn_unsupervised(cia402_t *drive, const axis_t *axis, bool unsupervised);

/* Adapts the drive state to the native mode `mode`, which the code for the board has written
 * directly and not through a controlword. */
void cia402_native_mode(cia402_t *drive, axis_t *axis, uint8_t mode);

/* Resets a fault without the controlword. Returns FW_OK. Returns FW_ERROR_STATE if no tick has run
 * since the fault was latched. */
int cia402_fault_reset(cia402_t *drive, axis_t *axis);

/* Discards all targets of the modes of operation, and sets the offsets of the targets to 0. A
 * discarded target acts only after a new write. */
void cia402_forget_targets(cia402_t *drive);

/* Reacts to the loss of the owner. If the axis is enabled, carries out the reaction that
 * abort_connection_option selects; `fault` is the fault of this reaction. The commands of the owner
 * are discarded, unless abort_connection_option lets the axis continue. Returns true if the axis
 * had to be stopped. */
bool cia402_owner_lost(cia402_t *drive, axis_t *axis, uint8_t fault);

#endif
