#ifndef FIRMWARE_DRIVE_HOMING_H_
#define FIRMWARE_DRIVE_HOMING_H_

/* Homing (mode 6): finds a place of the axis and sets the origin of positions from it.
 *
 * Methods are those of CiA 402, and -1, on contact. Directions are those of the axis, positive
 * toward the workpiece, whatever the polarity, as the limit switches are.
 *   17, 18   edge of the negative, positive limit switch
 *   19, 20   edge of a home switch that is on at the positive end, on leaving and on entering it
 *   21, 22   the same of one that is on at the negative end
 *   33, 34   next index in negative, positive direction
 *   35, 37   where the axis stands
 *   -1       contact with the workpiece
 * A switch is sought with homing_speed_1, its edge and the index with homing_speed_2. The place is
 * the count of the tick in which the edge was seen, so it is late by the way of one tick at most:
 * exact to one count up to 1500 count/s.
 *
 * On contact: toward the workpiece at homing_speed_1 until |reading| > contact_force, back by
 * homing_retract, and again at homing_speed_2, where the second contact is home. It fails when the
 * axis is still in contact after the retraction, or when the second contact is not within twice
 * homing_retract; a reading beyond force_limit ends it at once.
 *
 * Every method fails, and the axis stops, beyond homing_travel from its start or homing_timeout, at
 * a limit switch or soft limit in its way, and when the axis is a quarter second behind its
 * trajectory. Position limits (607Dh) do not act, since they refer to an origin yet to be found.
 * Halt and the end of the start bit interrupt it. After the end the axis holds where it came to a
 * stand. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive.h"

/* One tick of homing, and of mode none, which only holds. */
void homing_run(cia402_t *drive, axis_t *axis);

/* The controlword starts it, or interrupts a method that moves. */
void homing_start(cia402_t *drive);
void homing_interrupt(cia402_t *drive);

/* Whether the inputs that a method needs are fitted. False also for a method that does not exist;
 * method 0 needs none and always ends with an error. */
bool homing_is_offered(const cia402_t *drive, int32_t method);

/* Lists the offered methods in homing_methods (60E3h). */
void homing_list(cia402_t *drive);

#endif
