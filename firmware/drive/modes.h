#ifndef FIRMWARE_DRIVE_MODES_H_
#define FIRMWARE_DRIVE_MODES_H_

/* The modes of operation (6060h), one row each: its action in a tick and its status bits. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive.h"

/* The force that a mode holds: none, force_setpoint in counts of the reading, or target_force with
 * force_offset in per mille of rated_force. */
enum { CIA402_HOLDS_NONE, CIA402_HOLDS_SETPOINT, CIA402_HOLDS_TARGET };

/* For how long a target must have been reached. */
enum { CIA402_WINDOW_NONE, CIA402_WINDOW_POSITION, CIA402_WINDOW_VELOCITY };

struct cia402_mode {
  /* One tick, by one of these three: moves the trajectory, which the axis follows; does it all; or
   * leaves the axis to a mode of its own (AXIS_MODE_), with the user's parameters. */
  void (*lead)(cia402_t *drive, axis_t *axis);
  void (*run)(cia402_t *drive, axis_t *axis);
  uint8_t native;
  uint8_t controls_force;
  uint8_t holds;         /* CIA402_HOLDS_: what a program expects the force to become */
  uint8_t halts_itself;  /* 1: the bit "halt" is for the mode; 0: the axis slows down */
  uint8_t uses_position; /* 1: target_position acts, and is discarded at the exit from the mode */
  uint8_t shaped;        /* 1: what `lead` moves is shaped for the axis */
  uint8_t window;        /* CIA402_WINDOW_ */
  bool (*reached)(const cia402_t *drive,
                  const axis_t *axis);     /* whether the target is; NULL: never shown */
  uint16_t (*bits)(const cia402_t *drive); /* 12 and 13 of the statusword; NULL: 0 */
};

/* Indexed by the mode of operation plus CIA402_MODE_OFFSET; a row for each number that the object
 * table can name. */
enum {
  CIA402_MODE_OFFSET = -AXIS_MODES_OF_OPERATION_LEAST,
  CIA402_MODES = AXIS_MODES_OF_OPERATION_GREATEST + CIA402_MODE_OFFSET + 1
};
extern const cia402_mode_t cia402_modes[CIA402_MODES];

/* Puts a mode of 6060h in force. */
static inline void cia402_set_mode(cia402_t *drive, int8_t mode) {
  drive->signals.modes_of_operation_display = mode;
  drive->mode = &cia402_modes[mode + CIA402_MODE_OFFSET];
}

/* True if the mode is one of 6060h. */
bool cia402_mode_exists(int32_t mode);

/* 6060h of a native mode (AXIS_MODE_). */
int8_t cia402_operation_of(uint8_t native_mode);

/* With first_motion_test: one tick of the test before the first motion, or of refusing a mode that
 * needs a position_gain which is 0. False: neither, and the mode of operation acts. */
bool cia402_run_first_motion(cia402_t *drive, axis_t *axis);

/* Whether the motion depends on the reading of the force: in force modes, guarded moves and homing
 * on contact, their approaches included, but not in the test before the first motion. */
bool cia402_is_guided_by_force(const cia402_t *drive);

/* One tick of the mode of operation in force. */
void cia402_run(cia402_t *drive, axis_t *axis);

/* An active excitation: its value for the coming tick, whose mode is set; its end after the tick.
 */
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

/* Resets the state of a mode that is exited, or whose axis was disabled. */
void cia402_leave_mode(cia402_t *drive);

#endif
