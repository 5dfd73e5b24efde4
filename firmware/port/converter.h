#ifndef FIRMWARE_PORT_CONVERTER_H_
#define FIRMWARE_PORT_CONVERTER_H_

/* The protocol of a 24-bit ADC (converter) for the force: ADS1256 (Texas Instruments, SBAS288K) or
 * AD7193 (Analog Devices, Rev. E). The port (firmware/port) exchanges the bytes over its SPI bus.
 * It reads the signal (DRDY, DOUT/RDY) that shows that a conversion is ready. A port
 *
 *   for (n = 0; converter_step(kind, gain, n, &step); n++)   configures the converter:
 *     if (step.after_ready) wait for a conversion
 *     exchange step.count bytes and compare with converter_is_right(); wait for step.pause_us
 *   at each conversion: exchange converter_bytes(kind) bytes of 0 and pass them to converter_take()
 *
 * Chip select stays low from the first step on. Both converters measure the difference of their
 * first two inputs. The ADS1256 measures AIN0 - AIN1 with its buffer at 7500 conversions per second
 * and settles in 0.31 ms. The AD7193 measures AIN1 - AIN2 with its sinc3 filter at 4800 conversions
 * per second and settles in 0.63 ms.*/

#include <stdbool.h>
#include <stdint.h>

enum { CONVERTER_BYTES = 6 };

/* Number of consecutive equal readings after which the data line or the converter is regarded as
 * stuck. The noise of both converters is several codes, so a working converter does not repeat a
 * reading so often. */
enum { CONVERTER_EQUAL_MAX = 16 };

typedef struct {
  uint8_t sent[CONVERTER_BYTES];
  uint8_t wanted[CONVERTER_BYTES]; /* bytes that the converter must send in this step */
  /* mask of the bits in which the received bytes are compared with `wanted` */
  uint8_t mask[CONVERTER_BYTES];
  uint8_t count; /* number of bytes that this step exchanges with the converter */
  /* true: the port exchanges the bytes only when a conversion is ready */
  bool after_ready;
  uint16_t pause_us; /* shortest pause in us after the exchange of the bytes of this step */
} converter_step_t;

/* State of a converter: the last reading, and the number of equal readings. All bytes must be 0 at
 * the start. */
typedef struct {
  /* last reading as a signed code of 24 bits, -2^23..2^23-1; code 0 is the input voltage 0 */
  int32_t code;
  uint8_t equal; /* number of consecutive equal readings, at most CONVERTER_EQUAL_MAX */
} converter_t;

/* Writes step `number` of the configuration of a converter to *step. `kind` is a value of the
 * object force_converter, and `gain` is a value of force_converter_gain. Returns false after the
 * last step. Returns false for step 0 if the converter does not have this gain. */
bool converter_step(uint8_t kind, uint8_t gain, uint8_t number, converter_step_t *step);

/* Returns true if the received bytes of a step are the bytes that this converter must send with
 * these settings. */
bool converter_is_right(const converter_step_t *step, const uint8_t *received);

/* Returns the number of bytes that a reading of this kind of converter has. */
uint8_t converter_bytes(uint8_t kind);

/* Stores a received reading. Returns false if the converter reports an error (AD7193: input or
 * reference out of range, another channel, parity), or if the data line or the converter is
 * stuck. */
bool converter_take(converter_t *converter, uint8_t kind, const uint8_t *received);

/* Converts a code of 24 bits to an unsigned ADC code of `bits` bits, 8..16, rounded down. The
 * middle of the range of the ADC code is the input voltage 0. */
uint16_t converter_adc_code(int32_t code, uint8_t bits);

#endif
