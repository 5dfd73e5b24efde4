#include "firmware/proto/canopen.h"

#include "firmware/core/value.h"

void canopen_init(canopen_t *canopen, uint8_t node_id) {
  value_store_defaults(&canopen->params, AXIS_BLOCK_CANOPEN_PARAMETER);
  value_store_defaults(&canopen->signals, AXIS_BLOCK_CANOPEN_SIGNAL);
  canopen->node_id = node_id;
}

void canopen_start(canopen_t *canopen) { (void)canopen; }
void canopen_receive(canopen_t *canopen, fw_t *fw, const can_frame_t *frame) {
  (void)canopen, (void)fw, (void)frame;
}
void canopen_tick(canopen_t *canopen, fw_t *fw) { (void)canopen, (void)fw; }
bool canopen_transmit(canopen_t *canopen, can_frame_t *frame) {
  (void)canopen, (void)frame;
  return false;
}
uint8_t canopen_take_reset(canopen_t *canopen) {
  (void)canopen;
  return CANOPEN_RESET_NONE;
}
void canopen_lost(canopen_t *canopen, fw_t *fw, uint16_t frames) {
  (void)canopen, (void)fw, (void)frames;
}
void canopen_bus(canopen_t *canopen, fw_t *fw, uint8_t state) {
  (void)canopen, (void)fw, (void)state;
}
void canopen_emergency(canopen_t *canopen, uint16_t code, uint8_t info) {
  (void)canopen, (void)code, (void)info;
}
int canopen_check(const canopen_t *canopen, uint16_t object, int32_t value) {
  (void)canopen, (void)object, (void)value;
  return FW_OK;
}
void canopen_written(canopen_t *canopen, uint16_t object, int32_t previous, int32_t value) {
  (void)canopen, (void)object, (void)previous, (void)value;
}
