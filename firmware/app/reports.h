#ifndef FIRMWARE_APP_REPORTS_H_
#define FIRMWARE_APP_REPORTS_H_

/* Emergency messages about the contact, overruns and the parameter store. These events are no
 * faults of the axis. */

#include <stdint.h>

#include "firmware/app/fw_state.h"

/* Sends one of the emergency messages FF01h to FF04h. The firmware limits the rate of these
 * messages, because the cause of a message could occur in every tick. */
void reports_limited(fw_t *fw, uint16_t code);

/* Bits of the value that reports_contact_seen() returns: the axis is in contact; the force law is
 * saturated; the force oscillates in a limit cycle; the force law is restricted; the calibration
 * has expired. */
enum {
  REPORTS_CONTACT = 1,
  REPORTS_SATURATED = 2,
  REPORTS_LIMIT_CYCLE = 4,
  REPORTS_RESTRICTED = 64,
  REPORTS_EXPIRED = 128
};
/* The value of reports_contact_seen() also contains the number of gain halvings, at most
 * TOUCH_HALVINGS. REPORTS_HALVED is the factor with which this number is multiplied, and
 * REPORTS_HALVINGS is its bit mask. */
enum { REPORTS_HALVED = 8, REPORTS_HALVINGS = REPORTS_HALVED * TOUCH_HALVINGS };
static inline uint8_t reports_contact_seen(const fw_t *fw) {
  const drive_signals_t *signals = &fw->drive.signals;
  /* All signals except gain_halvings are 0 or 1, so every term of the sum has its own bits. */
  return (
      uint8_t)(signals->contact * REPORTS_CONTACT + signals->force_saturated * REPORTS_SATURATED +
               signals->limit_cycle * REPORTS_LIMIT_CYCLE +
               signals->gain_halvings * REPORTS_HALVED + fw->drive.restricted * REPORTS_RESTRICTED +
               signals->calibration_expired * REPORTS_EXPIRED);
}

/* Sends an emergency message for each change of contact, force law or calibration since the last
 * call. The loss of contact is reported only while the axis controls force. */
void reports_contact(fw_t *fw);

/* Sends the emergency message store_failed with store_state, the address of the first changed
 * parameter and the number of changed parameters. */
void reports_store(fw_t *fw);

#endif
