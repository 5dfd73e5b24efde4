#include "firmware/modbus/server.h"

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/modbus/request.h"

enum { BROADCAST = 0, FRAME_MIN = 4, CRC_BEGIN = 0xFFFF, BYTES_CRC = 2 };
enum { UNIT = 0, PDU = 1 }; /* offsets in bytes of the unit and of the PDU in a Modbus frame */
/* special value of the frame length: the received frame must be discarded */
enum { TOO_LONG = 0xFFFF };

static void begin_frame(modbus_t *modbus) {
  modbus->length = 0;
  modbus->crc = CRC_BEGIN;
  modbus->silence = 0;
}

static void count(modbus_t *modbus, uint8_t which) {
  modbus->counters[which] = (uint16_t)(modbus->counters[which] + 1);
}

/* Returns the length of the silent interval that ends a frame, in ticks of 1/1500 s, rounded up:
 * 3.5 characters of 11 bits, or 1.75 ms above 19200 bit/s (Modbus over serial line 1.02,
 * 2.5.1.1). */
static uint32_t ticks_of_silence(uint32_t baud) {
  /* 3.5 characters of 11 bits are 3.5 x 11 x 1500 = 57750 ticks divided by the bit rate; 1.75 ms
   * are 0.00175 x 1500 = 2.6 ticks. */
  return (baud > 19200) ? 3 : fx_quotient(57749 + baud, baud);
}

void modbus_init(modbus_t *modbus, uint8_t unit, uint32_t baud) {
  modbus->unit = unit;
  modbus->silence_ticks = ticks_of_silence((baud == 0) ? MODBUS_BAUD_DEFAULT : baud);
  modbus->heard = 0;
  modbus->answer_length = 0;
  modbus->answer_sent = 0;
  for (uint8_t i = 0; i < MODBUS_COUNTERS; i++) {
    modbus->counters[i] = 0;
  }
  begin_frame(modbus);
}

static void append_crc(modbus_t *modbus, uint16_t length) {
  uint16_t crc = CRC_BEGIN;
  for (uint16_t i = 0; i < length; i++) {
    crc = fx_crc16_modbus(crc, modbus->frame[i]);
  }
  fx_store_le(&modbus->frame[length], crc, BYTES_CRC);
}

/* Returns true if this function code writes, so that it is permitted in a broadcast. */
static bool writes(uint8_t function) {
  return function == 5 || function == 6 || function == 15 || function == 16 || function == 22;
}

static void access_object(dictionary_t *objects, modbus_access_t *access) {
  switch (access->kind) {
    case MODBUS_READ:
      access->refusal = dictionary_read(objects, access->object, &access->value);
      break;
    case MODBUS_READ_TEXT:
      access->text = dictionary_text(objects, access->object);
      access->refusal = FW_OK;
      break;
    case MODBUS_CHECK:
      access->refusal = dictionary_check(objects, FW_SOURCE_MODBUS, access->object, access->value);
      break;
    case MODBUS_CHECK_OWNER:
      access->refusal = dictionary_check(objects, FW_SOURCE_LOCAL, access->object, access->value);
      break;
    default:
      access->refusal = dictionary_write(objects, FW_SOURCE_MODBUS, access->object, access->value);
      break;
  }
}

/* Executes the received request. Its PDU has `length` bytes. Returns the length in bytes of the PDU
 * of the answer. */
static uint16_t serve(modbus_t *modbus, dictionary_t *objects, uint16_t length) {
  modbus_request_t request;
  modbus_request_begin(&request, modbus->frame[UNIT], &modbus->frame[PDU], length,
                       modbus->counters);
  while (!modbus_request_ended(&request)) {
    access_object(objects, &request.access);
    modbus_request_resume(&request);
  }
  return request.length;
}

