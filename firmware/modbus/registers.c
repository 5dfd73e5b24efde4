#include "firmware/modbus/registers.h"

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects.h"
#include "firmware/objects/value.h"

/* Steps of a request that reads or writes registers. Each step waits for the result of one access
 * to an object. */
enum { ORDER_TO_READ, ORDER_TO_WRITE, VALUE, MASKED, CHECK, PREVIOUS, WRITE, TAKE_BACK };

static uint16_t registers_of(uint16_t object) {
  return (value_bytes(axis_objects[object].type) == 4) ? 2 : 1;
}

static uint32_t end_of(const axis_register_t *entry) {
  return (uint32_t)entry->first + registers_of(entry->object);
}

/* Each entry of the register table begins at a register. Returns the last of `count` entries that
 * begins at or before the register `at`, or the first entry if there is none. */
static const axis_register_t *entry_at(const axis_register_t *entries, uint32_t count,
                                       uint32_t at) {
  while (count > 1) {
    const uint32_t half = fx_half(count);
    entries = (entries[half].first <= at) ? entries + half : entries;
    count -= half;
  }
  return entries;
}

/* Selects the entries of the register table that contain the requested registers. Returns false if
 * one of these registers does not exist. */
static bool select_entries(modbus_request_t *r, modbus_table_t table, uint16_t first,
                           uint16_t count) {
  const bool holding = table == MODBUS_HOLDING;
  const axis_register_t *map = holding ? axis_holding : axis_input;
  const uint32_t entries = holding ? AXIS_HOLDING_COUNT : AXIS_INPUT_COUNT;
  const axis_register_t *entry = entry_at(map, entries, first);
  r->first = first;
  r->after = (uint32_t)first + count;
  r->begin = entry;
  r->wide = false;
  for (uint32_t at = first; at < r->after; entry++) {
    if (entry == map + entries || at < entry->first) {
      return false;
    }
    const uint32_t end = end_of(entry);
    if (at >= end) {
      return false;
    }
    r->wide = r->wide || end - entry->first == 2;
    at = end;
  }
  r->end = entry;
  r->entry = r->begin;
  return true;
}

bool modbus_registers_exist(modbus_table_t table, uint16_t first, uint16_t count) {
  modbus_request_t request;
  return select_entries(&request, table, first, count);
}

/* Returns the 16-bit word that register `n` has of a value with `registers` registers. */
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
    modbus_ask(r, VALUE, MODBUS_READ, r->entry->object, 0);
  } else {
    modbus_end(r, MODBUS_OK);
  }
}

/* Appends the registers of the present entry to the answer, as far as they are requested. A request
 * may contain only half of a 32-bit value. */
static void append_value(modbus_request_t *r) {
  const uint16_t registers = registers_of(r->entry->object);
  const uint32_t value = (uint32_t)r->access.value;
  for (uint32_t n = 0; n < registers; n++) {
    const uint32_t at = r->entry->first + n;
    if (registers == 1 || (at >= r->first && at < r->after)) {
      fx_store_be16(r->place, word_of(value, registers, n, r->low_first));
      r->place += 2;
    }
  }
  r->entry++;
}

void modbus_read_registers(modbus_request_t *r, modbus_table_t table, uint16_t first,
                           uint16_t count) {
  if (!select_entries(r, table, first, count)) {
    modbus_end(r, MODBUS_EXCEPTION_ADDRESS);
    return;
  }
  r->part = MODBUS_REGISTERS;
  r->pdu[1] = (uint8_t)(2 * count);
  r->length = (uint16_t)(2 + 2 * count);
  r->place = &r->pdu[2];
  if (r->wide) {
    modbus_ask(r, ORDER_TO_READ, MODBUS_READ, AXIS_OBJ_MODBUS_WORD_ORDER, 0);
  } else {
    next_value(r);
  }
}

/* Returns true if a write to this object acts immediately and cannot be undone. */
static bool is_irreversible(uint16_t object) {
  return object == AXIS_OBJ_CONTROLWORD || object == AXIS_OBJ_MODE ||
         axis_objects[object].block == AXIS_BLOCK_NONE;
}

/* Returns true if a write of `value` to `object` releases the axis to a command source other than
 * Modbus. */
static bool releases_axis(uint16_t object, int32_t value) {
  return object == AXIS_OBJ_COMMAND_SOURCE && value != AXIS_COMMAND_SOURCE_MODBUS;
}

