#ifndef FIRMWARE_DRIVE_FORCE_MODES_H_
#define FIRMWARE_DRIVE_FORCE_MODES_H_

/* The modes that control force, rows of modes.c. Each function sets the set-point of the force law
 * for a tick, or approaches the workpiece in position mode. */

#include <stdbool.h>

#include "firmware/drive/drive.h"

void force_profile(cia402_t *drive, axis_t *axis);
void force_cyclic(cia402_t *drive, axis_t *axis);
void force_stiffness(cia402_t *drive, axis_t *axis);
void force_damping(cia402_t *drive, axis_t *axis);
void force_impedance(cia402_t *drive, axis_t *axis);

/* Whether the measured force has reached its target, in modes 4 and 10. */
bool force_target_reached(const cia402_t *drive, const axis_t *axis);

#endif
