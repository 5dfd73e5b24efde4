#include "firmware/modbus/request.h"

#include "firmware/fx/bytes.h"
#include "firmware/modbus/map.h"

/* The longest runs that the protocol allows. */
enum {
  READ_BITS_MAX = 2000,
  WRITE_BITS_MAX = 1968,
  READ_REGISTERS_MAX = 125,
  WRITE_REGISTERS_MAX = 123,
  EXCHANGE_REGISTERS_MAX = 121
};

enum { COIL_ON = 0xFF00, COIL_OFF = 0x0000, TEXT_MAX = 30 };

/* Where things lie in a frame: unit, function, then two words in most of them. */
enum { UNIT = 0, FUNCTION = 1, DATA = 2, SECOND = 4, THIRD = 6, BYTES_CRC = 2 };

typedef struct {
  modbus_t *modbus;
  dictionary_t *objects;
  uint8_t *frame;
  uint16_t length; /* of the request, without CRC */
  uint16_t answer; /* of the answer, without CRC */
} request_t;

uint16_t modbus_request_bytes(const uint8_t *frame, uint16_t length) {
  if (length < 2) {
    return MODBUS_BYTES_MORE;
  }
  switch (frame[FUNCTION]) {
    case 1:
    case 2:
    case 3:
    case 4:
    case 5:
    case 6:
    case 8:
      return 8;
    case 15:
    case 16:
      return (length <= 6) ? MODBUS_BYTES_MORE : (uint16_t)(9 + frame[6]);
    case 17:
      return 4;
    case 22:
      return 10;
    case 23:
      return (length <= 10) ? MODBUS_BYTES_MORE : (uint16_t)(13 + frame[10]);
    case 43:
      return 7;
    default:
      return MODBUS_BYTES_OPEN;
  }
}

static uint8_t read_bits(request_t *r) {
  const uint16_t first = fx_load_be16(&r->frame[DATA]);
  const uint16_t count = fx_load_be16(&r->frame[SECOND]);
  if (count == 0 || count > READ_BITS_MAX) {
    return MODBUS_EXCEPTION_VALUE;
  }
  r->frame[2] = (uint8_t)fx_octets(count);
  r->answer = (uint16_t)(3 + fx_octets(count));
  return (r->frame[FUNCTION] == 1) ? modbus_read_coils(r->objects, first, count, &r->frame[3])
                                   : modbus_read_discretes(r->objects, first, count, &r->frame[3]);
}

static uint8_t read_registers(request_t *r, modbus_table_t table, uint16_t first, uint16_t count) {
  if (count == 0 || count > READ_REGISTERS_MAX) {
    return MODBUS_EXCEPTION_VALUE;
  }
  r->frame[2] = (uint8_t)(2 * count);
  r->answer = (uint16_t)(3 + 2 * count);
  return modbus_read_registers(r->objects, table, first, count, &r->frame[3]);
}

static uint8_t write_coil(request_t *r) {
  const uint16_t value = fx_load_be16(&r->frame[SECOND]);
  const uint8_t bit = (value == COIL_ON) ? 1 : 0;
  if (value != COIL_ON && value != COIL_OFF) {
    return MODBUS_EXCEPTION_VALUE;
  }
  r->answer = 6;
  return modbus_write_coils(r->objects, fx_load_be16(&r->frame[DATA]), 1, &bit);
}

static uint8_t write_coils(request_t *r) {
  const uint16_t count = fx_load_be16(&r->frame[SECOND]);
  if (count == 0 || count > WRITE_BITS_MAX || r->frame[THIRD] != fx_octets(count)) {
    return MODBUS_EXCEPTION_VALUE;
  }
  r->answer = 6;
  return modbus_write_coils(r->objects, fx_load_be16(&r->frame[DATA]), count, &r->frame[7]);
}

/* The answer repeats the request, which the write uses up. */
static uint8_t write_register(request_t *r) {
  uint8_t word[2] = {r->frame[SECOND], r->frame[SECOND + 1]};
  r->answer = 6;
  return modbus_write_registers(r->objects, fx_load_be16(&r->frame[DATA]), 1, word);
}

