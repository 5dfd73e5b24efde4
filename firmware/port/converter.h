#ifndef FIRMWARE_PORT_CONVERTER_H_
#define FIRMWARE_PORT_CONVERTER_H_

/* The protocol of a 24-bit converter for the force: ADS1256 (Texas Instruments, SBAS288K) or AD7193
 * (Analog Devices, Rev. E). The port exchanges the bytes over its SPI bus and reads the signal that
 * a conversion is ready (DRDY, DOUT/RDY). A port
 *
 *   for (n = 0; converter_step(kind, gain, n, &step); n++)   configures the converter:
 *     if (step.after_ready) wait for a conversion
 *     exchange step.count bytes and compare with converter_is_right(); wait for step.pause_us
 *   at each conversion: exchange converter_bytes(kind) bytes of 0 and pass them to converter_take()
 *
 * Chip select stays low from the first step on. Both converters measure the difference of their
 * first two inputs. The ADS1256 measures AIN0 - AIN1 with its buffer at 7500 conversions per second
 * and settles in 0.31 ms. The AD7193 measures AIN1 - AIN2 with its sinc3 filter at 4800 conversions
 * per second and settles in 0.63 ms. */

#include <stdbool.h>
#include <stdint.h>

enum { CONVERTER_BYTES = 6 };

/* Number of consecutive equal readings after which the data line or the converter is regarded as
 * stuck. The noise of both converters is several codes, so a working converter does not repeat a
 * reading so often. */
enum { CONVERTER_EQUAL_MAX = 16 };

typedef struct {
  uint8_t sent[CONVERTER_BYTES];
  uint8_t wanted[CONVERTER_BYTES]; /* what has to be received */
  uint8_t mask[CONVERTER_BYTES];   /* mask of the bits of `wanted` that are compared with the
                                    * received bytes */
  uint8_t count;                   /* number of bytes */
  bool after_ready;                /* the bytes are exchanged when a conversion is ready */
  uint16_t pause_us;               /* shortest pause in us after the bytes of this step */
} converter_step_t;

/* State of a converter: the last reading, and a count of equal readings; all zeros at the start. */
typedef struct {
  int32_t code;  /* signed code of 24 bits, -2^23..2^23-1; 0 is the input voltage 0 */
  uint8_t equal; /* number of equal readings in a row, at most CONVERTER_EQUAL_MAX */
} converter_t;

/* Returns step `number` of the configuration. `kind` is a value of force_converter, `gain` a value
 * of force_converter_gain. Returns false after the last step, and for number 0 if the converter
 * lacks the gain. */
bool converter_step(uint8_t kind, uint8_t gain, uint8_t number, converter_step_t *step);

/* Returns true if the received bytes of a step are those of this converter and its settings. */
bool converter_is_right(const converter_step_t *step, const uint8_t *received);

/* Returns the number of bytes of a reading. */
uint8_t converter_bytes(uint8_t kind);

/* Stores the bytes of a reading. Returns false if the converter reports an error (AD7193: input or
 * reference out of range, another channel, parity), or if a line or the converter stands still. */
bool converter_take(converter_t *converter, uint8_t kind, const uint8_t *received);

/* Scales a code to an unsigned ADC code of 8..16 bits, rounded down; the middle is the voltage 0.
 */
uint16_t converter_adc_code(int32_t code, uint8_t bits);

#endif
