#ifndef FIRMWARE_DRIVE_CONTACT_H_
#define FIRMWARE_DRIVE_CONTACT_H_

/* Monitors the contact: its presence, the number of losses, the largest force. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/axis.h"

/* A second is 15 slots of 100 ticks; losses are discarded by whole slots, so the window is at least
 * 1400 ticks and at most 1500. */
enum { CONTACT_SLOTS = 15, CONTACT_SLOT_TICKS = 100 };

typedef struct {
  uint16_t recent;               /* losses in all slots */
  uint8_t losses[CONTACT_SLOTS]; /* at most one in two ticks */
  uint8_t slot;
  uint8_t slot_tick;
} contact_t;

/* Force control begins: losses and peak start again. */
void contact_start(contact_t *contact, drive_signals_t *signals);

/* Once a tick with valid sensors; `controlled`: a force mode is active, and losses count. */
void contact_tick(contact_t *contact, const drive_params_t *params, drive_signals_t *signals,
                  const axis_t *axis, bool controlled);

#endif
