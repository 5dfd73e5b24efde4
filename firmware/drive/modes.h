#ifndef FIRMWARE_DRIVE_MODES_H_
#define FIRMWARE_DRIVE_MODES_H_

/* The modes of operation (6060h). Each has one row in a table: its function in a tick and its bits
 * of the statusword. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive.h"

/* Force set-point that a mode controls: no force, force_setpoint in counts of the measured force,
 * or target_force with force_offset in per mille of rated_force. */
enum { CIA402_HOLDS_NONE, CIA402_HOLDS_SETPOINT, CIA402_HOLDS_TARGET };

/* Selects the object with the time for which the axis must stay at its target before the drive
 * reports target reached. */
enum { CIA402_WINDOW_NONE, CIA402_WINDOW_POSITION, CIA402_WINDOW_VELOCITY };

struct cia402_mode {
  /* One of three functions computes a tick of the mode. The first moves the trajectory, which the
   * axis follows; the second commands the axis itself; the third gives the axis a native mode
   * (AXIS_MODE_) with the parameters of the user. */
  void (*lead)(cia402_t *drive, axis_t *axis);
  void (*run)(cia402_t *drive, axis_t *axis);
  uint8_t native;
  uint8_t controls_force;
  uint8_t holds; /* CIA402_HOLDS_: set-point that the measured force shall reach */
  /* 1: the mode itself acts on the bit "halt"; 0: the drive stops the axis by a ramp */
  uint8_t halts_itself;
  uint8_t uses_position; /* 1: the mode uses target_position and discards it when the mode ends */
  uint8_t shaped;        /* 1: input shaping acts on what `lead` moves */
  uint8_t window;        /* CIA402_WINDOW_ */
  bool (*reached)(const cia402_t *drive,
                  const axis_t *axis);     /* whether the target is reached; NULL: never reported */
  uint16_t (*bits)(const cia402_t *drive); /* bits 12 and 13 of the statusword; NULL: both are 0 */
};

/* The table of modes. The index is the mode of operation plus CIA402_MODE_OFFSET; each number that
 * the object table permits has a row. */
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

/* Whether the number is a mode of operation (6060h). */
bool cia402_mode_exists(int32_t mode);

/* Returns the mode of operation (6060h) that corresponds to a native mode (AXIS_MODE_). */
int8_t cia402_operation_of(uint8_t native_mode);

/* With first_motion_test: computes one tick of the first motion test, or refuses a mode that needs
 * position_gain while position_gain is 0. Returns false if it did neither; the mode of operation
 * then acts. */
bool cia402_run_first_motion(cia402_t *drive, axis_t *axis);

/* Whether the motion depends on the measured force: in force modes, guarded moves and homing on
 * contact, including their approaches, but not in the first motion test. */
bool cia402_is_guided_by_force(const cia402_t *drive);

/* Computes one tick of the active mode of operation. */
void cia402_run(cia402_t *drive, axis_t *axis);

/* An active excitation: sets its value for the next tick, whose mode is already set; removes the
 * value after the tick. */
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

/* Resets the state of a mode of operation when the mode ends or the axis is disabled. */
void cia402_leave_mode(cia402_t *drive);

#endif
