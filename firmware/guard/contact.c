#include "firmware/guard/contact.h"

#include "firmware/fx/fx.h"
#include "firmware/guard/sensor.h"

void contact_forget_losses(contact_t *contact) { *contact = (contact_t){0}; }

void contact_start(contact_t *contact, drive_signals_t *signals) {
  contact_forget_losses(contact);
  signals->contact_losses = 0;
  signals->limit_cycle = 0;
  signals->force_peak = 0;
}

static void next_slot(contact_t *contact) {
  contact->slot_tick = 0;
  contact->slot = (uint8_t)((contact->slot + 1 == CONTACT_SLOTS) ? 0 : contact->slot + 1);
  contact->recent = (uint16_t)(contact->recent - contact->losses[contact->slot]);
  contact->losses[contact->slot] = 0;
}

void contact_tick(contact_t *contact, const drive_params_t *params, drive_signals_t *signals,
                  const axis_t *axis, bool controlled) {
  const int32_t force = axis->signals.force;
  const bool touching = !fx_within(force, axis->params.contact_force);
  const bool lost = signals->contact != 0 && !touching;
  signals->contact = touching ? 1 : 0;
  signals->force_saturated = sensor_is_railed(axis) ? 1 : 0;
  if (!controlled) {
    return;
  }
  if (force > signals->force_peak) {
    signals->force_peak = force;
  }
  contact->slot_tick = (uint8_t)(contact->slot_tick + 1);
  if (contact->slot_tick >= params->limit_cycle_window) {
    next_slot(contact);
  }
  if (lost) {
    contact->losses[contact->slot] = (uint8_t)(contact->losses[contact->slot] + 1);
    contact->recent = (uint16_t)(contact->recent + 1);
    if (signals->contact_losses < UINT16_MAX) {
      signals->contact_losses = (uint16_t)(signals->contact_losses + 1);
    }
  }
  const uint16_t many = params->limit_cycle_losses;
  const bool loses = many != 0 && contact->recent >= many;
  signals->limit_cycle = (loses || contact->rippling != 0) ? 1 : 0;
}
