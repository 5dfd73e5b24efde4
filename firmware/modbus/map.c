#include "firmware/modbus/map.h"

#include <stdbool.h>

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/value.h"

enum { CONTROL_SHUTDOWN = 0x0006, CONTROL_ENABLE = 0x000F, CONTROL_HALT = 0x0100 };

/* The exception that says what dictionary_write() refused. */
static uint8_t exception_of(int refusal) {
  switch (refusal) {
    case FW_OK:
      return MODBUS_OK;
    case FW_ERROR_RANGE:
    case FW_ERROR_MAPPING:
      return MODBUS_EXCEPTION_VALUE;
    case FW_ERROR_STATE:
    case FW_ERROR_NO_DATA:
    case FW_ERROR_LOCKED:
    case FW_ERROR_NO_MEMORY:
      return MODBUS_EXCEPTION_STATE;
    case FW_ERROR_BUSY:
      return MODBUS_EXCEPTION_BUSY;
    default:
      return MODBUS_EXCEPTION_ADDRESS;
  }
}

/* An object that can be read in every state. */
static uint32_t value_of(const dictionary_t *objects, uint16_t object) {
  int32_t value = 0;
  (void)dictionary_read(objects, object, &value);
  return (uint32_t)value;
}

/* --- registers ---------------------------------------------------------------------------------
 */

typedef struct {
  const axis_register_t *entries;
  uint16_t count;
} map_t;

static map_t map_of(modbus_table_t table) {
  return (table == MODBUS_HOLDING) ? (map_t){axis_holding, AXIS_HOLDING_COUNT}
                                   : (map_t){axis_input, AXIS_INPUT_COUNT};
}

static uint16_t registers_of(uint16_t object) {
  return (value_bytes(axis_objects[object].type) == 4) ? 2 : 1;
}

