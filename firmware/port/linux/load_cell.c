#include "firmware/port/linux/load_cell.h"

enum { ADC_CODES = 65536 };

uint16_t load_cell_code(int64_t value, uint8_t shift, bool is_signed) {
  /* The result is rounded down for negative integers too, as in an arithmetic shift. */
  const int64_t step = (int64_t)1 << shift;
  int64_t code = (value >= 0) ? value / step : -((-value + step - 1) / step);
  code += is_signed ? ADC_CODES / 2 : 0;
  return (uint16_t)((code < 0) ? 0 : (code >= ADC_CODES) ? ADC_CODES - 1 : code);
}

bool load_cell_take(const load_cell_t *cell, const can_frame_t *frame, uint16_t *code) {
  if (cell->identifier == 0 || frame->id != cell->identifier || frame->remote != 0 ||
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
  *code = load_cell_code(value, cell->shift, cell->is_signed);
  return true;
}
