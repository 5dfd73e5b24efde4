#ifndef FIRMWARE_DRIVE_HOMING_H_
#define FIRMWARE_DRIVE_HOMING_H_

/* Homing (mode 6) searches the reference position of the axis and derives the origin of all
 * positions from this reference position.
 *
 * The homing methods are those of CiA 402 and the method -1, homing on contact. The directions are
 * those of the axis: positive is towards the workpiece, independent of the polarity. The limit
 * switches use the same directions.
 *   17, 18   edge of the negative, positive limit switch
 *   19, 20   edge of a home switch that is on at the positive end, when the axis leaves (19) or
 *            enters (20) the range of the switch
 *   21, 22   edge of a home switch that is on at the negative end, when the axis leaves (21) or
 *            enters (22) the range of the switch
 *   33, 34   next index pulse in negative, positive direction
 *   35, 37   present position of the axis
 *   -1       contact with the workpiece
 * The axis searches a switch at homing_speed_1, and its edge and the index pulse at homing_speed_2.
 * The reference position is the encoder count of the tick in which the firmware detects the edge.
 * The error of the reference position is at most the travel of one tick, which is one count at 1500
 * count/s.
 *
 * Homing on contact moves towards the workpiece at homing_speed_1 until the measured force exceeds
 * contact_force in magnitude, retracts by homing_retract, and approaches again at homing_speed_2.
 * The second contact is the reference position. Homing fails if the axis is still in contact after
 * the retraction, or if the second contact is not within twice homing_retract. Homing also fails,
 * and the axis stops immediately, if the measured force is beyond force_limit.
 *
 * Every method fails, and the axis stops, in three cases: the travel exceeds homing_travel or the
 * time exceeds homing_timeout; the axis reaches a limit switch or soft limit in its direction of
 * motion; the axis is behind its trajectory by more than the travel of a quarter of a second.
 * Position limits (607Dh) do not act, because they refer to the origin that homing determines. A
 * halt interrupts homing, and so does a controlword without the start bit. Afterwards the axis
 * stays at the position where it stopped. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive_state.h"

/* Computes one tick of homing, or of the mode "none", in which the axis stays at its position. */
void homing_run(cia402_t *drive, axis_t *axis);

/* Reacts to the start bit of the controlword: homing_start() starts homing, and homing_interrupt()
 * interrupts a method that moves the axis. */
void homing_start(cia402_t *drive);
void homing_interrupt(cia402_t *drive);

/* Returns true if the axis has all inputs that a homing method needs. Returns false for a method
 * that does not exist. Method 0 needs no input and always ends with an error. */
bool homing_is_offered(const cia402_t *drive, int32_t method);

/* Writes the numbers of the available homing methods to homing_methods (60E3h). */
void homing_list(cia402_t *drive);

#endif
