#include "firmware/modbus/request.h"

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/modbus/bits.h"
#include "firmware/modbus/identity.h"
#include "firmware/modbus/registers.h"

/* Largest numbers of registers and coils that the Modbus protocol permits in one request. */
enum {
  READ_BITS_MAX = 2000,
  WRITE_BITS_MAX = 1968,
  READ_REGISTERS_MAX = 125,
  WRITE_REGISTERS_MAX = 123,
  EXCHANGE_REGISTERS_MAX = 121
};

enum { COIL_ON = 0xFF00, COIL_OFF = 0x0000 };

/* Offsets in bytes of the fields of a PDU: the function code, then fields of 16 bits. */
enum { FUNCTION = 0, FIRST = 1, SECOND = 3, THIRD = 5, FOURTH = 7 };

uint16_t modbus_request_bytes(const uint8_t *pdu, uint16_t length) {
  if (length < 1) {
    return MODBUS_BYTES_MORE;
  }
  switch (pdu[FUNCTION]) {
    case 1:
    case 2:
    case 3:
    case 4:
    case 5:
    case 6:
    case 8:
      return 5;
    case 15:
    case 16:
      return (length <= 5) ? MODBUS_BYTES_MORE : (uint16_t)(6 + pdu[5]);
    case 17:
      return 1;
    case 22:
      return 7;
    case 23:
      return (length <= 9) ? MODBUS_BYTES_MORE : (uint16_t)(10 + pdu[9]);
    case 43:
      return 4;
    default:
      return MODBUS_BYTES_OPEN;
  }
}

static void read_bits(modbus_request_t *r, uint16_t first, uint16_t count) {
  if (count == 0 || count > READ_BITS_MAX) {
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
  } else if (r->pdu[FUNCTION] == 1) {
    modbus_read_coils(r, first, count);
  } else {
    modbus_read_discretes(r, first, count);
  }
}

static void read_registers(modbus_request_t *r, uint16_t first, uint16_t count) {
  if (count == 0 || count > READ_REGISTERS_MAX) {
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
  } else {
    modbus_read_registers(r, (r->pdu[FUNCTION] == 3) ? MODBUS_HOLDING : MODBUS_INPUT, first, count);
  }
}

static void write_coil(modbus_request_t *r, uint16_t first, uint16_t value) {
  const uint8_t bit = (value == COIL_ON) ? 1 : 0;
  if (value != COIL_ON && value != COIL_OFF) {
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
  } else {
    modbus_write_coils(r, first, 1, &bit);
  }
}

static void write_coils(modbus_request_t *r, uint16_t first, uint16_t count) {
  r->length = 5;
  if (count == 0 || count > WRITE_BITS_MAX || r->pdu[THIRD] != fx_octets(count)) {
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
  } else {
    modbus_write_coils(r, first, count, &r->pdu[6]);
  }
}

/* Writes a register with a copy of the value in the request. A copy is necessary, because
 * modbus_write_registers() overwrites its words, and the response must repeat the request. */
static void write_register(modbus_request_t *r, uint16_t first, uint16_t value) {
  fx_store_be16(r->word, value);
  modbus_write_registers(r, first, 1, r->word);
}

static void write_registers(modbus_request_t *r, uint16_t first, uint16_t count) {
  r->length = 5;
  if (count == 0 || count > WRITE_REGISTERS_MAX || r->pdu[THIRD] != 2 * count) {
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
  } else {
    modbus_write_registers(r, first, count, &r->pdu[6]);
  }
}

static void mask_register(modbus_request_t *r, uint16_t first, uint16_t and_mask) {
  r->and_mask = and_mask;
  r->or_mask = fx_load_be16(&r->pdu[THIRD]);
  modbus_mask_register(r, first);
}

/* Modbus function 23: writes registers, then reads registers. The registers that will be read are
 * checked first, so that a request with an exception writes nothing. */