/* The last entry that begins at a register or before it; the first entry where there is none. */
static uint16_t entry_at(map_t map, uint32_t at) {
  uint16_t low = 0;
  uint16_t high = map.count;
  while (high - low > 1) {
    const uint16_t middle = fx_half((uint32_t)low + high);
    if (map.entries[middle].first <= at) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return low;
}

/* Whether each register of first .. end - 1 belongs to an object; the first one to entry i. */
static bool without_holes(map_t map, uint16_t i, uint32_t first, uint32_t end) {
  uint32_t at = first;
  while (at < end) {
    if (i == map.count) {
      return false;
    }
    const uint32_t begin = map.entries[i].first;
    const uint32_t after = begin + registers_of(map.entries[i].object);
    if (at < begin || at >= after) {
      return false;
    }
    at = after;
    i++;
  }
  return true;
}

bool modbus_holds_registers(modbus_table_t table, uint16_t first, uint16_t count) {
  const map_t map = map_of(table);
  return without_holes(map, entry_at(map, first), first, (uint32_t)first + count);
}

static bool is_low_first(const dictionary_t *objects) {
  return value_of(objects, AXIS_OBJ_MODBUS_WORD_ORDER) == AXIS_MODBUS_WORD_ORDER_LOW_FIRST;
}

/* Register `n` of a value that takes `registers` of them. */
static uint16_t word_of(uint32_t value, uint16_t registers, uint32_t n, bool low_first) {
  const bool low = registers == 1 || (n == 1) != low_first;
  return (uint16_t)fx_field(value, low ? 0 : 16, 16);
}

static void put_value(uint8_t *to, uint32_t value, uint16_t registers, bool low_first) {
  for (uint32_t n = 0; n < registers; n++) {
    fx_store_be16(&to[2 * n], word_of(value, registers, n, low_first));
  }
}

static int32_t get_value(const uint8_t *from, uint16_t object, bool low_first) {
  const uint8_t type = axis_objects[object].type;
  const uint32_t first = fx_load_be16(from);
  if (registers_of(object) == 1) {
    const bool is_signed = type == AXIS_TYPE_I8 || type == AXIS_TYPE_I16;
    return is_signed ? fx_sign_extend(first, 16) : (int32_t)first;
  }
  const uint32_t second = fx_load_be16(&from[2]);
  return fx_s32_from_u32(low_first ? second * 65536 + first : first * 65536 + second);
}

uint8_t modbus_read_registers(const dictionary_t *objects, modbus_table_t table, uint16_t first,
                              uint16_t count, uint8_t *to) {
  const map_t map = map_of(table);
  const uint32_t end = (uint32_t)first + count;
  const bool low_first = is_low_first(objects);
  uint16_t i = entry_at(map, first);
  if (!without_holes(map, i, first, end)) {
    return MODBUS_EXCEPTION_ADDRESS;
  }
  for (uint32_t at = first; at < end; i++) {
    const axis_register_t *entry = &map.entries[i];
    const uint16_t registers = registers_of(entry->object);
    const uint32_t value = value_of(objects, entry->object);
    for (; at < end && at < (uint32_t)entry->first + registers; at++) {
      fx_store_be16(to, word_of(value, registers, at - entry->first, low_first));
      to += 2;
    }
  }
  return MODBUS_OK;
}

/* Objects whose write acts at once and cannot be taken back. */
static bool acts_at_once(uint16_t object) {
  return object == AXIS_OBJ_CONTROLWORD || object == AXIS_OBJ_MODE ||
         axis_objects[object].block == AXIS_BLOCK_NONE;
}

/* The objects of a request that writes, in the order of the registers. */
typedef struct {
  uint16_t begin; /* entries of axis_holding */
  uint16_t end;
  bool low_first;
  uint8_t *words; /* of the first one */
} writes_t;

/* Whether the request takes the axis for its bus and goes on. */
static bool takes_axis(const writes_t *writes) {
  const uint8_t *words = writes->words;
  for (uint16_t i = writes->begin; i < writes->end; i++) {
    const uint16_t object = axis_holding[i].object;
    if (object == AXIS_OBJ_COMMAND_SOURCE) {
      return get_value(words, object, writes->low_first) == AXIS_COMMAND_SOURCE_MODBUS;
    }
    words += 2 * (uint32_t)registers_of(object);
  }
  return false;
}

/* What keeps a request from being written that can be known before. */
static uint8_t check_writes(const dictionary_t *objects, const writes_t *writes) {
  const uint8_t *words = writes->words;
  uint16_t acting = 0;
  for (uint16_t i = writes->begin; i < writes->end; i++) {
    const uint16_t object = axis_holding[i].object;
    const int32_t value = get_value(words, object, writes->low_first);
    int refusal = dictionary_check(objects, FW_SOURCE_MODBUS, object, value);
    if (refusal == FW_ERROR_LOCKED && takes_axis(writes)) {
      /* Of what it writes as the owner the rest must be right too, or it would be taken in vain. */
      refusal = dictionary_check(objects, FW_SOURCE_LOCAL, object, value);
    }
    if (refusal != FW_OK) {
      return exception_of(refusal);
    }
    /* Who gives the axis away could write nothing after it, nor take anything back. */
    const bool gives_away =
        object == AXIS_OBJ_COMMAND_SOURCE && value != AXIS_COMMAND_SOURCE_MODBUS;
    if (gives_away && i + 1 < writes->end) {
      return MODBUS_EXCEPTION_VALUE;
    }
    acting = (uint16_t)(acting + ((acts_at_once(object) || gives_away) ? 1 : 0));
    words += 2 * (uint32_t)registers_of(object);
  }
  return (acting > 1) ? MODBUS_EXCEPTION_VALUE : MODBUS_OK;
}

/* Writes one object and leaves its previous value in its place. */
static int exchange(dictionary_t *objects, uint16_t object, uint8_t *words, bool low_first) {
  const uint32_t previous = value_of(objects, object);
  const int32_t value = get_value(words, object, low_first);
  const int refusal = dictionary_write(objects, FW_SOURCE_MODBUS, object, value);
  if (refusal == FW_OK) {
    put_value(words, previous, registers_of(object), low_first);
  }
  return refusal;
}

/* Entries begin .. end - 1 are given their previous values again, the last one first. */
static void take_back(dictionary_t *objects, const writes_t *writes, uint16_t end, uint8_t *words) {
  for (uint16_t i = end; i > writes->begin; i--) {
    const uint16_t object = axis_holding[i - 1].object;
    words -= 2 * (uint32_t)registers_of(object);
    if (!acts_at_once(object)) {
      (void)exchange(objects, object, words, writes->low_first);
    }
  }
}

/* Writes what can be taken back, or what cannot. */
static uint8_t write_some(dictionary_t *objects, const writes_t *writes, bool acting) {
  uint8_t *words = writes->words;
  for (uint16_t i = writes->begin; i < writes->end; i++) {
    const uint16_t object = axis_holding[i].object;
    if (acts_at_once(object) == acting) {
      const int refusal = exchange(objects, object, words, writes->low_first);
      if (refusal != FW_OK) {
        if (!acting) {
          take_back(objects, writes, i, words);
        }
        return exception_of(refusal);
      }
    }
    words += 2 * (uint32_t)registers_of(object);
  }
  return MODBUS_OK;
}

uint8_t modbus_write_registers(dictionary_t *objects, uint16_t first, uint16_t count,
                               uint8_t *words) {
  const map_t map = map_of(MODBUS_HOLDING);
  const uint32_t end = (uint32_t)first + count;
  writes_t writes = {
      .begin = entry_at(map, first), .low_first = is_low_first(objects), .words = words};
  if (!without_holes(map, writes.begin, first, end)) {
    return MODBUS_EXCEPTION_ADDRESS;
  }
  writes.end = (uint16_t)(entry_at(map, end - 1) + 1);
  const axis_register_t *last = &map.entries[writes.end - 1];
  if (map.entries[writes.begin].first != first ||
      (uint32_t)last->first + registers_of(last->object) != end) {
    return MODBUS_EXCEPTION_VALUE;
  }
  uint8_t exception = check_writes(objects, &writes);
  if (exception == MODBUS_OK) {
    exception = write_some(objects, &writes, false);
  }
  if (exception == MODBUS_OK) {
    exception = write_some(objects, &writes, true);
    if (exception != MODBUS_OK) {
      take_back(objects, &writes, writes.end, &words[2 * (uint32_t)count]);
    }
  }
  return exception;
}

uint8_t modbus_mask_register(dictionary_t *objects, uint16_t first, uint16_t and_mask,
                             uint16_t or_mask) {
  uint8_t word[2];
  const uint8_t exception = modbus_read_registers(objects, MODBUS_HOLDING, first, 1, word);
  if (exception != MODBUS_OK) {
    return exception;
  }
  const uint32_t kept = (uint32_t)fx_load_be16(word) & and_mask;
  const uint32_t given = (uint32_t)or_mask & ~(uint32_t)and_mask;
  fx_store_be16(word, (uint16_t)(kept | given));
  return modbus_write_registers(objects, first, 1, word);
}

/* --- coils and discrete inputs -----------------------------------------------------------------
 */

static bool is_enabled(const dictionary_t *objects) {
  return value_of(objects, AXIS_OBJ_DRIVE_STATE) == AXIS_DRIVE_STATE_OPERATION_ENABLED;
}

static bool coil(const dictionary_t *objects, uint32_t n) {
  const uint32_t recorder = value_of(objects, AXIS_OBJ_RECORDER_STATE);
  switch (n) {
    case AXIS_COIL_ENABLE:
      return is_enabled(objects);
    case AXIS_COIL_HALT:
      return (value_of(objects, AXIS_OBJ_CONTROLWORD) & CONTROL_HALT) != 0;
    case AXIS_COIL_STORE:
      return value_of(objects, AXIS_OBJ_STORE_STATE) == AXIS_STORE_STATE_SAVING;
    case AXIS_COIL_RECORDER_TRIGGER:
      return recorder == AXIS_RECORDER_STATE_ARMED || recorder == AXIS_RECORDER_STATE_RECORDING;
    default:
      return false;
  }
}

static bool discrete(const dictionary_t *objects, uint32_t n) {
  switch (n) {
    case AXIS_DISCRETE_LIMIT_ACTIVE:
      return value_of(objects, AXIS_OBJ_LIMIT_REASON) != AXIS_LIMIT_REASON_NONE;
    case AXIS_DISCRETE_CONTACT:
      return value_of(objects, AXIS_OBJ_CONTACT) != 0;
    case AXIS_DISCRETE_LIMIT_CYCLE:
      return value_of(objects, AXIS_OBJ_LIMIT_CYCLE) != 0;
    default:
      return fx_field(value_of(objects, AXIS_OBJ_STATUSWORD), n, 1) != 0;
  }
}

static uint8_t read_bits(const dictionary_t *objects,
                         bool (*bit)(const dictionary_t *objects, uint32_t n), uint32_t all,
                         uint16_t first, uint16_t count, uint8_t *to) {
  if ((uint32_t)first + count > all) {
    return MODBUS_EXCEPTION_ADDRESS;
  }
  for (uint32_t n = 0; n < count; n++) {
    fx_bit_append(to, n, bit(objects, first + n));
  }
  return MODBUS_OK;
}

uint8_t modbus_read_coils(const dictionary_t *objects, uint16_t first, uint16_t count,
                          uint8_t *to) {
  return read_bits(objects, coil, AXIS_COIL_COUNT, first, count, to);
}

uint8_t modbus_read_discretes(const dictionary_t *objects, uint16_t first, uint16_t count,
                              uint8_t *to) {
  return read_bits(objects, discrete, AXIS_DISCRETE_COUNT, first, count, to);
}

static int write_object(dictionary_t *objects, uint16_t object, uint32_t value) {
  return dictionary_write(objects, FW_SOURCE_MODBUS, object, (int32_t)value);
}

/* A request's coils. */
typedef struct {
  bool one[AXIS_COIL_COUNT];
  bool zero[AXIS_COIL_COUNT]; /* neither: not part of the request */
} coils_t;

/* What may be refused although the controlword may be written; at most one such part is there. */
static int write_commands(dictionary_t *objects, const coils_t *coils) {
  if (coils->one[AXIS_COIL_STORE]) {
    return write_object(objects, AXIS_OBJ_STORE_PARAMETERS, 1);
  }
  if (coils->one[AXIS_COIL_RECORDER_TRIGGER]) {
    return write_object(objects, AXIS_OBJ_RECORDER_ARM, 1);
  }
  return FW_OK;
}

/* From any state but a fault to operation enabled. Other bits start new: a set-point or homing that
 * was asked for before is not what this asks for. */
static int enable(dictionary_t *objects) {
  const uint32_t halt = value_of(objects, AXIS_OBJ_CONTROLWORD) & CONTROL_HALT;
  if (is_enabled(objects)) {
    return FW_OK;
  }
  (void)write_object(objects, AXIS_OBJ_CONTROLWORD, halt | CONTROL_SHUTDOWN);
  (void)write_object(objects, AXIS_OBJ_CONTROLWORD, halt | CONTROL_ENABLE);
  return is_enabled(objects) ? FW_OK : FW_ERROR_STATE;
}

static uint8_t carry_out(dictionary_t *objects, const coils_t *coils) {
  const uint32_t state = value_of(objects, AXIS_OBJ_DRIVE_STATE);
  const bool fault = state == AXIS_DRIVE_STATE_FAULT || state == AXIS_DRIVE_STATE_NOT_READY ||
                     state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE;
  if (coils->one[AXIS_COIL_ENABLE] && fault) {
    return MODBUS_EXCEPTION_STATE;
  }
  /* What a save under way would refuse when the rest was done. */
  if (coils->one[AXIS_COIL_STORE] &&
      (coils->one[AXIS_COIL_RECORDER_TRIGGER] || coils->one[AXIS_COIL_ENABLE])) {
    return MODBUS_EXCEPTION_VALUE;
  }
  int refusal = write_commands(objects, coils);
  if (refusal != FW_OK) {
    return exception_of(refusal);
  }
  if (coils->zero[AXIS_COIL_RECORDER_TRIGGER]) {
    (void)write_object(objects, AXIS_OBJ_RECORDER_ARM, 0);
  }
  if (coils->one[AXIS_COIL_FAULT_RESET]) {
    (void)write_object(objects, AXIS_OBJ_FAULT_RESET, 1);
  }
  const uint32_t other = value_of(objects, AXIS_OBJ_CONTROLWORD) & ~(uint32_t)CONTROL_HALT;
  if (coils->one[AXIS_COIL_HALT]) {
    (void)write_object(objects, AXIS_OBJ_CONTROLWORD, other | CONTROL_HALT);
  } else if (coils->zero[AXIS_COIL_HALT]) {
    (void)write_object(objects, AXIS_OBJ_CONTROLWORD, other);
  }
  if (coils->one[AXIS_COIL_ENABLE]) {
    refusal = enable(objects);
  } else if (coils->zero[AXIS_COIL_ENABLE]) {
    const uint32_t halt = value_of(objects, AXIS_OBJ_CONTROLWORD) & CONTROL_HALT;
    refusal = write_object(objects, AXIS_OBJ_CONTROLWORD, halt | CONTROL_SHUTDOWN);
  }
  return exception_of(refusal);
}

uint8_t modbus_write_coils(dictionary_t *objects, uint16_t first, uint16_t count,
                           const uint8_t *bits) {
  if ((uint32_t)first + count > AXIS_COIL_COUNT) {
    return MODBUS_EXCEPTION_ADDRESS;
  }
  const int32_t word = (int32_t)value_of(objects, AXIS_OBJ_CONTROLWORD);
  const int refusal = dictionary_check(objects, FW_SOURCE_MODBUS, AXIS_OBJ_CONTROLWORD, word);
  if (refusal != FW_OK) {
    return exception_of(refusal);
  }
  coils_t coils;
  for (uint32_t n = 0; n < AXIS_COIL_COUNT; n++) {
    const bool part = n >= first && n < (uint32_t)first + count;
    const bool one = part && fx_bit_get(bits, n - first);
    coils.one[n] = one;
    coils.zero[n] = part && !one;
  }
  return carry_out(objects, &coils);
}
