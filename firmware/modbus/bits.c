#include "firmware/modbus/bits.h"

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects_axis.h"
#include "firmware/objects/generated/axis_objects_device.h"
#include "firmware/objects/generated/axis_objects_drive.h"
#include "firmware/objects/generated/axis_objects_recorder.h"

enum {
  CONTROL_SHUTDOWN = AXIS_CONTROLWORD_ENABLE_VOLTAGE | AXIS_CONTROLWORD_NO_QUICK_STOP,
  CONTROL_ENABLE = CONTROL_SHUTDOWN | AXIS_CONTROLWORD_SWITCH_ON | AXIS_CONTROLWORD_ENABLE_OPERATION
};

/* Steps of a request that reads or writes coils or discrete inputs. Each step waits for the result
 * of one access to an object. */
enum {
  COIL,
  DISCRETE,
  PERMISSION,
  STATE,
  COMMAND,
  DISARM,
  RESET,
  LATEST_CONTROLWORD,
  HALT,
  STATE_TO_ENABLE,
  SHUTDOWN,
  ENABLE,
  STATE_AFTER,
  DISABLE
};

/* Returns the object that determines the state of coil n, or AXIS_OBJ_NONE if there is no such
 * object. */
static uint16_t coil_object(uint32_t n) {
  switch (n) {
    case AXIS_COIL_ENABLE:
      return AXIS_OBJ_DRIVE_STATE;
    case AXIS_COIL_HALT:
      return AXIS_OBJ_CONTROLWORD;
    case AXIS_COIL_STORE:
      return AXIS_OBJ_STORE_STATE;
    case AXIS_COIL_RECORDER_TRIGGER:
      return AXIS_OBJ_RECORDER_STATE;
    default:
      return AXIS_OBJ_NONE;
  }
}

/* Returns the state of coil n. `value` is the value of the object coil_object(n). */
static bool coil(uint32_t n, uint32_t value) {
  switch (n) {
    case AXIS_COIL_ENABLE:
      return value == AXIS_DRIVE_STATE_OPERATION_ENABLED;
    case AXIS_COIL_HALT:
      return (value & AXIS_CONTROLWORD_HALT) != 0;
    case AXIS_COIL_STORE:
      return value == AXIS_STORE_STATE_SAVING;
    case AXIS_COIL_RECORDER_TRIGGER:
      return value == AXIS_RECORDER_STATE_ARMED || value == AXIS_RECORDER_STATE_RECORDING;
    default:
      return false;
  }
}

static uint16_t discrete_object(uint32_t n) {
  switch (n) {
    case AXIS_DISCRETE_LIMIT_ACTIVE:
      return AXIS_OBJ_LIMIT_REASON;
    case AXIS_DISCRETE_CONTACT:
      return AXIS_OBJ_CONTACT;
    case AXIS_DISCRETE_LIMIT_CYCLE:
      return AXIS_OBJ_LIMIT_CYCLE;
    default:
      return AXIS_OBJ_STATUSWORD;
  }
}

static bool discrete(uint32_t n, uint32_t value) {
  return (n < AXIS_DISCRETE_LIMIT_ACTIVE) ? fx_field(value, n, 1) != 0 : value != 0;
}

/* Appends to the answer the bits that the last read object determines. Then requests the object for
 * the next bit. */
static void next_bits(modbus_request_t *r, uint8_t step) {
  for (; r->first < r->after; r->first++) {
    const uint16_t object = (step == COIL) ? coil_object(r->first) : discrete_object(r->first);
    if (object != AXIS_OBJ_NONE && object != r->access.object) {
      modbus_ask(r, step, MODBUS_READ, object, 0);
      return;
    }
    const uint32_t value = (uint32_t)r->access.value;
    const bool bit = (step == COIL) ? coil(r->first, value) : discrete(r->first, value);
    fx_bit_append(r->place, r->first - r->read_first, bit);
  }
  modbus_end(r, MODBUS_OK);
}

