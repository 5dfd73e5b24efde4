#include "firmware/app/update.h"

#include <stddef.h>

#include "firmware/app/ownership.h"
#include "firmware/fx/bytes.h"

enum { HEAD_CRC_BYTES = offsetof(update_head_t, head_crc), BOARD_BYTES = 16, WORD = 4 };

/* Error numbers in bits 1 to 7 of the object program_flash_status (CiA 302-3). */
enum { FORMAT_UNKNOWN = 4, FORMAT = 6, WRITE_FAILED = 10, ADDRESS = 12, SECURED = 14 };

_Static_assert(UPDATE_HEAD_BYTES == 64, "read by other programs");

static uint8_t other_slot(const fw_t *fw) { return fw->config.slots->running ^ 1u; }

static uint32_t trailer_of(const fw_t *fw, uint8_t slot) {
  const uint32_t bytes = fw->config.slots->memory->sector_bytes;
  return slot * bytes + bytes - SLOT_TRAILER_BYTES;
}

static void read_trailer(const fw_t *fw, uint8_t slot, slot_trailer_t *trailer) {
  const store_memory_t *memory = fw->config.slots->memory;
  memory->read(memory->context, trailer_of(fw, slot), (uint8_t *)trailer, sizeof(*trailer));
}

/* Programs `count` bytes at the address `at` into the flash memory of the image slots, and reads
 * the bytes back. */
static bool program(const fw_t *fw, uint32_t at, const void *bytes, uint32_t count) {
  const store_memory_t *memory = fw->config.slots->memory;
  bool done = memory->program(memory->context, at, bytes, count);
  for (uint32_t i = 0; i < count && done; i += WORD) {
    done = record_word(memory, at + i) == fx_load_le32((const uint8_t *)bytes + i);
  }
  return done;
}

void update_show(fw_t *fw) {
  slot_trailer_t trailer;
  if (fw->config.slots == NULL) {
    return;
  }
  read_trailer(fw, fw->config.slots->running, &trailer);
  fw->update.sequence = trailer.sequence;
  fw->canopen.signals.program_crc[0] = trailer.crc;
  fw->device_signals.program_state = (trailer.confirmed == SLOT_PROGRAMMED)
                                         ? AXIS_PROGRAM_STATE_CONFIRMED
                                         : AXIS_PROGRAM_STATE_TRIAL;
  fw->device_signals.program_slot = (uint8_t)(fw->config.slots->running + AXIS_PROGRAM_SLOT_A);
  read_trailer(fw, other_slot(fw), &trailer);
  fw->canopen.signals.program_crc[1] = (trailer.magic == SLOT_MAGIC) ? trailer.crc : 0;
}

void update_init(fw_t *fw) {
  fw->update.is_receiving = 0;
  fw->update.restart_ticks = 0;
  fw->update.overrun_tick = 0;
}

static int refuse(fw_t *fw, uint8_t reason, int refusal) {
  static const uint8_t errors[AXIS_PROGRAM_REFUSAL_COUNT] = {
      [AXIS_PROGRAM_REFUSAL_NO_UPDATE] = FORMAT_UNKNOWN,
      [AXIS_PROGRAM_REFUSAL_OTHER_BOARD] = FORMAT,
      [AXIS_PROGRAM_REFUSAL_OTHER_TABLE] = FORMAT,
      [AXIS_PROGRAM_REFUSAL_OTHER_LINK] = ADDRESS,
      [AXIS_PROGRAM_REFUSAL_WRONG_LENGTH] = FORMAT,
      [AXIS_PROGRAM_REFUSAL_NOT_CONFIRMED] = SECURED,
      [AXIS_PROGRAM_REFUSAL_WRONG_CRC] = FORMAT,
      [AXIS_PROGRAM_REFUSAL_FLASH_FAILED] = WRITE_FAILED,
  };
  fw->update.is_receiving = 0;
  fw->device_signals.program_refusal = reason;
  fw->canopen.signals.program_flash_status = errors[reason];
  return refusal;
}