/* Processes a Modbus frame that was received completely. */
static void take_frame(modbus_t *modbus, dictionary_t *objects) {
  const uint8_t unit = modbus->frame[UNIT];
  const uint16_t length = modbus->length;
  begin_frame(modbus);
  count(modbus, MODBUS_COUNT_MESSAGES);
  if (modbus->unit > MODBUS_UNIT_MAX || (unit != BROADCAST && unit != modbus->unit)) {
    return;
  }
  if (unit == BROADCAST && !writes(modbus->frame[PDU])) {
    return;
  }
  const uint16_t answer =
      (uint16_t)(PDU + serve(modbus, objects, (uint16_t)(length - PDU - BYTES_CRC)));
  if (unit == BROADCAST) {
    count(modbus, MODBUS_COUNT_UNANSWERED);
    return;
  }
  append_crc(modbus, answer);
  modbus->answer_length = (uint16_t)(answer + BYTES_CRC);
  fx_assert(modbus->answer_length <= MODBUS_FRAME_BYTES);
  modbus->answer_sent = 0;
}

/* Returns true if the received bytes can be a complete frame. Then the CRC over all bytes,
 * including the two CRC bytes, is 0. */
static bool closes(const modbus_t *modbus) {
  return modbus->crc == 0 && modbus->length >= FRAME_MIN && modbus->length <= MODBUS_FRAME_BYTES;
}

/* Returns true if the received frame is complete. A frame to another unit is complete when its CRC
 * is correct. If this happens too early by chance, the remaining bytes are discarded as an invalid
 * frame. A correct CRC does not end a frame with an unknown function, because the CRC is already
 * correct one byte before the end if its high byte is 0. */
static bool ends(const modbus_t *modbus) {
  if (!closes(modbus)) {
    return false;
  }
  const bool foreign = modbus->frame[UNIT] != BROADCAST && modbus->frame[UNIT] != modbus->unit;
  const uint16_t pdu = (uint16_t)(modbus->length - PDU - BYTES_CRC);
  const uint16_t bytes = modbus_request_bytes(&modbus->frame[PDU], pdu);
  return foreign || bytes == pdu;
}

void modbus_receive(modbus_t *modbus, dictionary_t *objects, const uint8_t *bytes,
                    uint16_t number) {
  for (uint16_t i = 0; i < number; i++) {
    if (modbus->answer_length != 0) {
      if (modbus->length == 0) {
        count(modbus, MODBUS_COUNT_OVERRUNS);
      }
      modbus->length = TOO_LONG;
    }
    if (modbus->length < MODBUS_FRAME_BYTES) {
      modbus->frame[modbus->length] = bytes[i];
      modbus->length = (uint16_t)(modbus->length + 1);
      modbus->crc = fx_crc16_modbus(modbus->crc, bytes[i]);
      if (ends(modbus)) {
        take_frame(modbus, objects);
      }
    } else {
      modbus->length = TOO_LONG;
    }
  }
  if (number > 0) {
    modbus->heard = 1;
  }
}

void modbus_tick(modbus_t *modbus, dictionary_t *objects) {
  if (modbus->length == 0) {
    return;
  }
  modbus->silence = (modbus->heard != 0) ? 0 : modbus->silence + 1;
  modbus->heard = 0;
  if (modbus->silence < modbus->silence_ticks) {
    return;
  }
  /* The CRC of the frame is correct, but its length does not match its function code, or its
   * function is unknown. The answer is an exception. */
  if (closes(modbus)) {
    take_frame(modbus, objects);
    return;
  }
  count(modbus, MODBUS_COUNT_ERRORS);
  begin_frame(modbus);
}

uint16_t modbus_transmit(modbus_t *modbus, uint8_t *bytes, uint16_t room) {
  uint16_t given = 0;
  while (given < room && modbus->answer_sent < modbus->answer_length) {
    bytes[given] = modbus->frame[modbus->answer_sent];
    modbus->answer_sent = (uint16_t)(modbus->answer_sent + 1);
    given = (uint16_t)(given + 1);
  }
  if (modbus->answer_sent == modbus->answer_length) {
    modbus->answer_length = 0;
    modbus->answer_sent = 0;
  }
  return given;
}
