#ifndef FIRMWARE_DRIVE_CYCLE_MODE_H_
#define FIRMWARE_DRIVE_CYCLE_MODE_H_

/* Mode of operation -9: the axis runs a cycle program (firmware/cycle). In each phase the axis
 * moves as in a mode of operation: profile position mode, a guarded move, or mode 4 with the force
 * and the slope of the phase. A table or a tare may change the target of mode 4 in each tick. All
 * bounds of these modes of operation apply: position limits, velocity_max, force_limit, the bounds
 * of a force law without certificate, the contact guard.
 *
 * A rising edge of bit 4 of the controlword starts a cycle, if the axis is not halted and has a
 * suitable program; otherwise cycle_state gives the reason why no cycle has started. A cycle
 * program is not suitable if one of its forces is at or beyond an end of the range of the force
 * sensor. The cycle ends when bit 4 of the controlword becomes 0, and at a halt, a stop, a fault, a
 * change of the mode and the loss of the owner. The verdict on the part is then `aborted`, never
 * `good`. A cycle that is stopped before its first tick has not begun, and no part is counted.
 *
 * A value that affects the verdict must not change during a cycle. A write that would change such a
 * value is refused, or the write ends the cycle as CYCLE_CHANGED (column in_cycle of the object
 * table). The cycle also ends as CYCLE_CHANGED when contact_unstable_option halves the gain.
 * Statusword bit 10: no cycle runs and the axis is at standstill; bit 12: the last cycle is done;
 * bit 13: the part of the last cycle is not good, or no cycle could start. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive_state.h"

/* Returns true while a cycle is running, and until its last samples have been evaluated. */
static inline bool cycle_mode_is_busy(const cia402_t *drive) {
  return drive->cycle.state == CYCLE_RUNNING || drive->cycle.state == CYCLE_ENDED;
}

/* Returns true if a rising edge of bit 4 of the controlword would start a cycle in this tick. */
bool cycle_mode_can_start(const cia402_t *drive, const axis_t *axis);

/* Selects a cycle program; NULL selects no program. While a cycle is running, changes nothing and
 * returns false. */
bool cycle_mode_select(cia402_t *drive, const cycle_header_t *program);

/* Call cycle_mode_moved() when the selected cycle program has been moved to a new address, and its
 * bytes are the same. Call it only while no cycle is running. */
void cycle_mode_moved(cia402_t *drive, const cycle_header_t *program);

/* Returns the CRC of the filter bank with which the force is controlled now. Returns 0 if no bank
 * is selected. Also returns 0 while the gain of the bank is halved, because the force law then
 * differs from the bank. */
static inline uint32_t cycle_mode_bank(const cia402_t *drive) {
  return (drive->signals.gain_halvings == 0) ? drive->law_crc : 0;
}

/* Reacts to the start bit of the controlword. Call this function only while no cycle is running,
 * and after all samples of the last cycle were evaluated. */
void cycle_mode_start(cia402_t *drive, const axis_t *axis);

/* Ends a running cycle as CYCLE_CHANGED. Call this function when a value has changed that affects
 * the verdict on the pressed part. */
void cycle_mode_change(cia402_t *drive);

/* Ends a running cycle. Call this function at every stop of the axis and at every change of the
 * mode. */
void cycle_mode_interrupt(cia402_t *drive);

/* Call cycle_mode_tick_failed() when a tick ends with a fault, before the mode ends. If this tick
 * is the first tick of a cycle, the cycle counts as begun, and its pressed part is counted. */
static inline void cycle_mode_tick_failed(cia402_t *drive, const axis_t *axis) {
  if (drive->cycle.last_tick == drive->cycle.begin_tick) {
    drive->cycle.last_tick = axis->signals.tick_count;
  }
}

/* Passes the signals of a tick to the cycle. When the cycle changes to another phase, sets the mode
 * and the targets of this phase. */
void cycle_mode_step(cia402_t *drive, const axis_t *axis);
static inline void cycle_mode_after(cia402_t *drive, const axis_t *axis) {
  if (cycle_is_running(&drive->cycle)) {
    cycle_mode_step(drive, axis);
  }
}

/* Evaluates the waiting samples of the cycle. Call this function between ticks. */
void cycle_mode_between(cia402_t *drive);

#endif