int update_begin(fw_t *fw, uint32_t size) {
  if (fw->config.slots == NULL) {
    return FW_ERROR_NO_MEMORY;
  }
  if (fw->update.restart_ticks != 0) {
    return FW_ERROR_BUSY;
  }
  const int refusal = ownership_permit(&fw->objects, FW_SOURCE_LOCAL, AXIS_OBJ_PROGRAM_CONTROL, 0);
  if (refusal != FW_OK) {
    return refusal;
  }
  if (fw->device_signals.program_state != AXIS_PROGRAM_STATE_CONFIRMED) {
    return refuse(fw, AXIS_PROGRAM_REFUSAL_NOT_CONFIRMED, FW_ERROR_STATE);
  }
  (void)refuse(fw, AXIS_PROGRAM_REFUSAL_NONE, FW_OK);
  fw->canopen.signals.program_flash_status = AXIS_PROGRAM_FLASH_STATUS_BUSY;
  fw->update.size = size;
  fw->update.received = 0;
  fw->update.crc = UINT32_MAX;
  fw->update.tick = fw->axis.signals.tick_count;
  fw->update.is_receiving = 1;
  return FW_OK;
}

static bool is_our_board(const fw_t *fw) {
  bool is_same = true;
  for (uint8_t i = 0; i < BOARD_BYTES; i++) {
    is_same = is_same && fw->update.head.board[i] == fw->config.slots->board[i];
  }
  return is_same;
}

/* Returns the reason (AXIS_PROGRAM_REFUSAL_) why an update with the received head is refused. */
static uint8_t refusal_of_head(const fw_t *fw) {
  const update_head_t *head = &fw->update.head;
  const void *bytes = head;
  if (head->magic != UPDATE_MAGIC ||
      ~record_crc(UINT32_MAX, bytes, HEAD_CRC_BYTES) != head->head_crc) {
    return AXIS_PROGRAM_REFUSAL_NO_UPDATE;
  }
  if (!is_our_board(fw)) {
    return AXIS_PROGRAM_REFUSAL_OTHER_BOARD;
  }
  if (head->replaced_table != AXIS_OBJECTS_HASH32) {
    return AXIS_PROGRAM_REFUSAL_OTHER_TABLE;
  }
  if (head->address != fw->config.slots->address[other_slot(fw)]) {
    return AXIS_PROGRAM_REFUSAL_OTHER_LINK;
  }
  const bool is_length =
      head->length != 0 && (head->length & 3u) == 0 && head->length <= SLOT_IMAGE_BYTES_MAX &&
      (fw->update.size == 0 || fw->update.size == head->length + UPDATE_HEAD_BYTES);
  return is_length ? AXIS_PROGRAM_REFUSAL_NONE : AXIS_PROGRAM_REFUSAL_WRONG_LENGTH;
}

static int fail(fw_t *fw) {
  return refuse(fw, AXIS_PROGRAM_REFUSAL_FLASH_FAILED, FW_ERROR_NO_DATA);
}

/* Checks the head of the update. If the head is valid, erases the flash slot that the image will
 * use. */
static int take_head(fw_t *fw) {
  const store_memory_t *memory = fw->config.slots->memory;
  const uint8_t reason = refusal_of_head(fw);
  if (reason != AXIS_PROGRAM_REFUSAL_NONE) {
    return refuse(fw, reason, FW_ERROR_RANGE);
  }
  fw->canopen.signals.program_crc[1] = 0;
  return memory->erase(memory->context, other_slot(fw)) ? FW_OK : fail(fw);
}

/* Programs the trailer of a complete image. The first word of the trailer is programmed last. */
static int finish(fw_t *fw) {
  const update_head_t *head = &fw->update.head;
  if (~fw->update.crc != head->crc) {
    return refuse(fw, AXIS_PROGRAM_REFUSAL_WRONG_CRC, FW_ERROR_RANGE);
  }
  const uint32_t words[4] = {SLOT_MAGIC, head->length, head->crc, fw->update.sequence + 1};
  const uint32_t trailer = trailer_of(fw, other_slot(fw));
  if (!program(fw, trailer + WORD, &words[1], 3 * WORD) || !program(fw, trailer, words, WORD)) {
    return fail(fw);
  }
  fw->canopen.signals.program_crc[1] = head->crc;
  return refuse(fw, AXIS_PROGRAM_REFUSAL_NONE, FW_OK);
}

/* Programs the last 4 received bytes. They end at the offset `received` of the update. */
static int take_word(fw_t *fw) {
  const uint32_t end = fw->update.received - UPDATE_HEAD_BYTES;
  const uint32_t slot = other_slot(fw) * fw->config.slots->memory->sector_bytes;
  if (!program(fw, slot + end - WORD, fw->update.word, WORD)) {
    return fail(fw);
  }
  fw->update.crc = record_crc(fw->update.crc, fw->update.word, WORD);
  return (end == fw->update.head.length) ? finish(fw) : FW_OK;
}

