#ifndef FIRMWARE_DRIVE_MODES_H_
#define FIRMWARE_DRIVE_MODES_H_

/* What each mode of operation does in a tick, and how the axis comes to a stand. All of it writes
 * mode and set-points of the axis for the coming tick. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive.h"

/* True if the mode controls force. */
static inline bool cia402_controls_force(int8_t mode) {
  switch (mode) {
    case AXIS_MODES_OF_OPERATION_FORCE:
    case AXIS_MODES_OF_OPERATION_CYCLIC_FORCE:
    case AXIS_MODES_OF_OPERATION_FORCE_COUNTS:
    case AXIS_MODES_OF_OPERATION_STIFFNESS:
    case AXIS_MODES_OF_OPERATION_DAMPING:
    case AXIS_MODES_OF_OPERATION_IMPEDANCE:
      return true;
    default:
      return false;
  }
}

/* True if the mode is one of 6060h. */
bool cia402_mode_exists(int32_t mode);

/* The axis disabled. */
void cia402_rest(cia402_t *drive, axis_t *axis);

/* One tick of the mode of operation in force. */
void cia402_run(cia402_t *drive, axis_t *axis);

/* How long an axis may take to come to a stand behind its trajectory: 100 ms. */
enum { CIA402_SETTLING_TICKS = 150 };

/* Trajectory and axis both stand: the latter within velocity_threshold. */
bool cia402_stands(const cia402_t *drive);

/* One tick of slowing down at a rate (Q16), then of holding. True once trajectory and axis
 * stand, or the trajectory alone for CIA402_SETTLING_TICKS: an amplifier that is switched off lets
 * the axis coast. It begins at the place and speed of the axis unless the axis follows it
 * already. */
bool cia402_slow_down(cia402_t *drive, axis_t *axis, int32_t rate);

/* The rising edge of "new set-point". */
void cia402_take_setpoint(cia402_t *drive);

/* Whatever was begun in a mode is forgotten: it was left, or the axis disabled. */
void cia402_leave_mode(cia402_t *drive);

/* Takes back what was lent for the tick. */
void cia402_take_back(cia402_t *drive, axis_t *axis);

#endif
