#ifndef FIRMWARE_DRIVE_HOMING_H_
#define FIRMWARE_DRIVE_HOMING_H_

/* Homing (mode 6) searches the reference position of the axis. The origin of all positions is
 * computed from this reference position.
 *
 * The homing methods are those of CiA 402, and method -1: homing on contact. Directions are
 * directions of the axis: positive is towards the workpiece, independent of the object polarity.
 * The limit switches use the same directions.
 *   17, 18   edge of the negative, positive limit switch
 *   19, 20   edge of a home switch that is on at the positive end, when the axis leaves (19) or
 *            enters (20) the range of the switch
 *   21, 22   edge of a home switch that is on at the negative end, when the axis leaves (21) or
 *            enters (22) the range of the switch
 *   33, 34   next index pulse in negative, positive direction
 *   35, 37   present position of the axis
 *   -1       contact with the workpiece
 * The axis searches a switch at the speed homing_speed_1. It searches the edge of the switch and
 * the index pulse at the speed homing_speed_2. The reference position is the encoder count of the
 * tick in which the firmware detects the edge. The error of the reference position is at most the
 * travel of one tick, which is one count at 1500 count/s.
 *
 * Homing on contact moves towards the workpiece at homing_speed_1 until the measured force exceeds
 * contact_force in magnitude, retracts by homing_retract, and approaches again at homing_speed_2.
 * The second contact is the reference position. Homing fails if the axis is still in contact after
 * the retraction, or if the second contact is not within twice homing_retract. Homing also fails,
 * and the axis stops immediately, if the measured force is beyond force_limit.
 *
 * Every method fails, and the axis stops, if the travel exceeds homing_travel, or if the time
 * exceeds homing_timeout. It also fails if the axis reaches a limit switch or a soft limit in its
 * direction of motion, or if the axis is behind its trajectory by more than the travel in a quarter
 * of a second. The position limits (607Dh) do not act during homing, because homing determines the
 * origin to which they refer. A halt interrupts homing, and a controlword without the start bit
 * also interrupts homing. Afterwards the axis stays at the position where it stopped. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive_state.h"

/* Computes one tick of homing. In the mode of operation 0 (none) the axis stays at its position. */
void homing_run(cia402_t *drive, axis_t *axis);

/* Reactions to the start bit of the controlword: homing_start() starts homing, and
 * homing_interrupt() interrupts a homing method that is moving the axis. */
void homing_start(cia402_t *drive);
void homing_interrupt(cia402_t *drive);

/* Returns true if the axis has all inputs that a homing method needs. Returns false for a method
 * that does not exist. Method 0 needs no input and always ends with an error. */
bool homing_is_offered(const cia402_t *drive, int32_t method);

/* Writes the numbers of the available homing methods to homing_methods (60E3h). */
void homing_list(cia402_t *drive);

#endif
