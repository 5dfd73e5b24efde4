#ifndef FIRMWARE_MODBUS_STEP_H_
#define FIRMWARE_MODBUS_STEP_H_

/* A Modbus request in progress: its present access to an object, and the step that continues with
 * the result. Callers that only serve requests include only request.h. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/access.h"

enum {
  MODBUS_OK = 0,
  MODBUS_EXCEPTION_FUNCTION = 1, /* unknown function, or sub-function */
  MODBUS_EXCEPTION_ADDRESS = 2,  /* no such register, coil or discrete input */
  /* value out of range, write to half of a 32-bit object, or malformed request */
  MODBUS_EXCEPTION_VALUE = 3,
  MODBUS_EXCEPTION_STATE = 4,  /* state does not permit it, or another source owns the axis */
  MODBUS_EXCEPTION_BUSY = 6,   /* the parameter store is working */
  MODBUS_EXCEPTION_PATH = 10,  /* the gateway has no axis with this unit */
  MODBUS_EXCEPTION_TARGET = 11 /* the axis does not answer the gateway */
};

/* Counters of function 8, indexed by sub-function minus MODBUS_COUNTER_FIRST. They wrap. */
enum {
  MODBUS_COUNTER_FIRST = 11,
  MODBUS_COUNT_MESSAGES = 0,   /* number of complete frames received on the bus, for all units */
  MODBUS_COUNT_ERRORS = 1,     /* frames that were damaged, interrupted or too long */
  MODBUS_COUNT_EXCEPTIONS = 2, /* answers with an exception, and refused broadcasts */
  MODBUS_COUNT_SERVED = 3,     /* number of requests to this unit, and of broadcasts */
  MODBUS_COUNT_UNANSWERED = 4, /* broadcasts */
  MODBUS_COUNT_NAK = 5,        /* always 0 */
  MODBUS_COUNT_BUSY = 6,       /* requests refused with exception 6 */
  MODBUS_COUNT_OVERRUNS = 7,   /* bytes received before the last answer was fetched */
  MODBUS_COUNTERS = 8
};

typedef enum {
  MODBUS_READ,        /* read the value of an object */
  MODBUS_READ_TEXT,   /* read the text at a CANopen index */
  MODBUS_CHECK,       /* check whether a write from Modbus would be accepted */
  MODBUS_CHECK_OWNER, /* check it as if Modbus owned the axis */
  MODBUS_WRITE        /* write on behalf of Modbus */
} modbus_access_kind_t;

/* Value of the field `refusal` of an access if the axis did not answer. */
enum { MODBUS_NO_ANSWER = 1 };

typedef struct {
  uint8_t kind;    /* modbus_access_kind_t */
  uint16_t object; /* AXIS_OBJ_, or the index in MODBUS_READ_TEXT */
  /* raw value to check or write, or the value read; an unsigned value as the same 32 bits */
  int32_t value;
  const char *text; /* text found by MODBUS_READ_TEXT, ended by 0, valid until the next access */
  int refusal;      /* result of the access: FW_OK, FW_ERROR_ or MODBUS_NO_ANSWER */
} modbus_access_t;

typedef enum { MODBUS_ENDED, MODBUS_REGISTERS, MODBUS_BITS, MODBUS_IDENTITY } modbus_part_t;

typedef struct {
  modbus_access_t access;
  uint8_t part; /* modbus_part_t that continues the request; MODBUS_ENDED: the answer is complete */
  uint8_t step; /* step of this part */
  uint8_t unit;
  uint8_t *pdu;       /* bytes of function and data: of the request, then of its answer */
  uint16_t length;    /* length of the request, then of the answer */
  uint16_t *counters; /* MODBUS_COUNTERS of them */

  /* Register requests: the entries of axis_holding or axis_input that the request covers. */
  const axis_register_t *begin; /* the first entry */
  const axis_register_t *end;   /* end of the entries, after the last one */
  const axis_register_t *entry; /* entry that is in progress */
  bool wide;                    /* whether 32-bit objects are among the entries */
  /* whether the low word of a 32-bit object is in the first register */
  bool low_first;
  uint8_t *words;      /* words of the first entry to write */
  uint8_t *place;      /* words of the entry in progress */
  uint32_t first;      /* first register, bit or identity number to read */
  uint32_t after;      /* number after the last register, bit or identity number to read */
  uint16_t read_first; /* function 23: first register to read after the writes */
  uint16_t read_count; /* number of registers to read; 0: nothing */
  uint16_t and_mask;   /* function 22 */
  uint16_t or_mask;
  uint8_t word[2];      /* written by functions 6 and 22 */
  uint8_t irreversible; /* number of writes that cannot be undone */
  /* whether the irreversible writes are in progress; the others come before them */
  bool writes_those;
  uint32_t previous; /* previous value of the object that is being written */
  uint8_t exception; /* exception that made the request undo its writes */

  /* Coils of a write request: their new states; a coil in neither array is not part of the
   * request. */
  bool one[AXIS_COIL_COUNT];
  bool zero[AXIS_COIL_COUNT];
  uint32_t controlword;
} modbus_request_t;

/* Returns the Modbus exception for a refusal. */
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

/* Requests an access to an object. The part of the request continues at `step` with the result. */
static inline void modbus_ask(modbus_request_t *r, uint8_t step, modbus_access_kind_t kind,
                              uint16_t object, int32_t value) {
  r->step = step;
  r->access.kind = (uint8_t)kind;
  r->access.object = object;
  r->access.value = value;
}

/* Ends the request with the answer that is already in place, or with an exception. */
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
