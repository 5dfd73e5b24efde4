#include "firmware/drive402/drive402_sdo.h"

#include "firmware/fx/bytes.h"

/* Command bytes. The size of expedited data is 4 minus bits 2 and 3; both fit in one byte. */
enum {
  DOWNLOAD_REQUEST = 0x23,
  DOWNLOAD_ANSWER = 0x60,
  UPLOAD_REQUEST = 0x40,
  UPLOAD_ANSWER = 0x43,
  ABORT = 0x80
};

static uint8_t with_size(uint8_t command, uint8_t bytes) {
  return (uint8_t)(command + 4 * (4 - bytes));
}

static void start(drive402_sdo_t *sdo, const drive402_entry_t *entry, uint8_t data[8]) {
  sdo->entry = *entry;
  sdo->state = DRIVE402_TRANSFER_WAITING;
  fx_store_le(data + 1, entry->index, 2);
  data[3] = entry->sub;
  fx_store_le(data + 4, 0, 4);
}

void drive402_sdo_write(drive402_sdo_t *sdo, const drive402_entry_t *entry, uint8_t data[8]) {
  start(sdo, entry, data);
  sdo->writes = 1;
  data[0] = with_size(DOWNLOAD_REQUEST, entry->bytes);
  fx_store_le(data + 4, entry->value, entry->bytes);
}

void drive402_sdo_read(drive402_sdo_t *sdo, const drive402_entry_t *entry, uint8_t data[8]) {
  start(sdo, entry, data);
  sdo->writes = 0;
  data[0] = UPLOAD_REQUEST;
}

void drive402_sdo_receive(drive402_sdo_t *sdo, const can_frame_t *frame) {
  const uint8_t *data = frame->data;
  if (sdo->state != DRIVE402_TRANSFER_WAITING || frame->length != 8 ||
      fx_load_le(data + 1, 2) != sdo->entry.index || data[3] != sdo->entry.sub) {
    return;
  }
  const uint8_t expected =
      (sdo->writes != 0) ? (uint8_t)DOWNLOAD_ANSWER : with_size(UPLOAD_ANSWER, sdo->entry.bytes);
  if (data[0] == ABORT) {
    sdo->answer = fx_load_le32(data + 4);
    sdo->state = DRIVE402_TRANSFER_ABORTED;
  } else if (data[0] == expected) {
    sdo->answer = fx_load_le(data + 4, sdo->entry.bytes);
    sdo->state = DRIVE402_TRANSFER_DONE;
  } else {
    sdo->state = DRIVE402_TRANSFER_UNEXPECTED;
  }
}

void drive402_sdo_tick(drive402_sdo_t *sdo) {
  if (sdo->state != DRIVE402_TRANSFER_WAITING) {
    return;
  }
  sdo->ticks--;
  if (sdo->ticks == 0) {
    sdo->state = DRIVE402_TRANSFER_TIMED_OUT;
  }
}
