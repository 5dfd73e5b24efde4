/* Whatever bytes come in over Modbus, in whatever pieces and with whatever silence between them:
 * answers are whole frames of this unit, nothing is touched that must not be (sanitizers), the
 * axis stays disabled unless a request was served, a frame that is not whole changes nothing, and
 * after a silence a good request is answered.
 *
 * The input is a row of pieces: one byte says how many bytes follow (0 to 127; with bit 7 they are
 * given a right CRC and, but for a rare one, this unit), then how many ticks pass (0 to 3). */

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/app/fw.h"

enum { UNIT = 3, SECTOR = STORE_SECTOR_MIN };

typedef struct {
  uint8_t bytes[2 * SECTOR];
} memory_t;

static void read_memory(void *context, uint32_t address, uint8_t *bytes, uint32_t count) {
  memcpy(bytes, &((memory_t *)context)->bytes[address], count);
}

static bool program_memory(void *context, uint32_t address, const uint8_t *bytes, uint32_t count) {
  for (uint32_t i = 0; i < count; i++) {
    if (((memory_t *)context)->bytes[address + i] != 0xFF) {
      abort();
    }
    ((memory_t *)context)->bytes[address + i] = bytes[i];
  }
  return true;
}

static bool erase_memory(void *context, uint8_t sector) {
  memset(&((memory_t *)context)->bytes[(size_t)sector * SECTOR], 0xFF, SECTOR);
  return true;
}

/* The CRC written apart from the firmware's. */
static uint16_t crc_of(const uint8_t *bytes, size_t count) {
  uint32_t crc = 0xFFFF;
  for (size_t i = 0; i < count; i++) {
    for (int bit = 0; bit < 8; bit++) {
      const uint32_t one = (crc ^ ((uint32_t)bytes[i] >> bit)) & 1;
      crc = (crc >> 1) ^ (one != 0 ? 0xA001u : 0);
    }
  }
  return (uint16_t)crc;
}

static void tick(fw_t *fw, int ticks) {
  const axis_inputs_t inputs = {0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
  axis_outputs_t outputs;
  for (int i = 0; i < ticks; i++) {
    fw_tick(fw, &inputs, &outputs);
  }
}

/* How many bytes; a whole answer, since it is always fetched at once. */
static uint16_t fetch(fw_t *fw) {
  uint8_t answer[MODBUS_FRAME_BYTES + 4];
  const uint16_t count = fw_modbus_transmit(fw, answer, sizeof(answer));
  if (count != 0 && (count < 5 || count > MODBUS_FRAME_BYTES || answer[0] != UNIT ||
                     crc_of(answer, count) != 0)) {
    abort();
  }
  return count;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  static memory_t memory;
  static uint8_t recorder[512];
  static fw_t fw;
  memset(&memory, 0xFF, sizeof(memory));
  memset(&fw, 0, sizeof(fw));
  const store_memory_t store = {&memory, SECTOR, read_memory, program_memory, erase_memory};
  const fw_config_t config = {.recorder_buffer = recorder,
                              .recorder_bytes = sizeof(recorder),
                              .memory = &store,
                              .node_id = UNIT,
                              .buses = 1};
  fw_init(&fw, &config);
  while (size > 2) {
    uint8_t piece[130];
    const size_t room = size - 2;
    size_t count = data[0] & 0x7Fu;
    const bool closed = (data[0] & 0x80u) != 0;
    const int ticks = data[1] & 3;
    count = (count < room) ? count : room;
    memcpy(piece, &data[2], count);
    data += 2 + count;
    size -= 2 + count;
    if (closed && count > 0) {
      piece[0] = (data[-1] == 0x5A) ? 0 : UNIT;
      const uint16_t crc = crc_of(piece, count);
      piece[count] = (uint8_t)crc;
      piece[count + 1] = (uint8_t)(crc >> 8);
      count += 2;
    }
    const uint16_t served = fw.modbus.counters[MODBUS_COUNT_SERVED];
    const drive_params_t drive = fw.drive.params;
    const axis_params_t axis = fw.axis.params;
    fw_modbus_receive(&fw, piece, (uint16_t)count);
    if (served == fw.modbus.counters[MODBUS_COUNT_SERVED] &&
        (memcmp(&drive, &fw.drive.params, sizeof(drive)) != 0 ||
         memcmp(&axis, &fw.axis.params, sizeof(axis)) != 0)) {
      abort();
    }
    fetch(&fw);
    tick(&fw, ticks);
    fetch(&fw);
  }
  tick(&fw, (int)fw.modbus.silence_ticks + 1);
  fetch(&fw);
  const uint8_t request[] = {UNIT, 4, 0, 0, 0, 1};
  uint8_t frame[8];
  memcpy(frame, request, sizeof(request));
  const uint16_t crc = crc_of(frame, 6);
  frame[6] = (uint8_t)crc;
  frame[7] = (uint8_t)(crc >> 8);
  fw_modbus_receive(&fw, frame, sizeof(frame));
  if (fetch(&fw) != 7) {
    abort();
  }
  return 0;
}
