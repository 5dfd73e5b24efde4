#ifndef FIRMWARE_MODBUS_STEP_H_
#define FIRMWARE_MODBUS_STEP_H_

/* A request in progress: its pending access to an object, and the step that continues with the
 * result. Callers that only serve requests need request.h alone. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/objects/access.h"

enum {
  MODBUS_OK = 0,
  MODBUS_EXCEPTION_FUNCTION = 1, /* unknown function, or sub-function */
  MODBUS_EXCEPTION_ADDRESS = 2,  /* no such register, coil or input */
  MODBUS_EXCEPTION_VALUE = 3,    /* out of range, a write to half of a 32-bit object, malformed */
  MODBUS_EXCEPTION_STATE = 4,    /* not in this state, or another source owns the axis */
  MODBUS_EXCEPTION_BUSY = 6,     /* the parameter store is at work */
  MODBUS_EXCEPTION_PATH = 10,    /* no axis of this unit behind the gateway */
  MODBUS_EXCEPTION_TARGET = 11   /* the axis behind a gateway does not answer */
};

/* Counters of function 8, by their sub-function minus MODBUS_COUNTER_FIRST. They wrap. */
enum {
  MODBUS_COUNTER_FIRST = 11,
  MODBUS_COUNT_MESSAGES = 0,   /* whole frames on the bus, of whichever unit */
  MODBUS_COUNT_ERRORS = 1,     /* frames that were broken, cut off or too long */
  MODBUS_COUNT_EXCEPTIONS = 2, /* answered with one, or a broadcast that was refused */
  MODBUS_COUNT_SERVED = 3,     /* requests of this unit, and broadcasts */
  MODBUS_COUNT_UNANSWERED = 4, /* broadcasts */
  MODBUS_COUNT_NAK = 5,        /* always 0 */
  MODBUS_COUNT_BUSY = 6,       /* exception 6 */
  MODBUS_COUNT_OVERRUNS = 7,   /* bytes came before the last answer was fetched */
  MODBUS_COUNTERS = 8
};

typedef enum {
  MODBUS_READ,        /* an object's value */
  MODBUS_READ_TEXT,   /* the text at a CANopen index */
  MODBUS_CHECK,       /* whether the value would be accepted from Modbus; nothing is written */
  MODBUS_CHECK_OWNER, /* the same if Modbus owned the axis */
  MODBUS_WRITE        /* on behalf of Modbus */
} modbus_access_kind_t;

/* As a refusal: the axis did not answer. */
enum { MODBUS_NO_ANSWER = 1 };

typedef struct {
  uint8_t kind;     /* modbus_access_kind_t */
  uint16_t object;  /* AXIS_OBJ_; of MODBUS_READ_TEXT the index */
  int32_t value;    /* raw, u32 as the same 32 bits: to check or write; what was read */
  const char *text; /* what MODBUS_READ_TEXT found, ended by 0, valid until the next access */
  int refusal;      /* the result: FW_OK, FW_ERROR_ or MODBUS_NO_ANSWER */
} modbus_access_t;

typedef enum { MODBUS_ENDED, MODBUS_REGISTERS, MODBUS_BITS, MODBUS_IDENTITY } modbus_part_t;

typedef struct {
  modbus_access_t access;
  uint8_t part; /* modbus_part_t: that which continues; MODBUS_ENDED: the answer is ready */
  uint8_t step; /* of that part */
  uint8_t unit;
  uint8_t *pdu;       /* function and data of the request, then of its answer */
  uint16_t length;    /* of the request, then of the answer */
  uint16_t *counters; /* MODBUS_COUNTERS of them */

  /* Registers: entries of axis_holding or axis_input. */
  const axis_register_t *begin; /* the first entry */
  const axis_register_t *end;   /* the entry behind the last one */
  const axis_register_t *entry; /* under way */
  bool wide;                    /* there are 32-bit objects among them */
  bool low_first;               /* of the two words of a 32-bit object */
  uint8_t *words;               /* of the first entry to write */
  uint8_t *place;               /* of the words under way */
  uint32_t first;               /* register, bit or identity number that is read first ... */
  uint32_t after;               /* ... and the one behind the last */
  uint16_t read_first;          /* function 23: the first to read after the writes */
  uint16_t read_count;          /* 0: nothing */
  uint16_t and_mask;            /* function 22 */
  uint16_t or_mask;
  uint8_t word[2];      /* written by functions 6 and 22 */
  uint8_t irreversible; /* writes that cannot be undone */
  bool writes_those;    /* now; the others before */
  uint32_t previous;    /* value of the object that is being written */
  uint8_t exception;    /* the reason why the writes are undone */

  /* Coils of a request that writes; neither: not part of it. */
  bool one[AXIS_COIL_COUNT];
  bool zero[AXIS_COIL_COUNT];
  uint32_t controlword;
} modbus_request_t;

/* The exception for a refusal. */
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

/* Requests an access; the request's part continues at `step` with its result. */
static inline void modbus_ask(modbus_request_t *r, uint8_t step, modbus_access_kind_t kind,
                              uint16_t object, int32_t value) {
  r->step = step;
  r->access.kind = (uint8_t)kind;
  r->access.object = object;
  r->access.value = value;
}

/* Ends the request: with the answer in its place, or with an exception. */
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
