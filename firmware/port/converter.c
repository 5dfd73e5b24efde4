#include "firmware/port/converter.h"

#include <stddef.h>

#include "firmware/objects/generated/axis_objects.h"

enum { MIDDLE = 0x800000, BITS = 24, ALL = 0xFF };

/* Commands and registers of the ADS1256. */
enum {
  ADS_RDATAC = 0x03,
  ADS_RREG = 0x10,
  ADS_WREG = 0x50,
  ADS_SELFCAL = 0xF0,
  ADS_RESET = 0xFE,
  ADS_ID = 0x30, /* upper four bits of the register STATUS of the ADS1256 */
  /* bit of the register STATUS of the ADS1256 that switches the input buffer on */
  ADS_BUFFER = 0x02,
  ADS_AIN0_AIN1 = 0x01,
  ADS_7500 = 0xD0, /* value of the register DRATE of the ADS1256: 7500 conversions per second */
  /* mask of the bits of STATUS (ADS1256) that are compared: all except the bit that shows whether a
   * conversion is ready */
  ADS_STATUS_MASK = 0xFE,
  ADS_ADCON_MASK = 0x7F
};

/* Pauses in us. After a reset the ADS1256 calibrates itself in 0.6 ms. Its command SELFCAL takes
 * 0.9 ms at 7500 conversions per second. Between a command and its answer it needs 50 cycles of
 * 7.68 MHz, which are 6.5 us, and between two commands 4 or 24 cycles. A reset of the AD7193 takes
 * 0.5 ms. */
enum { PAUSE_RESET = 2000, PAUSE_CALIBRATION = 5000, PAUSE = 10 };

/* Values for the communications register of the AD7193, each of which selects another register.
 * Also values and bits of the selected registers. */
enum {
  AD_WRITE_MODE = 0x08,
  AD_WRITE_CONFIGURATION = 0x10,
  AD_READ_MODE = 0x48,
  AD_READ_CONFIGURATION = 0x50,
  AD_READ_CONTINUOUSLY = 0x5C,
  AD_READ_ID = 0x60,
  AD_ID = 0x02,
  AD_ID_MASK = 0x0F,
  AD_ERROR = 0x40,
  AD_NO_REFERENCE = 0x20,
  AD_PARITY = 0x10,
  AD_CHANNEL = 0x0F
};
/* Mode of the AD7193: continuous conversion, status after the data, internal clock, sinc3 filter,
 * parity, FS = 1. */
#define AD_MODE UINT32_C(0x18A001)
/* Configuration of the AD7193: bipolar input AIN1 - AIN2, detection of the reference voltage, input
 * buffer on. */
#define AD_CONFIGURATION UINT32_C(0x000150)

static void send(converter_step_t *step, const uint8_t *bytes, uint8_t count, uint16_t pause_us) {
  for (uint8_t i = 0; i < count; i++) {
    step->sent[i] = bytes[i];
  }
  step->count = count;
  step->pause_us = pause_us;
}

static void expect(converter_step_t *step, uint8_t at, uint8_t wanted, uint8_t mask) {
  step->wanted[at] = wanted;
  step->mask[at] = mask;
}

/* Makes a step of the configuration that sends the address of a register. If `expects` is false,
 * the step also sends the 24 bits of `value`, the highest byte first. Otherwise the converter must
 * answer with these 24 bits. */
static void exchange_24(converter_step_t *step, uint8_t address, uint32_t value, bool expects) {
  const uint8_t bytes[] = {(uint8_t)(value >> 16), (uint8_t)(value >> 8), (uint8_t)value};
  step->sent[0] = address;
  step->count = 4;
  step->pause_us = PAUSE;
  for (uint8_t i = 0; i < 3; i++) {
    if (expects) {
      expect(step, (uint8_t)(1 + i), bytes[i], ALL);
    } else {
      step->sent[1 + i] = bytes[i];
    }
  }
}

static bool ads1256_step(uint8_t gain, uint8_t number, converter_step_t *step) {
  const uint8_t registers[] = {ADS_WREG, 3, ADS_BUFFER, ADS_AIN0_AIN1, gain, ADS_7500};
  switch (number) {
    case 0:
      send(step, (const uint8_t[]){ADS_RESET}, 1, PAUSE_RESET);
      return gain <= AXIS_FORCE_CONVERTER_GAIN_X64;
    case 1:
      send(step, (const uint8_t[]){ADS_RREG, 0}, 2, PAUSE);
      return true;
    case 2:
      send(step, (const uint8_t[]){0}, 1, PAUSE);
      expect(step, 0, ADS_ID, 0xF0);
      return true;
    case 3:
      send(step, registers, sizeof(registers), PAUSE);
      return true;
    case 4:
      send(step, (const uint8_t[]){ADS_SELFCAL}, 1, PAUSE_CALIBRATION);
      return true;
    case 5:
      send(step, (const uint8_t[]){ADS_RREG, 3}, 2, PAUSE);
      return true;
    case 6:
      send(step, (const uint8_t[]){0, 0, 0, 0}, 4, PAUSE);
      expect(step, 0, ADS_ID | ADS_BUFFER, ADS_STATUS_MASK);
      expect(step, 1, ADS_AIN0_AIN1, ALL);
      expect(step, 2, gain, ADS_ADCON_MASK);
      expect(step, 3, ADS_7500, ALL);
      return true;
    case 7:
      send(step, (const uint8_t[]){ADS_RDATAC}, 1, PAUSE);
      step->after_ready = true;
      return true;
    default:
      return false;
  }
}

