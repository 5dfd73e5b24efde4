#ifndef FIRMWARE_DRIVE_MODES_H_
#define FIRMWARE_DRIVE_MODES_H_

/* The modes of operation (6060h). A table has one row for each mode of operation. A row contains,
 * among others, the function that computes a tick of the mode, and the function that returns its
 * bits of the statusword. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive_state.h"

/* Force set-point that a mode of operation uses. NONE: no force set-point. SETPOINT:
 * force_setpoint, in counts of the measured force. TARGET: target_force plus force_offset, in per
 * mille of rated_force. */
enum { CIA402_HOLDS_NONE, CIA402_HOLDS_SETPOINT, CIA402_HOLDS_TARGET };

/* Object that contains the time for which the axis must stay at its target before the drive reports
 * `target reached`. NONE: no object. POSITION: position_window_time. VELOCITY:
 * velocity_window_time. */
enum { CIA402_WINDOW_NONE, CIA402_WINDOW_POSITION, CIA402_WINDOW_VELOCITY };

struct cia402_mode {
  /* Each mode sets exactly one of the following three fields. `lead` is a function that moves the
   * trajectory that the axis follows. `run` is a function that commands the axis directly. `native`
   * is a native mode (AXIS_MODE_) that runs with the parameters of the user. */
  void (*lead)(cia402_t *drive, axis_t *axis);
  void (*run)(cia402_t *drive, axis_t *axis);
  uint8_t native;
  uint8_t controls_force;
  uint8_t holds; /* force set-point that this mode of operation uses, a CIA402_HOLDS_ value */
  /* 1 if the mode itself reacts to the halt bit; 0 if the drive stops the axis by a ramp at a
   * halt */
  uint8_t halts_itself;
  /* 1 if the mode uses target_position. This target is then discarded when the mode ends */
  uint8_t uses_position;
  uint8_t shaped; /* 1 if input shaping acts on the trajectory that `lead` moves */
  /* object that contains the time for which the axis must stay at its target, CIA402_WINDOW_ */
  uint8_t window;
  bool (*reached)(const cia402_t *drive,
                  /* function that returns true if the target is reached; NULL if the drive never
                   * reports that the target is reached */
                  const axis_t *axis);
  /* function that returns bits 12 and 13 of the statusword; NULL if both bits are 0 */
  uint16_t (*bits)(const cia402_t *drive);
};

/* The table of modes of operation. The index of a row is the number of the mode plus
 * CIA402_MODE_OFFSET. The table has a row for each mode number that the object table permits. */
enum {
  CIA402_MODE_OFFSET = -AXIS_MODES_OF_OPERATION_LEAST,
  CIA402_MODES = AXIS_MODES_OF_OPERATION_GREATEST + CIA402_MODE_OFFSET + 1
};
extern const cia402_mode_t cia402_modes[CIA402_MODES];

/* Makes a mode of operation (6060h) the active mode. */
static inline void cia402_set_mode(cia402_t *drive, int8_t mode) {
  drive->signals.modes_of_operation_display = mode;
  drive->mode = &cia402_modes[mode + CIA402_MODE_OFFSET];
}

/* Returns true if the number `mode` is a mode of operation (6060h). */
bool cia402_mode_exists(int32_t mode);

/* Returns the mode of operation (6060h) that corresponds to a native mode (AXIS_MODE_). */
int8_t cia402_operation_of(uint8_t native_mode);

/* Refuses a mode of operation that needs position_gain if first_motion_test is set and
 * position_gain is 0. Otherwise computes one tick of the first motion test if this test is running.
 * Returns true if it has done one of the two. If it returns false, the caller must compute the tick
 * of the mode of operation. */
bool cia402_run_first_motion(cia402_t *drive, axis_t *axis);

/* Returns true if the motion of the axis depends on the measured force. This is so in force modes,
 * guarded moves and homing on contact, including their approaches. It is also so in every phase of
 * a running cycle, because the force ends phases, and the verdict on the part depends on the force.
 * Returns false during the first motion test. */
bool cia402_is_guided_by_force(const cia402_t *drive);

/* Computes one tick of the active mode of operation. */
void cia402_run(cia402_t *drive, axis_t *axis);

/* cia402_excite_before() is called before a tick, when the mode of the tick is set, and prepares
 * the excitation if one is active. cia402_excite_after() is called after the tick and removes the
 * value of the excitation. */
void cia402_prepare_excitation(cia402_t *drive, axis_t *axis);
static inline void cia402_excite_before(cia402_t *drive, axis_t *axis) {
  if (contact_excitation_is_active(&drive->signals)) {
    cia402_prepare_excitation(drive, axis);
  }
}
static inline void cia402_excite_after(cia402_t *drive, axis_t *axis) {
  if (contact_excitation_is_active(&drive->signals)) {
    contact_excitation_remove(&drive->guards.excitation, &drive->params, &drive->signals, axis);
  }
}

/* Returns bits 12 and 13 of the statusword in mode -9. Bit 12 is 1 if the cycle is done. Bit 13 is
 * 1 if the pressed part is not good, or if no cycle could start. */
uint16_t cia402_cycle_bits(const cia402_t *drive);

/* Writes the state, the phase and the outcome of the cycle to the signals. */
void cia402_show_cycle(cia402_t *drive);

/* cia402_leave_mode() resets the state of a mode of operation when the mode ends or the axis is
 * disabled, and aborts a running cycle. cia402_end_mode() does only the part of this work that is
 * also needed between two phases of a cycle. */
void cia402_leave_mode(cia402_t *drive);
void cia402_end_mode(cia402_t *drive);

/* Reacts to a write to excitation_run, which starts or stops the excitation. Returns FW_OK or
 * FW_ERROR_STATE. */
int cia402_excite(cia402_t *drive, const axis_t *axis, bool start);

#endif
