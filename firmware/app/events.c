#include "firmware/app/events.h"

void events_report_limited(fw_t *fw, uint16_t code) {
  const uint8_t i = (uint8_t)(code - FW_HELD_FIRST);
  const uint32_t now = fw->axis.signals.tick_count;
  if (fw->reported[i] != 0 && now - fw->reported_tick[i] < FW_HOLD_TICKS) {
    return;
  }
  fw->reported[i] = 1;
  fw->reported_tick[i] = now;
  canopen_emergency(&fw->canopen, code, 0);
}

void events_contact(fw_t *fw) {
  const uint8_t before = fw->contact_seen;
  const uint8_t now = events_contact_state(fw);
  if (now == before) {
    return;
  }
  fw->contact_seen = now;
  const uint8_t risen = (uint8_t)(now & ~(uint32_t)before);
  const uint8_t fallen = (uint8_t)(before & ~(uint32_t)now);
  /* A contact is lost only while force is controlled. */
  if ((fallen & SEEN_CONTACT) != 0 && fw->drive.controlled != 0) {
    events_report_limited(fw, AXIS_ERROR_CODE_CONTACT_LOST);
  }
  if ((risen & SEEN_SATURATED) != 0) {
    events_report_limited(fw, AXIS_ERROR_CODE_FORCE_SATURATED);
  }
  if ((risen & SEEN_LIMIT_CYCLE) != 0) {
    events_report_limited(fw, AXIS_ERROR_CODE_LIMIT_CYCLE);
  }
}
