#ifndef FIRMWARE_MODBUS_STEP_H_
#define FIRMWARE_MODBUS_STEP_H_

/* A Modbus request in progress: its present access to an object, and the step with which the
 * request continues after this access. Code that only uses Modbus requests includes only
 * request.h. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/access.h"

enum {
  MODBUS_OK = 0,
  MODBUS_EXCEPTION_FUNCTION = 1, /* Modbus exception: the function or sub-function is unknown */
  /* Modbus exception: there is no such register, coil or discrete input */
  MODBUS_EXCEPTION_ADDRESS = 2,
  /* the value is out of range, the write is to half of a 32-bit object, or the request is
   * malformed */
  MODBUS_EXCEPTION_VALUE = 3,
  MODBUS_EXCEPTION_STATE =
      /* the access is refused, because the state of the axis forbids it or another command source
       * owns it */
  4,
  MODBUS_EXCEPTION_BUSY = 6,   /* the parameter store is busy */
  MODBUS_EXCEPTION_PATH = 10,  /* Modbus exception: the gateway has no axis with this unit */
  MODBUS_EXCEPTION_TARGET = 11 /* Modbus exception: the axis does not answer the gateway */
};

/* Counters of Modbus function 8, indexed by the sub-function minus MODBUS_COUNTER_FIRST. A counter
 * restarts at 0 after 65535. */
enum {
  MODBUS_COUNTER_FIRST = 11,
  MODBUS_COUNT_MESSAGES = 0, /* number of complete Modbus frames that were received, to any unit */
  MODBUS_COUNT_ERRORS = 1,   /* number of frames that were damaged, interrupted or too long */
  /* number of Modbus answers with an exception, plus number of refused broadcasts */
  MODBUS_COUNT_EXCEPTIONS = 2,
  MODBUS_COUNT_SERVED = 3, /* number of Modbus requests to this unit, plus number of broadcasts */
  MODBUS_COUNT_UNANSWERED = 4, /* number of broadcasts */
  /* number of answers with the Modbus exception 7 (negative acknowledge); always 0 */
  MODBUS_COUNT_NAK = 5,
  /* number of requests that were refused with the Modbus exception 6 (busy) */
  MODBUS_COUNT_BUSY = 6,
  /* number of times that bytes were received while an answer still waited to be sent */
  MODBUS_COUNT_OVERRUNS = 7,
  MODBUS_COUNTERS = 8
};

typedef enum {
  MODBUS_READ,        /* reads the value of an object */
  MODBUS_READ_TEXT,   /* reads the text at a CANopen index */
  MODBUS_CHECK,       /* checks whether a write from Modbus would be accepted */
  MODBUS_CHECK_OWNER, /* checks a write as if Modbus owned the axis */
  MODBUS_WRITE        /* writes on behalf of Modbus */
} modbus_access_kind_t;

/* Value of the field `refusal` of an access if the axis did not answer. */
enum { MODBUS_NO_ANSWER = 1 };

typedef struct {
  uint8_t kind; /* kind of the access, modbus_access_kind_t */
  /* number (AXIS_OBJ_) of the object; for MODBUS_READ_TEXT, CANopen index of the text */
  uint16_t object;
  /* raw value that is checked or written, or that was read; an unsigned 32-bit value keeps its
   * bits */
  int32_t value;
  /* text that MODBUS_READ_TEXT found, with a 0 at its end; valid until the next access */
  const char *text;
  int refusal; /* result of the access to the object: FW_OK, FW_ERROR_ or MODBUS_NO_ANSWER */
} modbus_access_t;

typedef enum { MODBUS_ENDED, MODBUS_REGISTERS, MODBUS_BITS, MODBUS_IDENTITY } modbus_part_t;

typedef struct {
  modbus_access_t access;
  /* source file (modbus_part_t) whose functions continue the request; MODBUS_ENDED if the answer is
   * complete */
  uint8_t part;
  uint8_t step; /* step with which the Modbus request continues after the access */
  uint8_t unit;
  uint8_t *pdu;       /* function code and data of the request, and later of the answer */
  uint16_t length;    /* length in bytes of the request PDU, and later of the answer PDU */
  uint16_t *counters; /* diagnostic counters of the Modbus server, MODBUS_COUNTERS elements */

  /* The fields from `begin` to `after` are for requests that read or write registers. The entries
   * are those of the table axis_holding or axis_input. */
  const axis_register_t *begin; /* first entry of the request */
  /* pointer to the entry after the last entry of the request */
  const axis_register_t *end;
  const axis_register_t *entry; /* row of the register table that is being read or written */
  bool wide;                    /* true if the request contains a 32-bit object */
  /* true if the low word of a 32-bit object is in the first of its two registers */
  bool low_first;
  uint8_t *words; /* words of the Modbus request that belong to the first entry that is written */
  /* words of the Modbus request that belong to the entry that is being read or written */
  uint8_t *place;
  /* number of the first register, bit or identification object that the Modbus request reads */
  uint32_t first;
  /* number of the last register, bit or identification object that is read, plus 1 */
  uint32_t after;
  uint16_t read_first; /* Modbus function 23: first register that is read after the writes */
  /* number of registers that are read after the writes; 0 if no register is read */
  uint16_t read_count;
  uint16_t and_mask; /* Modbus function 22: AND mask and OR mask of the request */
  uint16_t or_mask;
  uint8_t word[2];      /* word that the Modbus functions 6 and 22 write */
  uint8_t irreversible; /* number of writes in the Modbus request that cannot be undone */
  /* true while the irreversible writes are in progress; all other writes come first */
  bool writes_those;
  uint32_t previous; /* previous value of the object that is being written */
  /* Modbus exception with which the request ends when its writes have been undone */
  uint8_t exception;

  /* For requests that write coils: one[n] is true if coil n is written with 1, and zero[n] is true
   * if it is written with 0. If both are false, the request does not write coil n. */
  bool one[AXIS_COIL_COUNT];
  bool zero[AXIS_COIL_COUNT];
  uint32_t controlword;
} modbus_request_t;

/* Returns the Modbus exception that belongs to the result `refusal` of an access. */
static inline uint8_t modbus_exception_of(int refusal) {
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
    case MODBUS_NO_ANSWER:
      return MODBUS_EXCEPTION_TARGET;
    default:
      return MODBUS_EXCEPTION_ADDRESS;
  }
}

/* Requests an access to an object. When the result is available, the request continues at
 * `step`. */
static inline void modbus_ask(modbus_request_t *r, uint8_t step, modbus_access_kind_t kind,
                              uint16_t object, int32_t value) {
  r->step = step;
  r->access.kind = (uint8_t)kind;
  r->access.object = object;
  r->access.value = value;
}

/* Ends the request with the answer that is already in the PDU, or with an exception. */
static inline void modbus_end(modbus_request_t *r, uint8_t exception) {
  r->part = MODBUS_ENDED;
  if (exception == MODBUS_OK) {
    return;
  }
  r->pdu[0] = (uint8_t)(r->pdu[0] | 0x80u);
  r->pdu[1] = exception;
  r->length = 2;
  r->counters[MODBUS_COUNT_EXCEPTIONS] = (uint16_t)(r->counters[MODBUS_COUNT_EXCEPTIONS] + 1);
  if (exception == MODBUS_EXCEPTION_BUSY) {
    r->counters[MODBUS_COUNT_BUSY] = (uint16_t)(r->counters[MODBUS_COUNT_BUSY] + 1);
  }
}

#endif
