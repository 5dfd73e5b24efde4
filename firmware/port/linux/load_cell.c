#include "firmware/port/linux/load_cell.h"

enum { ADC_CODES = 65536 };

bool load_cell_take(const load_cell_t *cell, const can_frame_t *frame, uint16_t *code) {
  if (frame->id != cell->identifier || frame->remote != 0 ||
      frame->length < cell->byte + cell->bytes) {
    return false;
  }
  uint32_t raw = 0;
  for (uint8_t i = 0; i < cell->bytes; i++) {
    raw |= (uint32_t)frame->data[cell->byte + i] << (8 * i);
  }
  int64_t value = raw;
  const int64_t range = (int64_t)1 << (8 * cell->bytes);
  if (cell->is_signed && value >= range / 2) {
    value -= range;
  }
  /* The division rounds down also for negative integers, as an arithmetic shift does. */
  const int64_t step = (int64_t)1 << cell->shift;
  int64_t found = (value >= 0) ? value / step : -((-value + step - 1) / step);
  found += cell->is_signed ? ADC_CODES / 2 : 0;
  found = (found < 0) ? 0 : (found >= ADC_CODES) ? ADC_CODES - 1 : found;
  *code = (uint16_t)found;
  return true;
}