static void read_bits(modbus_request_t *r, uint8_t step, uint32_t all, uint16_t first,
                      uint16_t count) {
  if ((uint32_t)first + count > all) {
    modbus_end(r, MODBUS_EXCEPTION_ADDRESS);
    return;
  }
  r->part = MODBUS_BITS;
  r->read_first = first;
  r->first = first;
  r->after = (uint32_t)first + count;
  r->pdu[1] = (uint8_t)fx_octets(count);
  r->length = (uint16_t)(2 + fx_octets(count));
  r->place = &r->pdu[2];
  r->access.object = AXIS_OBJ_NONE;
  next_bits(r, step);
}

void modbus_read_coils(modbus_request_t *r, uint16_t first, uint16_t count) {
  read_bits(r, COIL, AXIS_COIL_COUNT, first, count);
}

void modbus_read_discretes(modbus_request_t *r, uint16_t first, uint16_t count) {
  read_bits(r, DISCRETE, AXIS_DISCRETE_COUNT, first, count);
}

/* Returns true if the request commands only a stop of the axis. Every command source may command a
 * stop. */
static bool only_stops(const modbus_request_t *r) {
  bool stops = false;
  for (uint32_t n = 0; n < AXIS_COIL_COUNT; n++) {
    const bool is_stop =
        (n == AXIS_COIL_ENABLE && r->zero[n]) || (n == AXIS_COIL_HALT && r->one[n]);
    if ((r->zero[n] || r->one[n]) && !is_stop) {
      return false;
    }
    stops = stops || is_stop;
  }
  return stops;
}

/* Checks whether the coils of the request may be written. Every command source may stop the axis,
 * but only the owner may do anything else. */
static void ask_permission(modbus_request_t *r) {
  const bool stops = only_stops(r);
  modbus_ask(r, PERMISSION, MODBUS_CHECK, stops ? AXIS_OBJ_CONTROLWORD : AXIS_OBJ_FAULT_RESET,
             stops ? CONTROL_SHUTDOWN : 1);
}

void modbus_write_coils(modbus_request_t *r, uint16_t first, uint16_t count, const uint8_t *bits) {
  if ((uint32_t)first + count > AXIS_COIL_COUNT) {
    modbus_end(r, MODBUS_EXCEPTION_ADDRESS);
    return;
  }
  for (uint32_t n = 0; n < AXIS_COIL_COUNT; n++) {
    const bool part = n >= first && n < (uint32_t)first + count;
    r->one[n] = part && fx_bit_get(bits, n - first);
    r->zero[n] = part && !r->one[n];
  }
  r->part = MODBUS_BITS;
  ask_permission(r);
}

static void write(modbus_request_t *r, uint8_t step, uint16_t object, uint32_t value) {
  modbus_ask(r, step, MODBUS_WRITE, object, fx_s32_from_u32(value));
}

/* Enables the axis from every state except a fault, or disables the axis. Of the previous
 * controlword only the halt bit is kept, because another bit could start an earlier set-point or
 * homing again. */
static void switch_axis(modbus_request_t *r) {
  if (r->one[AXIS_COIL_ENABLE]) {
    modbus_ask(r, STATE_TO_ENABLE, MODBUS_READ, AXIS_OBJ_DRIVE_STATE, 0);
  } else if (r->zero[AXIS_COIL_ENABLE]) {
    write(r, DISABLE, AXIS_OBJ_CONTROLWORD,
          (r->controlword & AXIS_CONTROLWORD_HALT) | CONTROL_SHUTDOWN);
  } else {
    modbus_end(r, MODBUS_OK);
  }
}

static void halt(modbus_request_t *r) {
  r->controlword = (uint32_t)r->access.value;
  if (r->one[AXIS_COIL_HALT]) {
    r->controlword |= AXIS_CONTROLWORD_HALT;
  } else if (r->zero[AXIS_COIL_HALT]) {
    r->controlword &= ~(uint32_t)AXIS_CONTROLWORD_HALT;
  } else {
    switch_axis(r);
    return;
  }
  write(r, HALT, AXIS_OBJ_CONTROLWORD, r->controlword);
}

