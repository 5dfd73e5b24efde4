#ifndef FIRMWARE_PORT_LINUX_IIO_H_
#define FIRMWARE_PORT_LINUX_IIO_H_

/* The force of a converter that has a Linux driver for industrial I/O (IIO). Scans are read from
 * the buffer of the device, and only the newest scan is used. The files of the device in sysfs give
 * the place of the force channel in a scan (Documentation/ABI/testing/sysfs-bus-iio). These files
 * are read only once, so the user must enable the channel and the buffer before the axis is
 * started. iio_take() never waits.
 *
 * A scan contains the values of the enabled channels in the order of their indices. The value of
 * each channel begins at a multiple of its own size. The size of a scan is a multiple of the
 * largest size of a value. A timestamp is also a channel. */

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
  IIO_CHANNELS = 32,  /* largest number of enabled channels of a device */
  IIO_SCAN_MAX = 256, /* largest size of a scan in bytes */
  IIO_BYTES = 4096,   /* number of bytes in one read from the device; these are several scans */
  IIO_READS = 4,      /* largest number of reads in one call of iio_take() */
  /* value of iio_settings_t.shift with which the ADC code is the upper 16 bits of the value */
  IIO_SHIFT_OWN = 255
};

typedef struct {
  /* folder of the device, for example /sys/bus/iio/devices/iio:device0; NULL: no converter */
  const char *device;
  const char *buffer; /* character device of the converter, for example /dev/iio:device0 */
  /* name of the force channel without the prefix in_ and without a suffix, for example voltage0 */
  const char *channel;
  /* number of low bits of the value that are cut off, 0..31; IIO_SHIFT_OWN: as the device states */
  uint8_t shift;
} iio_settings_t;

/* Format of a value in a scan: `[be|le]:[s|u]bits/storagebits[Xrepeat][>>shift]`. */
typedef struct {
  bool is_big;    /* true: the highest byte of a value is first */
  bool is_signed; /* true: the values of the channel are two's complement numbers */
  uint8_t bits;   /* number of valid bits of a value of the channel, 1..64 */
  uint8_t bytes;  /* size of one value with its padding: 1, 2, 4 or 8 */
  uint8_t repeat; /* number of values of the channel in a scan: 1, 2, 4 or 8 */
  /* number of unused bits below the valid bits; shift + bits is at most 8 x bytes */
  uint8_t shift;
} iio_type_t;

typedef struct {
  int fd;
  iio_type_t type; /* format of the values of the channel */
  uint8_t shift;   /* number of low bits of the value that are cut off, 0..31 */
  uint16_t offset; /* offset of the channel in a scan, in bytes */
  uint16_t scan;   /* size of a scan in bytes, 1..IIO_SCAN_MAX */
  /* number of bytes in the array `bytes`; they are the begin of an incomplete scan */
  uint16_t used;
  int error;      /* errno of the last read if this read has failed, otherwise 0 */
  bool has_ended; /* true: the last read has reached the end of the file */
  uint8_t bytes[IIO_BYTES];
} iio_t;

/* Reads the format of a value from a text. Returns false if the text has another form, or if its
 * numbers are outside the ranges of iio_type_t. */
bool iio_type_of(const char *text, iio_type_t *type);

/* Returns the value that is stored in type->bytes bytes at `bytes`. The value has at most 63 valid
 * bits. */
int64_t iio_value(const iio_type_t *type, const uint8_t *bytes);

/* Opens an IIO device. The force channel must be enabled and have 1 to 32 bits and no repetition,
 * and the buffer of the device must be enabled. Returns NULL, or a sentence without a full stop
 * that states what was expected and what to do. The sentence is valid until the next call. */
const char *iio_open(iio_t *iio, const iio_settings_t *settings);

/* Reads all available scans without waiting, at most IIO_READS x IIO_BYTES bytes. Call this
 * function in each tick. Returns true if a complete scan was read, and writes the ADC code of the
 * newest complete scan to *code: (value >> shift) + 32768 for a signed channel, value >> shift
 * otherwise, both limited to 0..65535. If there is no complete scan, *code does not change. The
 * rest of an incomplete scan is read by a later call. */
bool iio_take(iio_t *iio, uint16_t *code);

/* Returns the reason why the last iio_take() could not read, as a sentence without a full stop.
 * Returns NULL if there was no error; it is no error if no scan was available. */
const char *iio_trouble(const iio_t *iio);

#ifdef __cplusplus
}
#endif

#endif