static bool ad7193_step(uint8_t gain, uint8_t number, converter_step_t *step) {
  /* the reset of an AD7193 needs at least 40 bits with the value 1 */
  static const uint8_t reset[] = {ALL, ALL, ALL, ALL, ALL, ALL};
  /* The AD7193 has the gain 1 and the gains 8 to 128. The code of a gain is its exponent to the
   * base 2. */
  const uint32_t configuration = AD_CONFIGURATION | gain;
  switch (number) {
    case 0:
      send(step, reset, sizeof(reset), PAUSE_RESET);
      return gain != AXIS_FORCE_CONVERTER_GAIN_X2 && gain != AXIS_FORCE_CONVERTER_GAIN_X4;
    case 1:
      send(step, (const uint8_t[]){AD_READ_ID, 0}, 2, PAUSE);
      expect(step, 1, AD_ID, AD_ID_MASK);
      return true;
    case 2:
      exchange_24(step, AD_WRITE_CONFIGURATION, configuration, false);
      return true;
    case 3:
      exchange_24(step, AD_WRITE_MODE, AD_MODE, false);
      return true;
    case 4:
      exchange_24(step, AD_READ_CONFIGURATION, configuration, true);
      return true;
    case 5:
      exchange_24(step, AD_READ_MODE, AD_MODE, true);
      return true;
    case 6:
      send(step, (const uint8_t[]){AD_READ_CONTINUOUSLY}, 1, PAUSE);
      step->after_ready = true;
      return true;
    default:
      return false;
  }
}

bool converter_step(uint8_t kind, uint8_t gain, uint8_t number, converter_step_t *step) {
  *step = (converter_step_t){0};
  return (kind == AXIS_FORCE_CONVERTER_AD7193) ? ad7193_step(gain, number, step)
                                               : ads1256_step(gain, number, step);
}

bool converter_is_right(const converter_step_t *step, const uint8_t *received) {
  for (uint8_t i = 0; i < step->count; i++) {
    if (((received[i] ^ step->wanted[i]) & step->mask[i]) != 0) {
      return false;
    }
  }
  return true;
}

uint8_t converter_bytes(uint8_t kind) { return (kind == AXIS_FORCE_CONVERTER_AD7193) ? 4 : 3; }

/* Returns true if the number of ones in a word is odd. */
static bool is_odd(uint32_t word) {
  for (uint32_t half = 16; half > 0; half /= 2) {
    word ^= word >> half;
  }
  return (word & 1) != 0;
}

/* Checks the status byte that follows a reading of the AD7193. Its bit PARITY is 1 if the number of
 * ones in the data is odd. If all bits of the data are 0, the data line is stuck at 0. */
static bool ad7193_is_right(uint32_t data, uint8_t status) {
  return (status & (AD_ERROR | AD_NO_REFERENCE | AD_CHANNEL)) == 0 &&
         is_odd(data) == ((status & AD_PARITY) != 0) && data != 0;
}

bool converter_take(converter_t *converter, uint8_t kind, const uint8_t *received) {
  const uint32_t data =
      (uint32_t)received[0] << 16 | (uint32_t)received[1] << 8 | (uint32_t)received[2];
  const bool is_ad7193 = kind == AXIS_FORCE_CONVERTER_AD7193;
  /* The code of an AD7193 is offset binary. The code of an ADS1256 is two's complement. */
  const int32_t code = (int32_t)(is_ad7193 ? data : (data ^ MIDDLE)) - MIDDLE;
  const bool is_equal = code == converter->code;
  converter->code = code;
  if (!is_equal) {
    converter->equal = 1;
  } else if (converter->equal < CONVERTER_EQUAL_MAX) {
    converter->equal++;
  }
  return converter->equal < CONVERTER_EQUAL_MAX &&
         (!is_ad7193 || ad7193_is_right(data, received[3]));
}

uint16_t converter_adc_code(int32_t code, uint8_t bits) {
  return (uint16_t)((uint32_t)(code + MIDDLE) >> (BITS - bits));
}
