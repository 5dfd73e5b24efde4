#ifndef FIRMWARE_APP_EVENTS_H_
#define FIRMWARE_APP_EVENTS_H_

/* Emergencies that are no fault: changes of the contact, and those that are limited in rate. */

#include <stdint.h>

#include "firmware/app/fw.h"

enum { SEEN_CONTACT = 1, SEEN_SATURATED = 2, SEEN_LIMIT_CYCLE = 4 };

/* The state of the contact, SEEN_ bits. */
static inline uint8_t events_contact_state(const fw_t *fw) {
  const drive_signals_t *signals = &fw->drive.signals;
  /* Each of them is 0 or 1. */
  return (uint8_t)(signals->contact * SEEN_CONTACT + signals->force_saturated * SEEN_SATURATED +
                   signals->limit_cycle * SEEN_LIMIT_CYCLE);
}

/* Reports what has changed since the last call. */
void events_contact(fw_t *fw);

/* An emergency of FF01h to FF04h, which could otherwise be repeated in every tick. */
void events_report_limited(fw_t *fw, uint16_t code);

#endif