static uint8_t write_registers(request_t *r) {
  const uint16_t count = fx_load_be16(&r->frame[SECOND]);
  if (count == 0 || count > WRITE_REGISTERS_MAX || r->frame[THIRD] != 2 * count) {
    return MODBUS_EXCEPTION_VALUE;
  }
  r->answer = 6;
  return modbus_write_registers(r->objects, fx_load_be16(&r->frame[DATA]), count, &r->frame[7]);
}

static uint8_t mask_register(request_t *r) {
  r->answer = 8;
  return modbus_mask_register(r->objects, fx_load_be16(&r->frame[DATA]),
                              fx_load_be16(&r->frame[SECOND]), fx_load_be16(&r->frame[THIRD]));
}

/* The range that is read is looked up first, so that a request whose answer would be an exception
 * has written nothing. */
static uint8_t exchange_registers(request_t *r) {
  const uint16_t first = fx_load_be16(&r->frame[DATA]);
  const uint16_t count = fx_load_be16(&r->frame[SECOND]);
  const uint16_t write_first = fx_load_be16(&r->frame[6]);
  const uint16_t write_count = fx_load_be16(&r->frame[8]);
  if (count == 0 || count > READ_REGISTERS_MAX || write_count == 0 ||
      write_count > EXCHANGE_REGISTERS_MAX || r->frame[10] != 2 * write_count) {
    return MODBUS_EXCEPTION_VALUE;
  }
  if (!modbus_holds_registers(MODBUS_HOLDING, first, count)) {
    return MODBUS_EXCEPTION_ADDRESS;
  }
  const uint8_t exception =
      modbus_write_registers(r->objects, write_first, write_count, &r->frame[11]);
  return (exception == MODBUS_OK) ? read_registers(r, MODBUS_HOLDING, first, count) : exception;
}

static uint8_t diagnose(request_t *r) {
  const uint16_t what = fx_load_be16(&r->frame[DATA]);
  r->answer = r->length;
  if (what == 0) {
    return MODBUS_OK;
  }
  if (what != 10 && (what < MODBUS_COUNTER_FIRST ||
                     what >= (uint16_t)MODBUS_COUNTER_FIRST + (uint16_t)MODBUS_COUNTERS)) {
    return MODBUS_EXCEPTION_FUNCTION;
  }
  if (r->length != 6 || fx_load_be16(&r->frame[SECOND]) != 0) {
    return MODBUS_EXCEPTION_VALUE;
  }
  if (what == 10) {
    modbus_clear_counters(r->modbus);
  } else {
    fx_store_be16(&r->frame[SECOND], r->modbus->counters[what - MODBUS_COUNTER_FIRST]);
  }
  return MODBUS_OK;
}

/* Appends a text, cut at TEXT_MAX characters; returns how many. */
static uint8_t append_text(request_t *r, const char *text) {
  uint8_t n = 0;
  while (n < TEXT_MAX && text[n] != 0) {
    r->frame[r->answer + n] = (uint8_t)text[n];
    n++;
  }
  r->answer = (uint16_t)(r->answer + n);
  return n;
}

static uint8_t report_server(request_t *r) {
  int32_t state = 0;
  (void)dictionary_read(r->objects, AXIS_OBJ_DRIVE_STATE, &state);
  r->frame[3] = r->frame[UNIT];
  r->frame[4] = (state == AXIS_DRIVE_STATE_OPERATION_ENABLED) ? 0xFF : 0x00;
  r->answer = 5;
  r->frame[2] = (uint8_t)(2 + append_text(r, dictionary_text(r->objects, 0x1008)));
  return MODBUS_OK;
}

/* Objects of the device identification, by number; 0 is the first. */
static const uint8_t identities[] = {0x00, 0x01, 0x02, 0x04, 0x05, 0x80};
enum { IDENTITIES = sizeof(identities) };

static const char *identity_text(const dictionary_t *objects, uint8_t number) {
  switch (number) {
    case 0x02:
      return dictionary_text(objects, 0x100A);
    case 0x05:
      return dictionary_text(objects, 0x1009);
    case 0x80:
      return AXIS_OBJECTS_HASH_TEXT;
    default:
      return dictionary_text(objects, 0x1008);
  }
}

