#include "firmware/canopen/emcy.h"

#include <stdbool.h>
#include <stddef.h>

#include "firmware/canopen/cob_id.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects_drive.h"

/* Returns the bits that an error code sets in the error register (1001h). A warning sets no bit. */
static uint8_t class_of(uint16_t code) {
  if (code >= AXIS_ERROR_CODE_CONTACT_LOST && code <= AXIS_ERROR_CODE_OVERRUN) {
    return 0;
  }
  switch (fx_field(code, 8, 8)) {
    case 0x00:
      return 0;
    case 0x81:
    case 0x82:
      return AXIS_ERROR_REGISTER_ANY | AXIS_ERROR_REGISTER_COMMUNICATION;
    case 0x86:
      return AXIS_ERROR_REGISTER_ANY | AXIS_ERROR_REGISTER_PROFILE;
    case 0xFF:
      return AXIS_ERROR_REGISTER_ANY | AXIS_ERROR_REGISTER_MANUFACTURER;
    default:
      return AXIS_ERROR_REGISTER_ANY;
  }
}

void emcy_update(canopen_t *canopen) {
  const bool communication =
      canopen->heartbeats_lost != 0 || canopen->rpdos_late != 0 || canopen->bus != CAN_BUS_ACTIVE;
  const uint8_t drive = class_of(canopen->emcy.drive_code);
  canopen->signals.error_register =
      communication ? (uint8_t)(drive | AXIS_ERROR_REGISTER_ANY | AXIS_ERROR_REGISTER_COMMUNICATION)
                    : drive;
}

/* Adds an error at the start of the error history. If the history is full, its oldest error is
 * discarded. */
static void remember(canopen_t *canopen, uint16_t code, uint8_t info) {
  uint32_t *history = canopen->signals.error_history;
  for (uint8_t i = EMCY_HISTORY - 1; i > 0; i--) {
    history[i] = history[i - 1];
  }
  history[0] = (uint32_t)code + (uint32_t)info * 65536;
  uint8_t *count = &canopen->params.error_history_count;
  *count = (uint8_t)((*count < EMCY_HISTORY) ? *count + 1 : EMCY_HISTORY);
}

void emcy_raise_detailed(canopen_t *canopen, uint16_t code, uint8_t info, uint32_t detail) {
  emcy_t *emcy = &canopen->emcy;
  fx_assert(emcy->count <= EMCY_WAITING && canopen->params.error_history_count <= EMCY_HISTORY);
  emcy_update(canopen);
  if (code != AXIS_ERROR_CODE_NONE) {
    remember(canopen, code, info);
  }
  if (!canopen_cob_valid(canopen->params.emcy_cob_id)) {
    return;
  }
  if (emcy->count == EMCY_WAITING) {
    /* If too many emergency messages wait, the oldest message is discarded. Its error remains in
     * the error history, and the latest message shows the present state. */
    emcy->count = EMCY_WAITING - 1;
    for (uint8_t i = 0; i < EMCY_WAITING - 1; i++) {
      emcy->waiting[i] = emcy->waiting[i + 1];
    }
  }
  emcy->count = (uint8_t)(emcy->count + 1);
  emcy->waiting[emcy->count - 1] =
      (emergency_t){.code = code,
                    .error_register = (uint8_t)(canopen->signals.error_register | class_of(code)),
                    .info = info,
                    .detail = detail};
}

/* Returns true if the node itself already sent this error code, because it detected the loss of the
 * owner. */
static bool is_reported(const canopen_t *canopen, uint16_t code) {
  switch (code) {
    case AXIS_ERROR_CODE_HEARTBEAT_LOST:
      return canopen->heartbeats_lost != 0;
    case AXIS_ERROR_CODE_PDO_TIMEOUT:
      return canopen->rpdos_late != 0;
    case AXIS_ERROR_CODE_CAN_OFF:
      return canopen->bus == CAN_BUS_OFF;
    default:
      return false;
  }
}

void emcy_drive(canopen_t *canopen, uint16_t code, uint8_t fault) {
  canopen->emcy.drive_code = code;
  if (is_reported(canopen, code)) {
    emcy_update(canopen);
  } else {
    emcy_raise(canopen, code, (code == AXIS_ERROR_CODE_NONE) ? 0 : fault);
  }
}

void emcy_tick(canopen_t *canopen) {
  emcy_t *emcy = &canopen->emcy;
  fx_assert(emcy->count <= EMCY_WAITING);
  const uint8_t state = canopen->signals.nmt_state;
  if (state != AXIS_NMT_STATE_PRE_OPERATIONAL && state != AXIS_NMT_STATE_OPERATIONAL) {
    return;
  }
  const uint32_t inhibit = fx_ticks_from_100us(canopen->params.emcy_inhibit_time);
  bool inhibited = canopen_timer_runs(&canopen->timers, CANOPEN_TIMER_EMCY);
  const uint16_t id = canopen_can_id(canopen->params.emcy_cob_id);
  const uint32_t count = emcy->count;
  uint32_t sent = 0;
  while (!inhibited && sent < count && canopen->output.closed == 0 &&
         canopen->output.count + CAN_OUTPUT_KEEP_EMCY < CAN_OUTPUT_FRAMES) {
    const emergency_t *emergency = &emcy->waiting[sent];
    can_frame_t *frame = can_output_add(&canopen->output, id, 8, CAN_OUTPUT_KEEP_EMCY);
    if (frame == NULL) {
      break;
    }
    fx_store_le(frame->data, emergency->code, 2);
    frame->data[2] = emergency->error_register;
    frame->data[3] = emergency->info;
    fx_store_le(&frame->data[4], emergency->detail, 4);
    sent += 1;
    if (inhibit != 0) {
      canopen_timer_start(&canopen->timers, CANOPEN_TIMER_EMCY, inhibit);
      inhibited = true;
    }
  }
  emcy->count = (uint8_t)(count - sent);
  for (uint32_t i = 0; sent != 0 && i < count - sent; i++) {
    emcy->waiting[i] = emcy->waiting[i + sent];
  }
}

void emcy_clear_history(canopen_t *canopen) {
  canopen->params.error_history_count = 0;
  for (uint8_t i = 0; i < EMCY_HISTORY; i++) {
    canopen->signals.error_history[i] = 0;
  }
}
