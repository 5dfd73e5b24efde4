#include "firmware/modbus/identity.h"

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/generated/axis_objects_device.h"
#include "firmware/objects/generated/axis_objects_drive.h"

/* Steps of Modbus functions 17 and 43; each step waits for the result of one access to an
 * object. */
enum { STATE, NAME, IDENTITY };

enum { TEXT_MAX = 30, HASH_DIGITS = 8, HASH = 0x80 };
enum { INDEX_NAME = 0x1008, INDEX_HARDWARE = 0x1009, INDEX_SOFTWARE = 0x100A };

/* Ids of the objects in the Modbus device identification, in ascending order. */
static const uint8_t identities[] = {0x00, 0x01, 0x02, 0x04, 0x05, HASH};
enum { IDENTITIES = sizeof(identities) };

static bool is_identity(uint8_t number) {
  bool found = false;
  for (uint8_t i = 0; i < IDENTITIES; i++) {
    found = found || identities[i] == number;
  }
  return found;
}

/* Returns the last object id of a category of the device identification. The categories are basic,
 * regular and extended. */
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

static uint16_t index_of(uint8_t number) {
  switch (number) {
    case 0x02:
      return INDEX_SOFTWARE;
    case 0x05:
      return INDEX_HARDWARE;
    default:
      return INDEX_NAME;
  }
}

/* Appends a text to the Modbus answer and returns the number of appended characters. */
static uint8_t append_text(modbus_request_t *r, const char *text) {
  uint8_t n = 0;
  while (n < TEXT_MAX && text[n] != 0) {
    r->pdu[r->length + n] = (uint8_t)text[n];
    n++;
  }
  r->length = (uint16_t)(r->length + n);
  return n;
}

void modbus_report_server(modbus_request_t *r) {
  r->part = MODBUS_IDENTITY;
  modbus_ask(r, STATE, MODBUS_READ, AXIS_OBJ_DRIVE_STATE, 0);
}

/* Requests the text of the entry r->first of `identities`. After the last entry, ends the
 * request. */
static void next_identity(modbus_request_t *r) {
  if (r->first == r->after) {
    modbus_end(r, MODBUS_OK);
  } else if (identities[r->first] == HASH) {
    modbus_ask(r, IDENTITY, MODBUS_READ, AXIS_OBJ_OBJECT_TABLE_HASH, 0);
  } else {
    modbus_ask(r, IDENTITY, MODBUS_READ_TEXT, index_of(identities[r->first]), 0);
  }
}

static void append_identity(modbus_request_t *r) {
  const uint16_t at = r->length;
  r->length = (uint16_t)(at + 2);
  r->pdu[at] = identities[r->first];
  if (r->access.kind == MODBUS_READ_TEXT) {
    r->pdu[at + 1] = append_text(r, r->access.text);
  } else {
    char digits[HASH_DIGITS + 1];
    for (uint32_t i = 0; i < HASH_DIGITS; i++) {
      digits[i] = "0123456789abcdef"[fx_field((uint32_t)r->access.value, 28 - 4 * i, 4)];
    }
    digits[HASH_DIGITS] = 0;
    r->pdu[at + 1] = append_text(r, digits);
  }
  r->pdu[6] = (uint8_t)(r->pdu[6] + 1);
  r->first++;
  next_identity(r);
}

void modbus_identify(modbus_request_t *r) {
  const uint8_t category = r->pdu[2];
  const uint8_t number = r->pdu[3];
  if (r->pdu[1] != 14) {
    modbus_end(r, MODBUS_EXCEPTION_FUNCTION);
  } else if (category < 1 || category > 4) {
    modbus_end(r, MODBUS_EXCEPTION_VALUE);
  } else if (category == 4 && !is_identity(number)) {
    modbus_end(r, MODBUS_EXCEPTION_ADDRESS);
  } else {
    /* If the object id in the request does not exist, the answer begins with the first
     * identification object. */
    const uint8_t first = is_identity(number) ? number : 0;
    const uint8_t last = (category == 4) ? number : identity_end(category);
    r->first = 0;
    while (identities[r->first] < first) {
      r->first++;
    }
    r->after = r->first;
    while (r->after < IDENTITIES && identities[r->after] <= last) {
      r->after++;
    }
    /* conformity level of the device identification: all categories, with stream access and
     * individual access */
    r->pdu[3] = 0x83;
    /* 0: the list of device identification objects is complete, no more objects follow */
    r->pdu[4] = 0;
    r->pdu[5] = 0;
    r->pdu[6] = 0; /* number of identification objects in the Modbus answer */
    r->length = 7;
    r->part = MODBUS_IDENTITY;
    next_identity(r);
  }
}

void modbus_identity_resume(modbus_request_t *r) {
  switch (r->step) {
    case STATE:
      r->pdu[2] = r->unit;
      r->pdu[3] = (r->access.value == AXIS_DRIVE_STATE_OPERATION_ENABLED) ? 0xFF : 0x00;
      r->length = 4;
      modbus_ask(r, NAME, MODBUS_READ_TEXT, INDEX_NAME, 0);
      break;
    case NAME:
      r->pdu[1] = (uint8_t)(2 + append_text(r, r->access.text));
      modbus_end(r, MODBUS_OK);
      break;
    default:
      append_identity(r);
      break;
  }
}
