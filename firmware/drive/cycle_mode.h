#ifndef FIRMWARE_DRIVE_CYCLE_MODE_H_
#define FIRMWARE_DRIVE_CYCLE_MODE_H_

/* Mode of operation -9: the axis runs the cycle of a program (firmware/cycle). Each phase moves the
 * axis as a mode of operation does: profile position, guarded move, or mode 4 with the force and
 * the slope of the phase. A table or a tare may change the target of mode 4 in each tick. All
 * bounds of these modes apply: position limits, velocity_max, force_limit, the bounds of a law
 * without certificate, the contact guard.
 *
 * A rising edge of bit 4 of the controlword starts a cycle, if the axis is not halted and has a
 * suitable program; otherwise cycle_state says why no cycle has started. A program is not suitable
 * if one of its forces is at or beyond an end of the range of the force sensor. A controlword
 * without bit 4, a halt, every stop and fault, another mode and the loss of the owner end the
 * cycle: the verdict on the part is then aborted, never good. A cycle that is stopped before its
 * first tick has not begun, and no part is counted.
 *
 * A value that affects the verdict stays as it is at the start: a write that would change it is
 * refused, or acts and ends the cycle as CYCLE_CHANGED (column in_cycle of the object table). The
 * cycle also ends as CYCLE_CHANGED when contact_unstable_option halves the gain. Statusword bit 10:
 * no cycle runs and the axis is at standstill; bit 12: the last cycle is done; bit 13: the part of
 * the last cycle is not good, or no cycle could start. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive_state.h"

/* Returns true while a cycle runs or its last samples are evaluated. */
static inline bool cycle_mode_is_busy(const cia402_t *drive) {
  return drive->cycle.state == CYCLE_RUNNING || drive->cycle.state == CYCLE_ENDED;
}

/* Returns true if a start edge in this tick would start a cycle. */
bool cycle_mode_can_start(const cia402_t *drive, const axis_t *axis);

/* Selects the program, NULL for none. Returns false while a cycle runs. */
bool cycle_mode_select(cia402_t *drive, const cycle_header_t *program);

/* Call this function when the selected program has moved to a new address and its bytes have not
 * changed, and only while no cycle runs. */
void cycle_mode_moved(cia402_t *drive, const cycle_header_t *program);

/* Returns the CRC of the bank that controls the force now: 0 without a bank, and while its gain is
 * halved, because the law is then not that of the bank. */
static inline uint32_t cycle_mode_bank(const cia402_t *drive) {
  return (drive->signals.gain_halvings == 0) ? drive->law_crc : 0;
}

/* Reacts to the start bit of the controlword. Call this function only while no cycle runs and the
 * last cycle is evaluated. */
void cycle_mode_start(cia402_t *drive, const axis_t *axis);

/* Ends a running cycle as CYCLE_CHANGED, because a value that affects the verdict on its part has
 * changed. */
void cycle_mode_change(cia402_t *drive);

/* Ends a running cycle, for every stop and change of mode. */
void cycle_mode_interrupt(cia402_t *drive);

/* Call cycle_mode_tick_failed() when a tick ends with a fault, before the mode ends. A cycle whose
 * first tick is this one has begun, so its part is counted. */
static inline void cycle_mode_tick_failed(cia402_t *drive, const axis_t *axis) {
  if (drive->cycle.last_tick == drive->cycle.begin_tick) {
    drive->cycle.last_tick = axis->signals.tick_count;
  }
}

/* Processes the signals of a tick and begins the next phase. */
void cycle_mode_step(cia402_t *drive, const axis_t *axis);
static inline void cycle_mode_after(cia402_t *drive, const axis_t *axis) {
  if (cycle_is_running(&drive->cycle)) {
    cycle_mode_step(drive, axis);
  }
}

/* Between ticks: evaluates the samples of the cycle. */
void cycle_mode_between(cia402_t *drive);

#endif
