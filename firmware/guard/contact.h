#ifndef FIRMWARE_GUARD_CONTACT_H_
#define FIRMWARE_GUARD_CONTACT_H_

/* Monitors the contact: its presence, the number of losses, the largest force. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"

/* limit_cycle_window is 15 slots of as many ticks as its value has: losses are discarded by whole
 * slots, so the window is 14 to 15 of them. */
enum { CONTACT_SLOTS = 15 };

typedef struct {
  uint16_t recent;               /* losses in all slots */
  uint8_t losses[CONTACT_SLOTS]; /* at most one in two ticks */
  uint8_t slot;
  uint8_t slot_tick;
  uint8_t rippling; /* 1: the force swings too much, which is a limit cycle too (contact_guard.h) */
} contact_t;

/* Force control begins: losses and peak start again. */
void contact_start(contact_t *contact, drive_signals_t *signals);

/* Losses before are no limit cycle any more; contact_losses goes on. */
void contact_forget_losses(contact_t *contact);

/* Once a tick with valid sensors; `controlled`: a force mode is active, and losses count. */
void contact_tick(contact_t *contact, const drive_params_t *params, drive_signals_t *signals,
                  const axis_t *axis, bool controlled);

#endif
