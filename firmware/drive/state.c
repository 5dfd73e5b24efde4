#include "firmware/drive/state.h"

enum {
  NOT_READY = AXIS_DRIVE_STATE_NOT_READY,
  DISABLED = AXIS_DRIVE_STATE_SWITCH_ON_DISABLED,
  READY = AXIS_DRIVE_STATE_READY_TO_SWITCH_ON,
  SWITCHED_ON = AXIS_DRIVE_STATE_SWITCHED_ON,
  ENABLED = AXIS_DRIVE_STATE_OPERATION_ENABLED,
  QUICK_STOP = AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE,
  REACTION = AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE,
  FAULT = AXIS_DRIVE_STATE_FAULT
};

typedef struct {
  uint8_t from;
  uint8_t mask;
  uint8_t value;
  uint8_t to;
} transition_t;

/* Transitions of CiA 402, 7.2, with their numbers. Not in this table are T0 and T1, which need no
 * command; T13 and T14, which a fault causes; and T15, which needs a rising edge. */
enum { TRANSITIONS = 15 };
static const transition_t transitions[TRANSITIONS] = {
    {DISABLED, 0x87, 0x06, READY},       /* T2 shutdown */
    {READY, 0x8F, 0x07, SWITCHED_ON},    /* T3 switch on */
    {READY, 0x8F, 0x0F, ENABLED},        /* T3 and T4 */
    {SWITCHED_ON, 0x8F, 0x0F, ENABLED},  /* T4 enable operation */
    {ENABLED, 0x8F, 0x07, SWITCHED_ON},  /* T5 disable operation */
    {SWITCHED_ON, 0x87, 0x06, READY},    /* T6 shutdown */
    {READY, 0x82, 0x00, DISABLED},       /* T7 disable voltage */
    {READY, 0x86, 0x02, DISABLED},       /* T7 quick stop */
    {ENABLED, 0x87, 0x06, READY},        /* T8 shutdown */
    {ENABLED, 0x82, 0x00, DISABLED},     /* T9 disable voltage */
    {SWITCHED_ON, 0x82, 0x00, DISABLED}, /* T10 disable voltage */
    {SWITCHED_ON, 0x86, 0x02, DISABLED}, /* T10 quick stop */
    {ENABLED, 0x86, 0x02, QUICK_STOP},   /* T11 quick stop */
    {QUICK_STOP, 0x82, 0x00, DISABLED},  /* T12 disable voltage */
    {QUICK_STOP, 0x8F, 0x0F, ENABLED},   /* T16 enable operation */
};

uint8_t cia402_next_state(uint8_t state, uint16_t controlword, uint16_t rising, bool may_resume) {
  if (state == FAULT) {
    return ((rising & CIA402_CW_FAULT_RESET) != 0) ? DISABLED : FAULT;
  }
  for (uint8_t i = 0; i < TRANSITIONS; i++) {
    const transition_t *row = &transitions[i];
    if (row->from == state && (controlword & row->mask) == row->value) {
      return (state == QUICK_STOP && row->to == ENABLED && !may_resume) ? state : row->to;
    }
  }
  return state;
}

bool cia402_enables(uint16_t controlword) { return (controlword & 0x8F) == 0x0F; }

bool cia402_is_stop(uint16_t object, int32_t value) {
  return (object == AXIS_OBJ_CONTROLWORD &&
          (((uint32_t)value & CIA402_CW_HALT) != 0 ||
           (((uint32_t)value & CIA402_CW_FAULT_RESET) == 0 && !cia402_enables((uint16_t)value)))) ||
         (object == AXIS_OBJ_MODE && value == AXIS_MODE_DISABLED);
}

uint8_t cia402_state_below(uint8_t state, uint16_t controlword) {
  const uint8_t to = cia402_next_state(state, controlword, 0, false);
  return (to < state || to == QUICK_STOP) ? to : state;
}

const uint8_t cia402_state_bits[AXIS_DRIVE_STATE_COUNT] = {
    [NOT_READY] = 0x00, [DISABLED] = 0x40,   [READY] = 0x21,    [SWITCHED_ON] = 0x23,
    [ENABLED] = 0x27,   [QUICK_STOP] = 0x07, [REACTION] = 0x0F, [FAULT] = 0x08,
};
