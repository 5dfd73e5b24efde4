/* Measures the output voltage of the DAC and the internal reference of the ADC. Between two ticks
 * one conversion is made: alternately of pin PA4, which the DAC drives, and of the internal
 * reference. */

#include "firmware/port/stm32/board.h"

/* Largest difference in codes between the DAC code and the ADC code of pin PA4. By the data sheet,
 * DAC and ADC each have an error of at most 1 % of their range (offset 12, gain 20, linearity 7
 * codes of 4096). Pin PA4 has no load. */
enum { DAC_MAX = 64, MID_SCALE = 2048 };

/* ADC code of the internal reference, 1.21 V of 3.3 V, for a chip whose stored calibration is not
 * within CALIBRATION_MIN..CALIBRATION_MAX. */
enum { REFERENCE_CODE = 1502, CALIBRATION_MIN = 1300, CALIBRATION_MAX = 1700 };

/* An error counts only if it occurs in this number of consecutive measurements. So a single
 * disturbed measurement is ignored. */
enum { IN_A_ROW = 2 };

static uint8_t dac_wrong;
static uint8_t reference_wrong;
static bool is_reference; /* true: the present conversion measures the internal reference; false: it
                           * measures pin PA4 */
static bool is_started;
static int16_t expected; /* DAC code that the DAC outputs during the ADC's conversion */
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

/* Returns the ADC code that pin PA4 should have for the DAC code `code`. The output buffer of a DAC
 * may not reach the ends of the range. */
static int32_t reachable(int32_t code) {
  const int32_t above = (code < DAC_REACH_MIN) ? DAC_REACH_MIN : code;
  return (above > DAC_REACH_MAX) ? DAC_REACH_MAX : above;
}

/* Reads the calibration of the internal reference. Call this function only if the clock is correct.
 * An emulator without the clocks does not have the calibration either, and a read of it would cause
 * a fault. */
void monitor_init(void) {
  const int32_t code = reference_at_3_3_v(*(const volatile uint16_t *)VREFINT_CAL_BASE);
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

/* Evaluates the last conversion. Call this function before the conversions of the next tick, so
 * that the conversion has had nearly one tick of time. */
void monitor_look(void) {
  if (!is_started) {
    return;
  }
  uint16_t code = 0;
  const bool has_code = adc_read_one(&code);
  if (is_reference) {
    /* The reference voltage is constant, so its ADC code falls when the supply voltage rises. The
     * permitted supply voltage is 3.3 V +-10 %. */
    reference_wrong = next(reference_wrong, !has_code || differs(code, nominal, nominal / 10));
  } else {
    dac_wrong =
        next(dac_wrong, !has_code || differs(code, reachable(MID_SCALE + expected), DAC_MAX));
  }
}

uint16_t monitor_state(void) {
  return (uint16_t)(((dac_wrong >= IN_A_ROW) ? AXIS_BOARD_STATE_DAC : 0) |
                    ((reference_wrong >= IN_A_ROW) ? AXIS_BOARD_STATE_REFERENCE : 0));
}
