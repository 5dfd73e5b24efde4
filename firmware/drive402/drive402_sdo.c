#include "firmware/drive402/drive402_sdo.h"

#include "firmware/fx/bytes.h"

/* First bytes of SDO frames. The upper three bits are the command specifier. In an expedited
 * transfer with a size, bits 2 and 3 are 4 minus the number of bytes. */
enum {
  COMMAND = 0xE0,
  DOWNLOAD_REQUEST = 0x23,
  DOWNLOAD_ANSWER = 0x60,
  UPLOAD_REQUEST = 0x40,
  UPLOAD_ANSWER = 0x40,
  SEGMENT_REQUEST = 0x60,
  SEGMENT_ANSWER = 0x00,
  ABORT = 0x80
};

/* Bits in the first byte of UPLOAD_ANSWER and SEGMENT_ANSWER. IS_LAST: the first segment is also
 * the last segment. */
enum { HAS_SIZE = 0x01, IS_EXPEDITED = 0x02, IS_LAST = 0x01, TOGGLE = 0x10 };

void drive402_sdo_init(drive402_sdo_t *sdo) {
  sdo->entry.index = 0;
  sdo->entry.sub = 0;
  sdo->entry.bytes = 0;
  sdo->entry.value = 0;
  sdo->answer = 0;
  sdo->ticks = 0;
  sdo->writes = 0;
  sdo->state = DRIVE402_TRANSFER_IDLE;
  sdo->pause = 0;
  sdo->is_repeated = 0;
  sdo->is_segmented = 0;
  sdo->has_late_ack = 0;
  sdo->doubled = 0;
}

void drive402_sdo_start(drive402_sdo_t *sdo, const drive402_entry_t *entry, bool writes) {
  sdo->entry = *entry;
  sdo->writes = writes ? 1 : 0;
  sdo->state = DRIVE402_TRANSFER_ASKS;
  sdo->is_repeated = 0;
  sdo->is_segmented = 0;
  if (writes) {
    sdo->has_late_ack = 0;
  }
}

void drive402_sdo_request(drive402_sdo_t *sdo, uint32_t ticks, uint8_t data[8]) {
  const drive402_entry_t *entry = &sdo->entry;
  const bool writes = sdo->writes != 0;
  sdo->state = DRIVE402_TRANSFER_WAITING;
  sdo->ticks = ticks;
  sdo->pause = DRIVE402_SDO_PAUSE;
  data[0] = writes ? (uint8_t)(DOWNLOAD_REQUEST + 4 * (4 - entry->bytes)) : UPLOAD_REQUEST;
  fx_store_le(data + 1, entry->index, 2);
  data[3] = entry->sub;
  fx_store_le(data + 4, 0, 4);
  if (writes) {
    fx_store_le(data + 4, entry->value, entry->bytes);
  } else if (sdo->is_segmented != 0) {
    fx_store_le(data, SEGMENT_REQUEST, 4);
  }
}

/* Ends an upload. The answer contains the value `value`, which has `bytes` bytes. */
static void take_value(drive402_sdo_t *sdo, const uint8_t *value, uint32_t bytes) {
  if (bytes < sdo->entry.bytes) {
    sdo->state = DRIVE402_TRANSFER_UNEXPECTED;
    return;
  }
  sdo->answer = fx_load_le(value, sdo->entry.bytes);
  sdo->state = DRIVE402_TRANSFER_DONE;
}

static void take_upload(drive402_sdo_t *sdo, const uint8_t *data) {
  const bool has_size = (data[0] & HAS_SIZE) != 0;
  if ((data[0] & COMMAND) != UPLOAD_ANSWER) {
    sdo->state = DRIVE402_TRANSFER_UNEXPECTED;
  } else if ((data[0] & IS_EXPEDITED) != 0) {
    take_value(sdo, data + 4, has_size ? 4 - fx_field(data[0], 2, 2) : 4);
  } else {
    sdo->is_segmented = 1;
    sdo->state = DRIVE402_TRANSFER_ASKS;
  }
}

/* Stores the value in the first segment of an upload. A segment has up to 7 bytes, and contains no
 * index of the object. */
static void take_segment(drive402_sdo_t *sdo, const uint8_t *data) {
  const bool is_whole = (data[0] & (TOGGLE | IS_LAST)) == IS_LAST;
  take_value(sdo, data + 1, is_whole ? 7 - fx_field(data[0], 1, 3) : 0);
}

static bool is_address(const drive402_sdo_t *sdo, const uint8_t *data) {
  return fx_load_le(data + 1, 2) == sdo->entry.index && data[3] == sdo->entry.sub;
}

/* Counts an acknowledgement of a download that no transfer is waiting for. */
static void take_second_ack(drive402_sdo_t *sdo) {
  if (sdo->has_late_ack == 0 && sdo->doubled < UINT8_MAX) {
    sdo->doubled++;
  }
}

/* Processes the answer that the transfer is waiting for. It is the answer to a download or to the
 * request of an upload. */
static void take_answer(drive402_sdo_t *sdo, const uint8_t *data) {
  if (data[0] == ABORT) {
    sdo->answer = fx_load_le32(data + 4);
    sdo->state = DRIVE402_TRANSFER_ABORTED;
  } else if (sdo->writes == 0) {
    take_upload(sdo, data);
  } else {
    sdo->state =
        (data[0] == DOWNLOAD_ANSWER) ? DRIVE402_TRANSFER_DONE : DRIVE402_TRANSFER_UNEXPECTED;
  }
}

void drive402_sdo_receive(drive402_sdo_t *sdo, const can_frame_t *frame) {
  const uint8_t *data = frame->data;
  const bool waits = sdo->state == DRIVE402_TRANSFER_WAITING;
  if (frame->length != 8) {
    return;
  }
  if (waits && sdo->is_segmented != 0 && (data[0] & COMMAND) == SEGMENT_ANSWER) {
    take_segment(sdo, data);
  } else if (!is_address(sdo, data)) {
    return;
  } else if (data[0] == DOWNLOAD_ANSWER && !(waits && sdo->writes != 0)) {
    take_second_ack(sdo);
  } else if (waits) {
    take_answer(sdo, data);
  }
}

bool drive402_sdo_tick(drive402_sdo_t *sdo) {
  if (sdo->pause > 0) {
    sdo->pause--;
  }
  if (sdo->state == DRIVE402_TRANSFER_WAITING) {
    sdo->ticks--;
    if (sdo->ticks == 0 && sdo->is_repeated != 0) {
      sdo->state = DRIVE402_TRANSFER_TIMED_OUT;
    } else if (sdo->ticks == 0) {
      sdo->is_repeated = 1;
      sdo->is_segmented = 0;
      sdo->has_late_ack |= sdo->writes;
      sdo->state = DRIVE402_TRANSFER_ASKS;
    }
  }
  return sdo->state == DRIVE402_TRANSFER_ASKS && sdo->pause == 0;
}
