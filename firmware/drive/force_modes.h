#ifndef FIRMWARE_DRIVE_FORCE_MODES_H_
#define FIRMWARE_DRIVE_FORCE_MODES_H_

/* The modes of operation that control force; modes.c has one table row for each of these modes.
 * Each of these functions sets the set-point of the force law for one tick, or moves the axis
 * towards the workpiece in position mode. */

#include <stdbool.h>

#include "firmware/drive/drive_state.h"

void force_profile(cia402_t *drive, axis_t *axis);
void force_cyclic(cia402_t *drive, axis_t *axis);
void force_stiffness(cia402_t *drive, axis_t *axis);
void force_damping(cia402_t *drive, axis_t *axis);
void force_impedance(cia402_t *drive, axis_t *axis);

/* Returns true if the measured force has reached the target force of mode 4 or 10. */
bool force_target_reached(const cia402_t *drive, const axis_t *axis);

#endif
