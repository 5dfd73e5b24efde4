#ifndef FIRMWARE_GUARD_CONTACT_H_
#define FIRMWARE_GUARD_CONTACT_H_

/* Monitors the contact of the axis with the workpiece: the state of contact, the number of contact
 * losses and the largest force. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"
#include "firmware/objects/generated/axis_objects_drive.h"

/* Number of time slots of the window in which contact losses are counted. Each time slot lasts as
 * many ticks as the value of limit_cycle_window. When a new time slot begins, the contact losses of
 * the oldest slot are discarded, so the window lasts 14 to 15 time slots. */
enum { CONTACT_SLOTS = 15 };

typedef struct {
  uint16_t recent; /* number of contact losses in all time slots of the window */
  /* number of contact losses in each time slot of the window; in two ticks at most one contact loss
   * is counted */
  uint8_t losses[CONTACT_SLOTS];
  uint8_t slot;
  uint8_t slot_tick;
  /* 1 if the force ripple is too large. This is also reported as a limit cycle (contact_guard.h) */
  uint8_t rippling;
} contact_t;

/* Resets the number of contact losses and the peak force at the start of force control. */
void contact_start(contact_t *contact, drive_signals_t *signals);

/* Discards all contact losses so far, so that they no longer count for the detection of a limit
 * cycle. The signal contact_losses is not reset. */
void contact_forget_losses(contact_t *contact);

/* Updates the state of contact. Call this function in each tick with valid sensor values.
 * `controlled` is true if a force mode is active. Contact losses are counted only then. */
void contact_tick(contact_t *contact, const drive_params_t *params, drive_signals_t *signals,
                  const axis_t *axis, bool controlled);

#endif