static void exchange_registers(modbus_request_t *r, uint16_t first, uint16_t count) {
  const uint16_t write_first = fx_load_be16(&r->pdu[THIRD]);
  const uint16_t write_count = fx_load_be16(&r->pdu[FOURTH]);
  if (count == 0 || count > READ_REGISTERS_MAX || write_count == 0 ||
      write_count > EXCHANGE_REGISTERS_MAX || r->pdu[9] != 2 * write_count) {
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
  } else if (!modbus_registers_exist(MODBUS_HOLDING, first, count)) {
    modbus_end(r, MODBUS_EXCEPTION_ADDRESS);
  } else {
    r->read_first = first;
    r->read_count = count;
    modbus_write_registers(r, write_first, write_count, &r->pdu[10]);
  }
}

static void diagnose(modbus_request_t *r, uint16_t what) {
  const uint16_t counter = (uint16_t)(what - MODBUS_COUNTER_FIRST);
  uint8_t exception = MODBUS_OK;
  if (what != 0 && what != 10 && counter >= (uint16_t)MODBUS_COUNTERS) {
    exception = MODBUS_EXCEPTION_FUNCTION;
  } else if (what != 0 && (r->length != 5 || fx_load_be16(&r->pdu[SECOND]) != 0)) {
    exception = MODBUS_EXCEPTION_VALUE;
  } else if (what == 10) {
    for (uint8_t i = 0; i < MODBUS_COUNTERS; i++) {
      r->counters[i] = 0;
    }
  } else if (what != 0) {
    fx_store_be16(&r->pdu[SECOND], r->counters[counter]);
  }
  modbus_end(r, exception);
}

/* Begins to execute a Modbus request whose length matches its function code. */
static void begin(modbus_request_t *r) {
  const uint16_t first = (r->length < SECOND) ? 0 : fx_load_be16(&r->pdu[FIRST]);
  const uint16_t second = (r->length < THIRD) ? 0 : fx_load_be16(&r->pdu[SECOND]);
  switch (r->pdu[FUNCTION]) {
    case 1:
    case 2:
      read_bits(r, first, second);
      break;
    case 3:
    case 4:
      read_registers(r, first, second);
      break;
    case 5:
      write_coil(r, first, second);
      break;
    case 6:
      write_register(r, first, second);
      break;
    case 8:
      diagnose(r, first);
      break;
    case 15:
      write_coils(r, first, second);
      break;
    case 16:
      write_registers(r, first, second);
      break;
    case 17:
      modbus_report_server(r);
      break;
    case 22:
      mask_register(r, first, second);
      break;
    case 23:
      exchange_registers(r, first, second);
      break;
    default:
      modbus_identify(r);
      break;
  }
}

void modbus_request_begin(modbus_request_t *r, uint8_t unit, uint8_t *pdu, uint16_t length,
                          uint16_t *counters) {
  r->part = MODBUS_ENDED;
  r->unit = unit;
  r->pdu = pdu;
  r->length = length;
  r->counters = counters;
  r->low_first = false;
  r->read_count = 0;
  counters[MODBUS_COUNT_SERVED] = (uint16_t)(counters[MODBUS_COUNT_SERVED] + 1);
  const uint16_t bytes = modbus_request_bytes(pdu, length);
  /* Only an echo request (function 8) may have an arbitrary length. */
  const bool echo = pdu[FUNCTION] == 8 && length >= SECOND;
  if (bytes == MODBUS_BYTES_OPEN) {
    modbus_end(r, MODBUS_EXCEPTION_FUNCTION);
  } else if (length != bytes && !echo) {
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
  } else {
    begin(r);
  }
}

void modbus_request_resume(modbus_request_t *r) {
  const modbus_access_t *access = &r->access;
  const bool reads = access->kind == MODBUS_READ || access->kind == MODBUS_READ_TEXT;
  /* For an object that can only be written, the answer contains the value 0. */
  if (reads && access->refusal != FW_OK && access->refusal != FW_ERROR_WRITE_ONLY) {
    modbus_end(r, modbus_exception_of(access->refusal));
    return;
  }
  switch (r->part) {
    case MODBUS_REGISTERS:
      modbus_registers_resume(r);
      break;
    case MODBUS_BITS:
      modbus_bits_resume(r);
      break;
    default:
      modbus_identity_resume(r);
      break;
  }
}