static void reset(modbus_request_t *r) {
  if (r->one[AXIS_COIL_FAULT_RESET]) {
    write(r, RESET, AXIS_OBJ_FAULT_RESET, 1);
  } else {
    modbus_ask(r, LATEST_CONTROLWORD, MODBUS_READ, AXIS_OBJ_CONTROLWORD, 0);
  }
}

static void disarm(modbus_request_t *r) {
  if (r->zero[AXIS_COIL_RECORDER_TRIGGER]) {
    write(r, DISARM, AXIS_OBJ_RECORDER_ARM, 0);
  } else {
    reset(r);
  }
}

/* Executes the command of the request (store or recorder_trigger) before the controlword, because
 * the command may be refused although the controlword would be accepted. A request contains at most
 * one such command. */
static void command(modbus_request_t *r) {
  const uint32_t state = (uint32_t)r->access.value;
  const bool fault = state == AXIS_DRIVE_STATE_FAULT || state == AXIS_DRIVE_STATE_NOT_READY ||
                     state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE;
  if (r->one[AXIS_COIL_ENABLE] && fault) {
    modbus_end(r, MODBUS_EXCEPTION_STATE);
  } else if (r->one[AXIS_COIL_STORE] &&
             (r->one[AXIS_COIL_RECORDER_TRIGGER] || r->one[AXIS_COIL_ENABLE])) {
    /* The save would still be in progress at the second command, which would then be refused. */
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
  } else if (r->one[AXIS_COIL_STORE]) {
    write(r, COMMAND, AXIS_OBJ_STORE_PARAMETERS, 1);
  } else if (r->one[AXIS_COIL_RECORDER_TRIGGER]) {
    write(r, COMMAND, AXIS_OBJ_RECORDER_ARM, 1);
  } else {
    disarm(r);
  }
}

static void enable(modbus_request_t *r) {
  if (r->access.value == AXIS_DRIVE_STATE_OPERATION_ENABLED) {
    modbus_end(r, MODBUS_OK);
  } else {
    write(r, SHUTDOWN, AXIS_OBJ_CONTROLWORD,
          (r->controlword & AXIS_CONTROLWORD_HALT) | CONTROL_SHUTDOWN);
  }
}

/* Returns true if a refusal of the last access ends the request with an exception. The other
 * accesses were checked before, and the drive state shows afterwards whether the axis was enabled.
 */
static bool is_decisive(const modbus_request_t *r) {
  return r->step == PERMISSION || r->step == COMMAND || r->step == DISABLE;
}

void modbus_bits_resume(modbus_request_t *r) {
  const int refusal = r->access.refusal;
  if (refusal == MODBUS_NO_ANSWER || (refusal != FW_OK && is_decisive(r))) {
    modbus_end(r, modbus_exception_of(refusal));
    return;
  }
  switch (r->step) {
    case COIL:
    case DISCRETE:
      next_bits(r, r->step);
      break;
    case PERMISSION:
      modbus_ask(r, STATE, MODBUS_READ, AXIS_OBJ_DRIVE_STATE, 0);
      break;
    case STATE:
      command(r);
      break;
    case COMMAND:
      disarm(r);
      break;
    case DISARM:
      reset(r);
      break;
    case RESET:
      modbus_ask(r, LATEST_CONTROLWORD, MODBUS_READ, AXIS_OBJ_CONTROLWORD, 0);
      break;
    case LATEST_CONTROLWORD:
      halt(r);
      break;
    case HALT:
      switch_axis(r);
      break;
    case STATE_TO_ENABLE:
      enable(r);
      break;
    case SHUTDOWN:
      write(r, ENABLE, AXIS_OBJ_CONTROLWORD,
            (r->controlword & AXIS_CONTROLWORD_HALT) | CONTROL_ENABLE);
      break;
    case ENABLE:
      modbus_ask(r, STATE_AFTER, MODBUS_READ, AXIS_OBJ_DRIVE_STATE, 0);
      break;
    case STATE_AFTER:
      modbus_end(r, (r->access.value == AXIS_DRIVE_STATE_OPERATION_ENABLED)
                        ? MODBUS_OK
                        : MODBUS_EXCEPTION_STATE);
      break;
    default:
      modbus_end(r, MODBUS_OK);
      break;
  }
}