static int take_byte(fw_t *fw, uint8_t byte) {
  const uint32_t at = fw->update.received;
  void *head = &fw->update.head;
  if (fw->update.is_receiving == 0) {
    return FW_ERROR_RANGE; /* the client has sent more bytes than the head of the update has
                            * announced */
  }
  fw->update.received = at + 1;
  if (at < UPDATE_HEAD_BYTES) {
    ((uint8_t *)head)[at] = byte;
    return (at + 1 == UPDATE_HEAD_BYTES) ? take_head(fw) : FW_OK;
  }
  fw->update.word[at & 3u] = byte;
  return ((at & 3u) == 3) ? take_word(fw) : FW_OK;
}

int update_append(fw_t *fw, const uint8_t *bytes, uint32_t count) {
  if (!update_is_receiving(&fw->update, fw->axis.signals.tick_count)) {
    return FW_ERROR_STATE;
  }
  int result = FW_OK;
  for (uint32_t i = 0; i < count && result == FW_OK; i++) {
    result = take_byte(fw, bytes[i]);
  }
  fw->update.tick = fw->axis.signals.tick_count;
  return result;
}

void update_part(fw_t *fw, uint16_t offset, const uint8_t bytes[4]) {
  if (offset == (uint16_t)fw->update.received) {
    (void)update_append(fw, bytes, WORD);
  }
}

int update_end(fw_t *fw) {
  if (fw->update.is_receiving != 0) {
    return refuse(fw, AXIS_PROGRAM_REFUSAL_WRONG_LENGTH, FW_ERROR_RANGE);
  }
  return (fw->device_signals.program_refusal == AXIS_PROGRAM_REFUSAL_NONE) ? FW_OK : FW_ERROR_RANGE;
}

/* Returns true if the stored parameters were loaded, or if no parameters were stored. */
static bool is_store_loaded(const fw_t *fw) {
  switch (fw->device_signals.store_state) {
    case AXIS_STORE_STATE_EMPTY:
    case AXIS_STORE_STATE_LOADED:
    case AXIS_STORE_STATE_LOADED_OLD_DEFAULTS:
    case AXIS_STORE_STATE_SAVED:
      return true;
    default:
      return false;
  }
}

static int confirm(fw_t *fw) {
  const uint32_t ticks = fw->axis.signals.tick_count - fw->update.overrun_tick;
  if (fw->device_signals.program_state == AXIS_PROGRAM_STATE_CONFIRMED) {
    return FW_OK;
  }
  if (ticks < UPDATE_CONFIRM_TICKS || fw->config.core_fault != NULL || !is_store_loaded(fw)) {
    return FW_ERROR_STATE;
  }
  const uint32_t word = SLOT_PROGRAMMED;
  const uint32_t at =
      trailer_of(fw, fw->config.slots->running) + (uint32_t)offsetof(slot_trailer_t, confirmed);
  if (!program(fw, at, &word, WORD)) {
    return fail(fw);
  }
  fw->device_signals.program_state = AXIS_PROGRAM_STATE_CONFIRMED;
  return FW_OK;
}

int update_command(fw_t *fw, uint32_t value) {
  if (fw->config.slots == NULL) {
    return FW_ERROR_NO_MEMORY;
  }
  if (update_is_busy(&fw->update, fw->axis.signals.tick_count)) {
    return FW_ERROR_BUSY;
  }
  switch (value) {
    case AXIS_PROGRAM_CONTROL_STOP:
    case AXIS_PROGRAM_CONTROL_CLEAR:
      return FW_OK;
    case AXIS_PROGRAM_CONTROL_START:
    case AXIS_PROGRAM_CONTROL_RESET:
      fw->update.restart_ticks = UPDATE_RESTART_TICKS;
      return FW_OK;
    case AXIS_PROGRAM_CONTROL_CONFIRM:
      return confirm(fw);
    default:
      return FW_ERROR_RANGE;
  }
}

void update_serve(fw_t *fw) {
  if (fw->update.restart_ticks != 0) {
    fw->update.restart_ticks = (uint8_t)(fw->update.restart_ticks - 1);
    if (fw->update.restart_ticks == 0) {
      fw->config.slots->restart();
    }
  }
}
