#ifndef FIRMWARE_APP_REPORTS_H_
#define FIRMWARE_APP_REPORTS_H_

/* Emergency messages that are no fault of the axis: contact, overruns, store. */

#include <stdint.h>

#include "firmware/app/fw.h"

/* Sends one of the emergency messages from FW_HELD_FIRST on. The firmware limits their rate,
 * because their cause could occur in every tick. */
void reports_limited(fw_t *fw, uint16_t code);

/* Bits of the state of contact, force law and calibration, which is compared with
 * fw->contact_seen. */
enum {
  REPORTS_CONTACT = 1,
  REPORTS_SATURATED = 2,
  REPORTS_LIMIT_CYCLE = 4,
  REPORTS_RESTRICTED = 64,
  REPORTS_EXPIRED = 128
};
/* Factor of the number of times that the gain was halved, at most TOUCH_HALVINGS, in the same
 * state. */
enum { REPORTS_HALVED = 8, REPORTS_HALVINGS = REPORTS_HALVED * TOUCH_HALVINGS };
static inline uint8_t reports_contact_seen(const fw_t *fw) {
  const drive_signals_t *signals = &fw->drive.signals;
  /* The other terms are 0 or 1. */
  return (
      uint8_t)(signals->contact * REPORTS_CONTACT + signals->force_saturated * REPORTS_SATURATED +
               signals->limit_cycle * REPORTS_LIMIT_CYCLE +
               signals->gain_halvings * REPORTS_HALVED + fw->drive.restricted * REPORTS_RESTRICTED +
               signals->calibration_expired * REPORTS_EXPIRED);
}

/* Sends emergency messages for changes of this state since the last call. A loss of contact is
 * reported only while force is controlled. */
void reports_contact(fw_t *fw);

/* Sends store_failed with store_state, the address of the first changed parameter and the number of
 * changed parameters. */
void reports_store(fw_t *fw);

#endif