/* Returns true if the request acquires the axis for Modbus. */
static bool acquires_axis(const modbus_request_t *r) {
  const uint8_t *words = r->words;
  for (const axis_register_t *entry = r->begin; entry < r->end; entry++) {
    const uint16_t object = entry->object;
    if (object == AXIS_OBJ_COMMAND_SOURCE) {
      return !releases_axis(object, value_of(words, object, r->low_first));
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
  r->place += 2 * (uint32_t)registers_of(r->entry->object);
  r->entry++;
}

static void ask_for_entry(modbus_request_t *r, uint8_t step, modbus_access_kind_t kind) {
  const uint16_t object = r->entry->object;
  modbus_ask(r, step, kind, object, value_of(r->place, object, r->low_first));
}

static void next_write(modbus_request_t *r) {
  for (;;) {
    while (r->entry < r->end && is_irreversible(r->entry->object) != r->writes_those) {
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
    modbus_ask(r, PREVIOUS, MODBUS_READ, r->entry->object, 0);
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

/* Begins the writes of the request. If there is only one write, no separate check is needed before
 * it. */
static void begin_writes(modbus_request_t *r) {
  if (r->end - r->begin == 1) {
    next_write(r);
  } else {
    next_check(r);
  }
}

static void checked(modbus_request_t *r) {
  const modbus_access_t *access = &r->access;
  if (access->kind == MODBUS_CHECK && access->refusal == FW_ERROR_LOCKED && acquires_axis(r)) {
    /* The request itself acquires the axis, so this write is checked as if Modbus already owned the
     * axis. */
    ask_for_entry(r, CHECK, MODBUS_CHECK_OWNER);
    return;
  }
  if (access->refusal != FW_OK) {
    modbus_end(r, modbus_exception_of(access->refusal));
    return;
  }
  const bool releases = releases_axis(access->object, access->value);
  if (releases && r->entry + 1 < r->end) {
    /* After a write that releases the axis to another bus, Modbus can neither write nor undo
     * anything. */
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
    return;
  }
  if (releases || is_irreversible(access->object)) {
    r->irreversible++;
  }
  go_on(r);
  next_check(r);
}

/* Undoes the writes of the request: restores the previous values of the entries before the present
 * entry, in reverse order. */
static void take_back(modbus_request_t *r) {
  while (r->entry > r->begin) {
    r->entry--;
    const uint16_t object = r->entry->object;
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
      /* At this point all entries of the Modbus request whose write can be undone are already
       * written. */
      go_on(r);
    }
    take_back(r);
    return;
  }
  /* In the request, the previous value of the object replaces the written value. So the write can
   * be undone. */
  for (uint32_t n = 0; n < registers_of(object); n++) {
    fx_store_be16(&r->place[2 * n], word_of(r->previous, registers_of(object), n, r->low_first));
  }
  go_on(r);
  next_write(r);
}

void modbus_write_registers(modbus_request_t *r, uint16_t first, uint16_t count, uint8_t *words) {
  if (!select_entries(r, MODBUS_HOLDING, first, count)) {
    modbus_end(r, MODBUS_EXCEPTION_ADDRESS);
    return;
  }
  if (r->begin->first != first || end_of(r->end - 1) != r->after) {
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
    return;
  }
  r->part = MODBUS_REGISTERS;
  r->words = words;
  r->irreversible = 0;
  r->writes_those = false;
  r->previous = 0;
  go_to_first(r);
  if (r->wide) {
    modbus_ask(r, ORDER_TO_WRITE, MODBUS_READ, AXIS_OBJ_MODBUS_WORD_ORDER, 0);
  } else {
    begin_writes(r);
  }
}

/* Writes the masked value of Modbus function 22. A write to half of a 32-bit object is refused, so
 * for such an object the value of the word has no meaning. */
static void mask(modbus_request_t *r) {
  const uint32_t kept = (uint32_t)r->access.value & r->and_mask;
  const uint32_t given = (uint32_t)r->or_mask & ~(uint32_t)r->and_mask;
  fx_store_be16(r->word, (uint16_t)(kept | given));
  modbus_write_registers(r, (uint16_t)r->first, 1, r->word);
}

void modbus_mask_register(modbus_request_t *r, uint16_t first) {
  if (!select_entries(r, MODBUS_HOLDING, first, 1)) {
    modbus_end(r, MODBUS_EXCEPTION_ADDRESS);
    return;
  }
  r->part = MODBUS_REGISTERS;
  modbus_ask(r, MASKED, MODBUS_READ, r->entry->object, 0);
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
