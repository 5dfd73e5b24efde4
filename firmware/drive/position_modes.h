#ifndef FIRMWARE_DRIVE_POSITION_MODES_H_
#define FIRMWARE_DRIVE_POSITION_MODES_H_

/* The modes of operation that control position and velocity; modes.c has one table row for each of
 * these modes. The axis follows a trajectory, and each of these functions moves the trajectory by
 * one tick. The other functions report whether the target of a mode is reached. */

#include <stdbool.h>

#include "firmware/drive/drive_state.h"

void position_profile(cia402_t *drive, axis_t *axis);
void position_guarded_move(cia402_t *drive, axis_t *axis);
void position_cyclic(cia402_t *drive, axis_t *axis);
void position_profile_velocity(cia402_t *drive, axis_t *axis);
void position_cyclic_velocity(cia402_t *drive, axis_t *axis);

bool position_setpoint_reached(const cia402_t *drive, const axis_t *axis);
bool position_target_reached(const cia402_t *drive, const axis_t *axis);
bool position_velocity_reached(const cia402_t *drive, const axis_t *axis);

/* Makes the target position a set-point. Call this function at the rising edge of the bit `new
 * set-point` of the controlword. */
void position_take_setpoint(cia402_t *drive);

/* Moves the trajectory by one tick with the target velocity. The speed changes with the profile
 * acceleration and deceleration, or in one step if `at_once` is true. */
void position_follow_velocity(cia402_t *drive, bool at_once);

#endif
