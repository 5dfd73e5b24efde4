#ifndef FIRMWARE_GUARD_CONTACT_H_
#define FIRMWARE_GUARD_CONTACT_H_

/* Monitors the contact: whether there is contact, the number of contact losses, and the largest
 * force. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"

/* Number of slots of limit_cycle_window. Each slot lasts as many ticks as the value of
 * limit_cycle_window. Contact losses are discarded one complete slot at a time, so the window has
 * 14 to 15 slots. */
enum { CONTACT_SLOTS = 15 };

typedef struct {
  uint16_t recent; /* number of contact losses in all slots */
  /* number of contact losses in each slot; at most one in two ticks */
  uint8_t losses[CONTACT_SLOTS];
  uint8_t slot;
  uint8_t slot_tick;
  /* 1: the force ripple is too large, which also counts as a limit cycle (contact_guard.h) */
  uint8_t rippling;
} contact_t;

/* Force control begins: resets the number of contact losses and the peak force. */
void contact_start(contact_t *contact, drive_signals_t *signals);

/* Discards the contact losses so far from the detection of a limit cycle; the signal contact_losses
 * continues to count. */
void contact_forget_losses(contact_t *contact);

/* Call it once in each tick with valid sensors. `controlled`: a force mode is active, and contact
 * losses are counted. */
void contact_tick(contact_t *contact, const drive_params_t *params, drive_signals_t *signals,
                  const axis_t *axis, bool controlled);

#endif
