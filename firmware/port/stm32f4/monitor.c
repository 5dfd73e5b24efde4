/* Measures the DAC output and the reference of the ADC: between two ticks it makes one conversion,
 * alternately of PA4 and of the internal reference. */

#include "firmware/port/stm32f4/board.h"

/* DAC and ADC each have an error of at most 1 % of their range (offset 12, gain 20, linearity 7
 * codes of 4096, by the data sheet), and PA4 has no load. */
enum { DAC_MAX = 64, MID_SCALE = 2048 };

/* 1.21 V of 3.3 V, used if the chip has no calibration of its own. */
enum { REFERENCE_CODE = 1502, CALIBRATION_MIN = 1300, CALIBRATION_MAX = 1700 };

/* An error must occur in two measurements in a row, so that a single disturbed measurement is
 * ignored. */
enum { IN_A_ROW = 2 };

static uint8_t dac_wrong;
static uint8_t reference_wrong;
static bool is_reference; /* 1: the present conversion is of the internal reference */
static bool is_started;
static int16_t expected; /* DAC code during the present conversion */
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

/* An emulator without the clocks also lacks the calibration and would have a fault. */
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

/* Call it before the conversions of the next tick: it reads the last conversion, which has had
 * nearly a tick. */
void monitor_look(void) {
  if (!is_started) {
    return;
  }
  uint16_t code = 0;
  const bool has_code = adc_read_one(&code);
  if (is_reference) {
    /* The reference voltage is constant, so its code falls when the supply rises: 3.3 V +-10 %. */
    reference_wrong = next(reference_wrong, !has_code || differs(code, nominal, nominal / 10));
  } else {
    dac_wrong = next(dac_wrong, !has_code || differs(code, MID_SCALE + expected, DAC_MAX));
  }
}

uint16_t monitor_state(void) {
  return (uint16_t)(((dac_wrong >= IN_A_ROW) ? FW_BOARD_DAC : 0) |
                    ((reference_wrong >= IN_A_ROW) ? FW_BOARD_REFERENCE : 0));
}
