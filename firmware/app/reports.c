#include "firmware/app/reports.h"

#include "firmware/fx/fx.h"

void reports_limited(fw_t *fw, uint16_t code) {
  const uint8_t i = (uint8_t)(code - FW_HELD_FIRST);
  const uint32_t now = fw->axis.signals.tick_count;
  if (fw->reported[i] != 0 && now - fw->reported_tick[i] < FW_HOLD_TICKS) {
    return;
  }
  fw->reported[i] = 1;
  fw->reported_tick[i] = now;
  canopen_emergency(&fw->canopen, code, 0);
}

void reports_contact(fw_t *fw) {
  const uint8_t before = fw->contact_seen;
  const uint8_t now = reports_contact_seen(fw);
  if (now == before) {
    return;
  }
  fw->contact_seen = now;
  const uint8_t risen = (uint8_t)(now & ~(uint32_t)before);
  const uint8_t fallen = (uint8_t)(before & ~(uint32_t)now);
  if ((fallen & REPORTS_CONTACT) != 0 && fw->drive.controlled != 0) {
    reports_limited(fw, AXIS_ERROR_CODE_CONTACT_LOST);
  }
  if ((risen & REPORTS_SATURATED) != 0) {
    reports_limited(fw, AXIS_ERROR_CODE_FORCE_SATURATED);
  }
  if ((risen & REPORTS_LIMIT_CYCLE) != 0) {
    reports_limited(fw, AXIS_ERROR_CODE_LIMIT_CYCLE);
  }
  if ((now & REPORTS_HALVINGS) > (before & REPORTS_HALVINGS)) {
    canopen_emergency(&fw->canopen, AXIS_ERROR_CODE_GAIN_HALVED, fw->drive.signals.gain_halvings);
  }
}

void reports_store(fw_t *fw) {
  const device_signals_t *signals = &fw->device_signals;
  const uint32_t change = signals->store_change[0];
  const uint32_t count =
      (signals->store_change_count < UINT8_MAX) ? signals->store_change_count : UINT8_MAX;
  canopen_emergency_detailed(
      &fw->canopen, AXIS_ERROR_CODE_STORE_FAILED, signals->store_state,
      fx_field(change, 8, 16) + fx_field(change, 0, 8) * 65536 + count * 16777216);
}
