#include "firmware/drive402/drive402_word.h"

#include "firmware/drive402/drive402_names.h"

/* For each drive state, mask and value of the statusword, from the table "state coding" of IEC
 * 61800-7-201. */
static const struct {
  uint16_t mask;
  uint16_t value;
} coding[DRIVE402_UNKNOWN] = {
    [DRIVE402_NOT_READY] = {0x4F, 0x00},
    [DRIVE402_SWITCH_ON_DISABLED] = {0x4F, 0x40},
    [DRIVE402_READY] = {0x6F, 0x21},
    [DRIVE402_SWITCHED_ON] = {0x6F, 0x23},
    [DRIVE402_OPERATION_ENABLED] = {0x6F, 0x27},
    [DRIVE402_QUICK_STOP_ACTIVE] = {0x6F, 0x07},
    [DRIVE402_FAULT_REACTION] = {0x4F, 0x0F},
    [DRIVE402_FAULT] = {0x4F, 0x08},
};

uint8_t drive402_state_of(uint16_t statusword) {
  uint8_t state = 0;
  while (state < DRIVE402_UNKNOWN && (statusword & coding[state].mask) != coding[state].value) {
    state++;
  }
  return state;
}

uint16_t drive402_step(uint8_t state) {
  switch (state) {
    case DRIVE402_SWITCH_ON_DISABLED:
      return DRIVE402_SHUTDOWN;
    case DRIVE402_READY:
      return DRIVE402_SWITCH_ON;
    case DRIVE402_SWITCHED_ON:
    case DRIVE402_OPERATION_ENABLED:
      return DRIVE402_ENABLE_OPERATION;
    default:
      return DRIVE402_DISABLE_VOLTAGE;
  }
}
