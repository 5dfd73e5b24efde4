/* What the outputs and the ADC's reference are, measured: between two ticks one conversion, of PA4
 * and of the internal reference in turn. */

#include "firmware/port/stm32f4/board.h"

/* DAC and ADC are within 1 % of their range each (offset 12, gain 20, linearity 7 codes of 4096, by
 * the data sheet), and PA4 is not loaded. */
enum { DAC_MAX = 64, MID_SCALE = 2048 };

/* 1.21 V of 3.3 V, where the chip's own calibration is missing. */
enum { REFERENCE_CODE = 1502, CALIBRATION_MIN = 1300, CALIBRATION_MAX = 1700 };

/* Of two in a row, so that one that is disturbed counts for nothing. */
enum { IN_A_ROW = 2 };

static uint8_t dac_wrong;
static uint8_t reference_wrong;
static bool is_reference; /* the conversion under way */
static bool is_started;
static int16_t expected; /* DAC code during it */
static int32_t nominal = REFERENCE_CODE;

static uint8_t next(uint8_t count, bool is_wrong) {
  if (!is_wrong) {
    return 0;
  }
  return (uint8_t)((count < IN_A_ROW) ? count + 1 : IN_A_ROW);
}

static bool differs(int32_t value, int32_t wanted, int32_t most) {
  return value - wanted > most || wanted - value > most;
}

/* An emulator that lacks the clocks lacks the calibration too, and faults. */
void monitor_init(void) {
  const int32_t code = *(const volatile uint16_t *)VREFINT_CAL_BASE;
  if (code >= CALIBRATION_MIN && code <= CALIBRATION_MAX) {
    nominal = code;
  }
}

void monitor_start(int16_t code) {
  is_reference = !is_reference;
  expected = code;
  is_started = true;
  adc_start_one(is_reference);
}

/* Before the next tick's conversions: the last one, which has had nearly a tick. */
void monitor_look(void) {
  if (!is_started) {
    return;
  }
  uint16_t code = 0;
  const bool has_code = adc_read_one(&code);
  if (is_reference) {
    /* The reference is fixed, so its code falls where the supply rises: 3.3 V +-10 %. */
    reference_wrong = next(reference_wrong, !has_code || differs(code, nominal, nominal / 10));
  } else {
    dac_wrong = next(dac_wrong, !has_code || differs(code, MID_SCALE + expected, DAC_MAX));
  }
}

uint16_t monitor_state(void) {
  return (uint16_t)(((dac_wrong >= IN_A_ROW) ? FW_BOARD_DAC : 0) |
                    ((reference_wrong >= IN_A_ROW) ? FW_BOARD_REFERENCE : 0));
}
