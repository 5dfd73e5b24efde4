#include "firmware/drive/state.h"

#include "firmware/objects/generated/axis_objects_axis.h"

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

/* Bits of the controlword that command a change of the drive state. */
enum {
  OFF = 0,
  SO = AXIS_CONTROLWORD_SWITCH_ON,
  EV = AXIS_CONTROLWORD_ENABLE_VOLTAGE,
  QS = AXIS_CONTROLWORD_NO_QUICK_STOP,
  EO = AXIS_CONTROLWORD_ENABLE_OPERATION,
  FR = AXIS_CONTROLWORD_FAULT_RESET,
  RUN = EO | QS | EV | SO
};

typedef struct {
  uint8_t from;
  uint8_t mask;
  uint8_t value;
  uint8_t to;
} transition_t;

/* Transitions between the drive states, with their numbers in CiA 402, 7.2. This table does not
 * have T0 and T1, because they need no command. It does not have T13 and T14, because a fault
 * causes them. It does not have T15, because T15 needs a rising edge. */
enum { TRANSITIONS = 15 };
static const transition_t transitions[TRANSITIONS] = {
    {DISABLED, FR | QS | EV | SO, QS | EV, READY},    /* T2 shutdown */
    {READY, FR | RUN, QS | EV | SO, SWITCHED_ON},     /* T3 switch on */
    {READY, FR | RUN, RUN, ENABLED},                  /* T3 and T4 */
    {SWITCHED_ON, FR | RUN, RUN, ENABLED},            /* T4 enable operation */
    {ENABLED, FR | RUN, QS | EV | SO, SWITCHED_ON},   /* T5 disable operation */
    {SWITCHED_ON, FR | QS | EV | SO, QS | EV, READY}, /* T6 shutdown */
    {READY, FR | EV, OFF, DISABLED},                  /* T7 disable voltage */
    {READY, FR | QS | EV, EV, DISABLED},              /* T7 quick stop */
    {ENABLED, FR | QS | EV | SO, QS | EV, READY},     /* T8 shutdown */
    {ENABLED, FR | EV, OFF, DISABLED},                /* T9 disable voltage */
    {SWITCHED_ON, FR | EV, OFF, DISABLED},            /* T10 disable voltage */
    {SWITCHED_ON, FR | QS | EV, EV, DISABLED},        /* T10 quick stop */
    {ENABLED, FR | QS | EV, EV, QUICK_STOP},          /* T11 quick stop */
    {QUICK_STOP, FR | EV, OFF, DISABLED},             /* T12 disable voltage */
    {QUICK_STOP, FR | RUN, RUN, ENABLED},             /* T16 enable operation */
};

uint8_t cia402_next_state(uint8_t state, uint16_t controlword, uint16_t rising, bool may_resume) {
  if (state == FAULT) {
    return ((rising & AXIS_CONTROLWORD_FAULT_RESET) != 0) ? DISABLED : FAULT;
  }
  for (uint8_t i = 0; i < TRANSITIONS; i++) {
    const transition_t *row = &transitions[i];
    if (row->from == state && (controlword & row->mask) == row->value) {
      return (state == QUICK_STOP && row->to == ENABLED && !may_resume) ? state : row->to;
    }
  }
  return state;
}

bool cia402_enables(uint16_t controlword) { return (controlword & (FR | RUN)) == RUN; }

bool cia402_is_stop(uint16_t object, int32_t value) {
  return (object == AXIS_OBJ_CONTROLWORD &&
          (((uint32_t)value & AXIS_CONTROLWORD_HALT) != 0 ||
           (((uint32_t)value & AXIS_CONTROLWORD_FAULT_RESET) == 0 &&
            !cia402_enables((uint16_t)value)))) ||
         (object == AXIS_OBJ_MODE && value == AXIS_MODE_DISABLED);
}

uint8_t cia402_state_below(uint8_t state, uint16_t controlword) {
  const uint8_t to = cia402_next_state(state, controlword, 0, false);
  return (to < state || to == QUICK_STOP) ? to : state;
}