static void append_identity(request_t *r, uint8_t number) {
  const uint16_t at = r->answer;
  r->answer = (uint16_t)(r->answer + 2);
  r->frame[at] = number;
  r->frame[at + 1] = append_text(r, identity_text(r->objects, number));
  r->frame[7] = (uint8_t)(r->frame[7] + 1);
}

/* The last object of a category: basic, regular, extended. */
static uint8_t identity_end(uint8_t category) {
  switch (category) {
    case 1:
      return 0x02;
    case 2:
      return 0x7F;
    default:
      return 0xFF;
  }
}

static bool is_identity(uint8_t number) {
  bool found = false;
  for (uint8_t i = 0; i < IDENTITIES; i++) {
    found = found || identities[i] == number;
  }
  return found;
}

static uint8_t identify(request_t *r) {
  const uint8_t category = r->frame[3];
  const uint8_t number = r->frame[4];
  if (r->frame[2] != 14) {
    return MODBUS_EXCEPTION_FUNCTION;
  }
  if (category < 1 || category > 4) {
    return MODBUS_EXCEPTION_VALUE;
  }
  if (category == 4 && !is_identity(number)) {
    return MODBUS_EXCEPTION_ADDRESS;
  }
  r->frame[4] = 0x83; /* all categories, and single objects */
  r->frame[5] = 0;    /* nothing follows: all of them fit */
  r->frame[6] = 0;
  r->frame[7] = 0;
  r->answer = 8;
  if (category == 4) {
    append_identity(r, number);
    return MODBUS_OK;
  }
  /* An unknown first object begins with the first one of all. */
  const uint8_t first = is_identity(number) ? number : 0;
  for (uint8_t i = 0; i < IDENTITIES; i++) {
    if (identities[i] >= first && identities[i] <= identity_end(category)) {
      append_identity(r, identities[i]);
    }
  }
  return MODBUS_OK;
}

static uint8_t carry_out(request_t *r) {
  const uint8_t *frame = r->frame;
  const uint16_t bytes = modbus_request_bytes(frame, r->length);
  if (bytes == MODBUS_BYTES_OPEN) {
    return MODBUS_EXCEPTION_FUNCTION;
  }
  /* Only an echo may be of any length. */
  const bool echo = frame[FUNCTION] == 8 && r->length >= SECOND;
  if (r->length + BYTES_CRC != bytes && !echo) {
    return MODBUS_EXCEPTION_VALUE;
  }
  switch (frame[FUNCTION]) {
    case 1:
    case 2:
      return read_bits(r);
    case 3:
      return read_registers(r, MODBUS_HOLDING, fx_load_be16(&frame[DATA]),
                            fx_load_be16(&frame[SECOND]));
    case 4:
      return read_registers(r, MODBUS_INPUT, fx_load_be16(&frame[DATA]),
                            fx_load_be16(&frame[SECOND]));
    case 5:
      return write_coil(r);
    case 6:
      return write_register(r);
    case 8:
      return diagnose(r);
    case 15:
      return write_coils(r);
    case 16:
      return write_registers(r);
    case 17:
      return report_server(r);
    case 22:
      return mask_register(r);
    case 23:
      return exchange_registers(r);
    default:
      return identify(r);
  }
}

static void count(modbus_t *modbus, uint8_t which) {
  modbus->counters[which] = (uint16_t)(modbus->counters[which] + 1);
}

uint16_t modbus_request_serve(modbus_t *modbus, dictionary_t *objects, uint16_t length) {
  request_t r = {.modbus = modbus, .objects = objects, .frame = modbus->frame, .length = length};
  count(modbus, MODBUS_COUNT_SERVED);
  const uint8_t exception = carry_out(&r);
  if (exception == MODBUS_OK) {
    return r.answer;
  }
  count(modbus, MODBUS_COUNT_EXCEPTIONS);
  if (exception == MODBUS_EXCEPTION_BUSY) {
    count(modbus, MODBUS_COUNT_BUSY);
  }
  r.frame[FUNCTION] = (uint8_t)(r.frame[FUNCTION] | 0x80u);
  r.frame[DATA] = exception;
  return 3;
}
