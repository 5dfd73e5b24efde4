#ifndef FIRMWARE_DRIVE_HOMING_H_
#define FIRMWARE_DRIVE_HOMING_H_

/* Homing (mode 6): searches the reference position of the axis and sets the origin of positions
 * from it.
 *
 * The methods are those of CiA 402, and -1 for homing on contact. Directions are those of the axis,
 * positive towards the workpiece, independent of the polarity; the limit switches use the same
 * directions.
 *   17, 18   edge of the negative, positive limit switch
 *   19, 20   edge of a home switch that is on at the positive end: on leaving it, on entering it
 *   21, 22   edge of a home switch that is on at the negative end: on leaving it, on entering it
 *   33, 34   next index pulse in negative, positive direction
 *   35, 37   present position of the axis
 *   -1       contact with the workpiece
 * The axis searches a switch at homing_speed_1, and its edge and the index pulse at homing_speed_2.
 * The reference position is the encoder count of the tick in which the edge was seen. It is late by
 * the travel of at most one tick: exact to one count up to 1500 count/s.
 *
 * Homing on contact moves towards the workpiece at homing_speed_1 until the measured force exceeds
 * contact_force in magnitude, retracts by homing_retract, and approaches again at homing_speed_2.
 * The second contact is the reference position. Homing fails if the axis is still in contact after
 * the retraction, or if the second contact is not within twice homing_retract. A measured force
 * beyond force_limit ends it at once.
 *
 * Every method fails, and the axis stops, after a travel of homing_travel or the time
 * homing_timeout, at a limit switch or soft limit on its path, and if the axis is a quarter of a
 * second behind its trajectory. Position limits (607Dh) do not act, because they refer to the
 * origin that homing determines. Halt and the end of the start bit interrupt homing. Afterwards the
 * axis stays at the position where it stopped. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive.h"

/* Computes one tick of homing, or of the mode "none", in which the axis stays at its position. */
void homing_run(cia402_t *drive, axis_t *axis);

/* Acts on the start bit of the controlword: starts homing, or interrupts a method that moves. */
void homing_start(cia402_t *drive);
void homing_interrupt(cia402_t *drive);

/* Whether the axis has the inputs that a homing method needs. Returns false also for a method that
 * does not exist. Method 0 needs no input and always ends with an error. */
bool homing_is_offered(const cia402_t *drive, int32_t method);

/* Lists the available homing methods in homing_methods (60E3h). */
void homing_list(cia402_t *drive);

#endif
