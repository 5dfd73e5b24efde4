#ifndef FIRMWARE_DRIVE_POSITION_MODES_H_
#define FIRMWARE_DRIVE_POSITION_MODES_H_

/* The modes of position and velocity, rows of modes.c: each moves the trajectory by one tick; the
 * axis follows it. And whether their targets are reached. */

#include <stdbool.h>

#include "firmware/drive/drive.h"

void position_profile(cia402_t *drive, axis_t *axis);
void position_guarded_move(cia402_t *drive, axis_t *axis);
void position_cyclic(cia402_t *drive, axis_t *axis);
void position_profile_velocity(cia402_t *drive, axis_t *axis);
void position_cyclic_velocity(cia402_t *drive, axis_t *axis);

bool position_setpoint_reached(const cia402_t *drive, const axis_t *axis);
bool position_target_reached(const cia402_t *drive, const axis_t *axis);
bool position_velocity_reached(const cia402_t *drive, const axis_t *axis);

/* The rising edge of "new set-point". */
void position_take_setpoint(cia402_t *drive);

/* One tick toward the target velocity, by the profile's rates or at once. */
void position_follow_velocity(cia402_t *drive, bool at_once);

#endif
