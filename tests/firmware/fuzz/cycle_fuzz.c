/* Any record as the program of a cycle, and any signals: a record that the axis accepts never reads
 * beyond its bytes, a demanded force is within the bounds of a table, outputs and offset keep
 * theirs, and a part is good only if its cycle ended by its program and rests on valid samples. */

#include <stdlib.h>
#include <string.h>

#include "firmware/cycle/cycle.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

enum { CRC_BYTES = 4, BAND = 2000 };

static void require(int holds) {
  if (!holds) {
    abort();
  }
}

/* Makes the header and the CRC of a record right, as far as the bytes permit. Returns the size. */
static uint32_t complete(uint8_t *record, uint32_t bytes) {
  cycle_header_t header;
  memcpy(&header, record, sizeof(header));
  header.magic = CYCLE_MAGIC;
  header.version = CYCLE_VERSION;
  header.phases = (uint8_t)(1 + (header.phases + 2) % 3);
  header.elements = (uint8_t)(header.elements % 3);
  header.reserved = 0;
  const uint32_t parts = (uint32_t)sizeof(header) +
                         header.phases * (uint32_t)sizeof(cycle_phase_t) +
                         header.elements * (uint32_t)sizeof(cycle_element_t) + CRC_BYTES;
  if (parts > bytes) {
    return 0;
  }
  header.points = (uint16_t)((bytes - parts) / sizeof(cycle_point_t) % 40);
  header.size = (uint16_t)(parts + header.points * sizeof(cycle_point_t));
  memcpy(record, &header, sizeof(header));
  uint32_t crc = UINT32_MAX;
  for (uint32_t i = 0; i < header.size - (uint32_t)CRC_BYTES; i++) {
    crc = fx_crc32(crc, record[i]);
  }
  fx_store_le(&record[header.size - CRC_BYTES], ~crc, CRC_BYTES);
  return header.size;
}

static cycle_inputs_t inputs_of(const uint8_t *data, const cycle_inputs_t *before) {
  cycle_inputs_t now = *before;
  now.tick += (data[0] % 16 == 0) ? data[1] : 1;
  now.position = fx_sum_wrap(before->position, (int8_t)data[1] * ((data[0] & 32) != 0 ? 65536 : 1));
  now.force_q8 = (int16_t)(data[2] | data[3] << 8) * ((data[0] & 64) != 0 ? 16 : 1);
  now.contact = data[0] >> 7;
  now.reached = (data[0] >> 4) & 1;
  now.inputs = data[2] & 31;
  now.defects = ((data[3] & 0xE0) == 0x60) ? data[3] & 3 : 0;
  return now;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Two bytes with the size of the record, the record, and four bytes for each tick. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  if (size < 2 + sizeof(cycle_header_t)) {
    return 0;
  }
  const size_t rest = size - 2;
  const size_t bytes = sizeof(cycle_header_t) + ((size_t)data[0] | (size_t)data[1] << 8) %
                                                    (rest - sizeof(cycle_header_t) + 1);
  /* Of exactly this size, so that a sanitizer sees a byte that is read beyond it. */
  uint8_t *record = malloc(bytes);
  require(record != NULL);
  memcpy(record, data + 2, bytes);
  const uint32_t whole = complete(record, (uint32_t)bytes);
  if (whole == 0 || cycle_program_check(record, whole).reason != CYCLE_ACCEPTED) {
    free(record);
    return 0;
  }
  const void *aligned = record;
  const cycle_header_t *program = (const cycle_header_t *)aligned;
  cycle_t cycle;
  cycle_select(&cycle, program);
  cycle_inputs_t now = {.tick = 5};
  cycle_start(&cycle, program, &now, 0);
  int aborted = 0;
  for (size_t at = 2 + bytes; at + 4 <= size && cycle_is_running(&cycle); at += 4) {
    cycle.tare_least = -BAND;
    cycle.tare_most = BAND;
    now = inputs_of(&data[at], &now);
    aborted = data[at] == 255;
    if (aborted) {
      cycle_abort(&cycle);
    } else {
      (void)cycle_step(&cycle, &now);
    }
    require(fx_within(cycle.demand_q8, CYCLE_TABLE_Y_MAX + 256) &&
            fx_within(cycle.offset_q8, BAND));
    require(cycle.outputs <= CYCLE_OUTPUTS_ALL &&
            fx_within(cycle.depth, CYCLE_TRAVEL_MAX + CYCLE_TABLE_Y_MAX));
    require(cycle.ended_by <= CYCLE_CONDITIONS && cycle.phase < program->phases);
    if ((data[at] & 8) != 0) {
      cycle_evaluate(&cycle);
    }
  }
  if (!cycle_is_running(&cycle)) {
    require((cycle.outputs & ~program->outputs_keep) == 0);
    cycle_evaluate(&cycle);
    /* A cycle that is stopped before its first tick has not begun. */
    require(cycle.state == CYCLE_DONE || (cycle.state == CYCLE_IDLE && aborted));
    require(cycle.good == 0 || (cycle.outcome == CYCLE_BY_PROGRAM && !aborted));
    require(cycle.good == 0 || cycle.invalid_ticks == 0);
  }
  free(record);
  return 0;
}
