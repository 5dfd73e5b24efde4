#ifndef FIRMWARE_DRIVE_CYCLE_MODE_H_
#define FIRMWARE_DRIVE_CYCLE_MODE_H_

/* Mode of operation -9: the axis runs the cycle of a program (firmware/cycle). Each phase moves the
 * axis as the mode of its kind does: profile position, guarded move, or mode 4 with the force and
 * the slope of the phase, whose target of a table and of a tare may change in each tick. All bounds
 * of these modes apply: position limits, velocity_max, force_limit, the bounds of a law without
 * certificate, the contact guard.
 *
 * A rising edge of bit 4 of the controlword starts a cycle, if the axis has a program that fits
 * (cycle_state says otherwise why it did not start). A program does not fit if one of its forces is
 * at or beyond an end of what the force sensor can show. An edge while the last samples of a cycle
 * are evaluated starts the next cycle after the evaluation. A controlword without bit 4, a halt,
 * every stop and fault, another mode and the loss of the owner end the cycle: the part is then
 * aborted, never good. Statusword bit 10: no cycle runs and the axis is at standstill; bit 12: the
 * last cycle is done; bit 13: its part is not good, or no cycle could start. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive.h"

/* Returns true while a cycle runs or its last samples are evaluated. */
static inline bool cycle_mode_is_busy(const cia402_t *drive) {
  return drive->cycle.state == CYCLE_RUNNING || drive->cycle.state == CYCLE_ENDED;
}

/* Returns true if a start edge in this tick would start a cycle. */
bool cycle_mode_can_start(const cia402_t *drive, const axis_t *axis);

/* Selects the program, NULL for none. Returns false while a cycle runs. */
bool cycle_mode_select(cia402_t *drive, const cycle_header_t *program);

/* Tells the drive the new place of its program, whose bytes are the same, while no cycle runs. */
void cycle_mode_moved(cia402_t *drive, const cycle_header_t *program);

/* Reacts to the start bit of the controlword. */
void cycle_mode_start(cia402_t *drive, const axis_t *axis);

/* Ends a running cycle, for every stop and change of mode. */
void cycle_mode_interrupt(cia402_t *drive);

/* Takes the signals of a tick and begins the next phase. */
void cycle_mode_step(cia402_t *drive, const axis_t *axis);
static inline void cycle_mode_after(cia402_t *drive, const axis_t *axis) {
  if (cycle_is_running(&drive->cycle)) {
    cycle_mode_step(drive, axis);
  }
}

/* Between ticks: evaluates the samples of the cycle, or starts the cycle that had to wait for the
 * evaluation of the last one. */
void cycle_mode_between(cia402_t *drive);
static inline void cycle_mode_start_late(cia402_t *drive, const axis_t *axis) {
  if (drive->cycle_asked != 0) {
    cycle_mode_start(drive, axis);
  }
}

#endif
