#include "firmware/canopen/heartbeat.h"

#include "firmware/canopen/emcy.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/access.h"
#include "firmware/objects/generated/axis_objects_axis.h"
#include "firmware/objects/generated/axis_objects_drive.h"

/* Returns the node id that an entry of 1016h monitors, or 0 if the entry monitors no node. */
static uint8_t watched_node(uint32_t entry) {
  const uint32_t node = fx_field(entry, 16, 8);
  return (uint8_t)((fx_field(entry, 0, 16) != 0 && node <= 127) ? node : 0);
}

static void heartbeat_found(canopen_t *canopen, uint8_t i) {
  if (canopen_has(canopen->heartbeats_lost, i)) {
    canopen_drop(&canopen->heartbeats_lost, i);
    emcy_raise(canopen, AXIS_ERROR_CODE_NONE, 0);
  }
}

void heartbeat_receive(canopen_t *canopen, const can_frame_t *frame) {
  const uint32_t node = (uint32_t)frame->id - HEARTBEAT_ID;
  if (frame->length != 1 || node == 0) {
    return;
  }
  for (uint8_t i = 0; i < CANOPEN_HEARTBEATS; i++) {
    const uint32_t entry = canopen->params.consumer_heartbeat[i];
    const uint32_t time_ms = fx_field(entry, 0, 16);
    if (fx_field(entry, 16, 8) == node && time_ms != 0) {
      heartbeat_found(canopen, i);
      canopen_timer_start(&canopen->timers, CANOPEN_TIMER_CONSUMER + (uint32_t)i,
                          fx_ticks_from_ms(time_ms));
      /* A boot-up message shows that a node has restarted. A restarted master does not know that it
       * enabled the axis before, and a restarted gateway does not know its clients. */
      if (frame->data[0] == AXIS_NMT_STATE_INITIALISING) {
        canopen_lose_all(canopen, AXIS_FAULT_SOURCE_LOST);
      }
      return; /* at most one entry of 1016h monitors a node */
    }
  }
}

void heartbeat_missed(canopen_t *canopen, uint8_t i) {
  /* The monitored node was not lost before this time-out, because only a heartbeat of the node
   * starts the timer. */
  canopen_put(&canopen->heartbeats_lost, i);
  emcy_raise(canopen, AXIS_ERROR_CODE_HEARTBEAT_LOST,
             watched_node(canopen->params.consumer_heartbeat[i]));
  canopen_lose_all(canopen, AXIS_FAULT_HEARTBEAT_LOST);
}

void heartbeat_restart(canopen_t *canopen, uint8_t i) {
  heartbeat_found(canopen, i);
  canopen_timer_stop(&canopen->timers, CANOPEN_TIMER_CONSUMER + (uint32_t)i);
}

bool heartbeat_runs(const canopen_t *canopen) {
  for (uint8_t i = 0; i < CANOPEN_HEARTBEATS; i++) {
    if (canopen_timer_runs(&canopen->timers, CANOPEN_TIMER_CONSUMER + i)) {
      return true;
    }
  }
  return false;
}

int heartbeat_check(const canopen_t *canopen, uint8_t i, uint32_t wanted) {
  if (fx_field(wanted, 24, 8) != 0) {
    return FW_ERROR_RANGE;
  }
  const uint8_t node = watched_node(wanted);
  for (uint8_t k = 0; k < CANOPEN_HEARTBEATS; k++) {
    if (k != i && node != 0 && watched_node(canopen->params.consumer_heartbeat[k]) == node) {
      return FW_ERROR_MAPPING;
    }
  }
  return FW_OK;
}
