#include "firmware/proto/modbus.h"

void modbus_init(modbus_t *modbus, uint8_t unit) { modbus->unit = unit; }
void modbus_receive(modbus_t *modbus, fw_t *fw, const uint8_t *bytes, uint16_t count) {
  (void)modbus, (void)fw, (void)bytes, (void)count;
}
void modbus_tick(modbus_t *modbus, fw_t *fw) { (void)modbus, (void)fw; }
uint16_t modbus_transmit(modbus_t *modbus, uint8_t *bytes, uint16_t room) {
  (void)modbus, (void)bytes, (void)room;
  return 0;
}
