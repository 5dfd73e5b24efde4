#include "firmware/modbus/registers.h"

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/value.h"

/* The access that a request waits for. */
enum { ORDER_TO_READ, ORDER_TO_WRITE, VALUE, MASKED, CHECK, PREVIOUS, WRITE, TAKE_BACK };

typedef struct {
  const axis_register_t *entries;
  uint16_t count;
} map_t;

static map_t map_of(uint8_t table) {
  return (table == MODBUS_HOLDING) ? (map_t){axis_holding, AXIS_HOLDING_COUNT}
                                   : (map_t){axis_input, AXIS_INPUT_COUNT};
}

static uint16_t registers_of(uint16_t object) {
  return (value_bytes(axis_objects[object].type) == 4) ? 2 : 1;
}

static uint32_t end_of(const axis_register_t *entry) {
  return (uint32_t)entry->first + registers_of(entry->object);
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

bool modbus_registers_exist(modbus_table_t table, uint16_t first, uint16_t count) {
  const map_t map = map_of((uint8_t)table);
  const uint32_t end = (uint32_t)first + count;
  uint32_t at = first;
  for (uint16_t i = entry_at(map, at); at < end; i++) {
    if (i == map.count || at < map.entries[i].first || at >= end_of(&map.entries[i])) {
      return false;
    }
    at = end_of(&map.entries[i]);
  }
  return true;
}

/* Finds the entries of registers that exist. */
static void select_entries(modbus_request_t *r, modbus_table_t table, uint16_t first,
                           uint16_t count) {
  const map_t map = map_of((uint8_t)table);
  r->table = (uint8_t)table;
  r->first = first;
  r->after = (uint32_t)first + count;
  r->begin = entry_at(map, r->first);
  r->end = (uint16_t)(entry_at(map, r->after - 1) + 1);
  r->entry = r->begin;
}

static const axis_register_t *entry_of(const modbus_request_t *r) {
  return map_of(r->table).entries + r->entry;
}

static bool has_32_bits(const modbus_request_t *r) {
  bool found = false;
  for (uint16_t i = r->begin; i < r->end; i++) {
    found = found || registers_of(map_of(r->table).entries[i].object) == 2;
  }
  return found;
}

/* Register `n` of a value that takes `registers` of them. */
static uint16_t word_of(uint32_t value, uint16_t registers, uint32_t n, bool low_first) {
  const bool low = registers == 1 || (n == 1) != low_first;
  return (uint16_t)fx_field(value, low ? 0 : 16, 16);
}

static int32_t value_of(const uint8_t *words, uint16_t object, bool low_first) {
  const uint8_t type = axis_objects[object].type;
  const uint32_t first = fx_load_be16(words);
  if (registers_of(object) == 1) {
    const bool is_signed = type == AXIS_TYPE_I8 || type == AXIS_TYPE_I16;
    return is_signed ? fx_sign_extend(first, 16) : (int32_t)first;
  }
  const uint32_t second = fx_load_be16(&words[2]);
  return fx_s32_from_u32(low_first ? second * 65536 + first : first * 65536 + second);
}

static void next_value(modbus_request_t *r) {
  if (r->entry < r->end) {
    modbus_ask(r, VALUE, MODBUS_READ, entry_of(r)->object, 0);
  } else {
    modbus_end(r, MODBUS_OK);
  }
}

/* What of the entry's value is asked for. */
static void append_value(modbus_request_t *r) {
  const axis_register_t *entry = entry_of(r);
  for (uint32_t at = entry->first; at < end_of(entry); at++) {
    if (at >= r->first && at < r->after) {
      const uint32_t value = (uint32_t)r->access.value;
      fx_store_be16(r->place,
                    word_of(value, registers_of(entry->object), at - entry->first, r->low_first));
      r->place += 2;
    }
  }
  r->entry++;
}

void modbus_read_registers(modbus_request_t *r, modbus_table_t table, uint16_t first,
                           uint16_t count) {
  if (!modbus_registers_exist(table, first, count)) {
    modbus_end(r, MODBUS_EXCEPTION_ADDRESS);
    return;
  }
  select_entries(r, table, first, count);
  r->part = MODBUS_REGISTERS;
  r->pdu[1] = (uint8_t)(2 * count);
  r->length = (uint16_t)(2 + 2 * count);
  r->place = &r->pdu[2];
  if (has_32_bits(r)) {
    modbus_ask(r, ORDER_TO_READ, MODBUS_READ, AXIS_OBJ_MODBUS_WORD_ORDER, 0);
  } else {
    next_value(r);
  }
}

/* Whether a write acts at once and cannot be taken back. */
static bool is_irreversible(uint16_t object) {
  return object == AXIS_OBJ_CONTROLWORD || object == AXIS_OBJ_MODE ||
         axis_objects[object].block == AXIS_BLOCK_NONE;
}

/* Whether a write leaves the axis to another source. */
static bool gives_axis_away(uint16_t object, int32_t value) {
  return object == AXIS_OBJ_COMMAND_SOURCE && value != AXIS_COMMAND_SOURCE_MODBUS;
}

/* Whether the request takes the axis for Modbus. */
static bool takes_axis(const modbus_request_t *r) {
  const uint8_t *words = r->words;
  for (uint16_t i = r->begin; i < r->end; i++) {
    const uint16_t object = axis_holding[i].object;
    if (object == AXIS_OBJ_COMMAND_SOURCE) {
      return !gives_axis_away(object, value_of(words, object, r->low_first));
    }
    words += 2 * (uint32_t)registers_of(object);
  }
  return false;
}

static void go_to_first(modbus_request_t *r) {
  r->entry = r->begin;
  r->place = r->words;
}

static void go_on(modbus_request_t *r) {
  r->place += 2 * (uint32_t)registers_of(entry_of(r)->object);
  r->entry++;
}

static void ask_for_entry(modbus_request_t *r, uint8_t step, modbus_access_kind_t kind) {
  const uint16_t object = entry_of(r)->object;
  modbus_ask(r, step, kind, object, value_of(r->place, object, r->low_first));
}

static void next_write(modbus_request_t *r) {
  for (;;) {
    while (r->entry < r->end && is_irreversible(entry_of(r)->object) != r->writes_those) {
      go_on(r);
    }
    if (r->entry < r->end) {
      break;
    }
    if (r->writes_those) {
      if (r->read_count == 0) {
        modbus_end(r, MODBUS_OK);
      } else {
        modbus_read_registers(r, MODBUS_HOLDING, r->read_first, r->read_count);
      }
      return;
    }
    r->writes_those = true;
    go_to_first(r);
  }
  if (r->writes_those || r->end - r->begin == 1) {
    ask_for_entry(r, WRITE, MODBUS_WRITE);
  } else {
    modbus_ask(r, PREVIOUS, MODBUS_READ, entry_of(r)->object, 0);
  }
}

static void next_check(modbus_request_t *r) {
  if (r->entry < r->end) {
    ask_for_entry(r, CHECK, MODBUS_CHECK);
  } else if (r->irreversible > 1) {
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
  } else {
    go_to_first(r);
    next_write(r);
  }
}

/* One alone needs no check before: its write is the check. */
static void begin_writes(modbus_request_t *r) {
  if (r->end - r->begin == 1) {
    next_write(r);
  } else {
    next_check(r);
  }
}

static void checked(modbus_request_t *r) {
  const modbus_access_t *access = &r->access;
  if (access->kind == MODBUS_CHECK && access->refusal == FW_ERROR_LOCKED && takes_axis(r)) {
    /* What it writes as the owner must be right too, or the axis would be taken in vain. */
    ask_for_entry(r, CHECK, MODBUS_CHECK_OWNER);
    return;
  }
  if (access->refusal != FW_OK) {
    modbus_end(r, modbus_exception_of(access->refusal));
    return;
  }
  const bool gives_away = gives_axis_away(access->object, access->value);
  if (gives_away && r->entry + 1 < r->end) {
    /* Nothing could be written after it, nor taken back. */
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
    return;
  }
  if (gives_away || is_irreversible(access->object)) {
    r->irreversible++;
  }
  go_on(r);
  next_check(r);
}

/* The entries before the one under way are given their previous values again, the last one first.
 */
static void take_back(modbus_request_t *r) {
  while (r->entry > r->begin) {
    r->entry--;
    const uint16_t object = entry_of(r)->object;
    r->place -= 2 * (uint32_t)registers_of(object);
    if (!is_irreversible(object)) {
      ask_for_entry(r, TAKE_BACK, MODBUS_WRITE);
      return;
    }
  }
  modbus_end(r, r->exception);
}

static void written(modbus_request_t *r) {
  const uint16_t object = r->access.object;
  if (r->access.refusal != FW_OK) {
    r->exception = modbus_exception_of(r->access.refusal);
    while (r->writes_those && r->entry < r->end) {
      go_on(r); /* all others are written */
    }
    take_back(r);
    return;
  }
  /* Its previous value takes the place of the one that was written. */
  for (uint32_t n = 0; n < registers_of(object); n++) {
    fx_store_be16(&r->place[2 * n], word_of(r->previous, registers_of(object), n, r->low_first));
  }
  go_on(r);
  next_write(r);
}

void modbus_write_registers(modbus_request_t *r, uint16_t first, uint16_t count, uint8_t *words) {
  if (!modbus_registers_exist(MODBUS_HOLDING, first, count)) {
    modbus_end(r, MODBUS_EXCEPTION_ADDRESS);
    return;
  }
  select_entries(r, MODBUS_HOLDING, first, count);
  if (axis_holding[r->begin].first != first || end_of(&axis_holding[r->end - 1]) != r->after) {
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
    return;
  }
  r->part = MODBUS_REGISTERS;
  r->words = words;
  r->irreversible = 0;
  r->writes_those = false;
  r->previous = 0;
  go_to_first(r);
  if (has_32_bits(r)) {
    modbus_ask(r, ORDER_TO_WRITE, MODBUS_READ, AXIS_OBJ_MODBUS_WORD_ORDER, 0);
  } else {
    begin_writes(r);
  }
}

/* Of half a 32-bit object the word is of no matter: the write refuses it. */
static void mask(modbus_request_t *r) {
  const uint32_t kept = (uint32_t)r->access.value & r->and_mask;
  const uint32_t given = (uint32_t)r->or_mask & ~(uint32_t)r->and_mask;
  fx_store_be16(r->word, (uint16_t)(kept | given));
  modbus_write_registers(r, (uint16_t)r->first, 1, r->word);
}

void modbus_mask_register(modbus_request_t *r, uint16_t first) {
  if (!modbus_registers_exist(MODBUS_HOLDING, first, 1)) {
    modbus_end(r, MODBUS_EXCEPTION_ADDRESS);
    return;
  }
  select_entries(r, MODBUS_HOLDING, first, 1);
  r->part = MODBUS_REGISTERS;
  modbus_ask(r, MASKED, MODBUS_READ, entry_of(r)->object, 0);
}

void modbus_registers_resume(modbus_request_t *r) {
  switch (r->step) {
    case ORDER_TO_READ:
      r->low_first = r->access.value == AXIS_MODBUS_WORD_ORDER_LOW_FIRST;
      next_value(r);
      break;
    case ORDER_TO_WRITE:
      r->low_first = r->access.value == AXIS_MODBUS_WORD_ORDER_LOW_FIRST;
      begin_writes(r);
      break;
    case VALUE:
      append_value(r);
      next_value(r);
      break;
    case MASKED:
      mask(r);
      break;
    case CHECK:
      checked(r);
      break;
    case PREVIOUS:
      r->previous = (uint32_t)r->access.value;
      ask_for_entry(r, WRITE, MODBUS_WRITE);
      break;
    case WRITE:
      written(r);
      break;
    default:
      take_back(r);
      break;
  }
}
