#ifndef FIRMWARE_APP_REPORTS_H_
#define FIRMWARE_APP_REPORTS_H_

/* Emergencies that are no fault of the axis: contact, overruns, the store. */

#include <stdint.h>

#include "firmware/app/fw.h"

/* An emergency of those from FW_HELD_FIRST, which could otherwise be repeated in every tick. */
void reports_limited(fw_t *fw, uint16_t code);

/* State of the contact, to be compared with fw->contact_seen. */
enum { REPORTS_CONTACT = 1, REPORTS_SATURATED = 2, REPORTS_LIMIT_CYCLE = 4 };
/* And how often the gain was halved, at most TOUCH_HALVINGS. */
enum { REPORTS_HALVED = 8, REPORTS_HALVINGS = REPORTS_HALVED * TOUCH_HALVINGS };
static inline uint8_t reports_contact_seen(const fw_t *fw) {
  const drive_signals_t *signals = &fw->drive.signals;
  /* The others are 0 or 1. */
  return (uint8_t)(signals->contact * REPORTS_CONTACT +
                   signals->force_saturated * REPORTS_SATURATED +
                   signals->limit_cycle * REPORTS_LIMIT_CYCLE +
                   signals->gain_halvings * REPORTS_HALVED);
}

/* Reports changes of that state since the last call. A contact is lost only while force is
 * controlled. */
void reports_contact(fw_t *fw);

/* store_failed with store_state, the address of the first change and how many there are. */
void reports_store(fw_t *fw);

#endif
