#ifndef FIRMWARE_DRIVE_POSITION_MODES_H_
#define FIRMWARE_DRIVE_POSITION_MODES_H_

/* The modes of position and velocity, rows of modes.c. Each function moves the trajectory by one
 * tick, and the axis follows it. Further functions report whether the targets are reached. */

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

/* Acts on the rising edge of the bit "new set-point" of the controlword: adopts the set-point. */
void position_take_setpoint(cia402_t *drive);

/* Moves the trajectory by one tick towards the target velocity, either with the profile
 * acceleration and deceleration or at once. */
void position_follow_velocity(cia402_t *drive, bool at_once);

#endif
