#ifndef FIRMWARE_PORT_LINUX_IIO_H_
#define FIRMWARE_PORT_LINUX_IIO_H_

/* The force of a converter with a driver of Linux for industrial I/O (IIO): scans are read from the
 * buffer of the device, and the newest one counts. The files of the device in sysfs say where the
 * channel is in a scan (Documentation/ABI/testing/sysfs-bus-iio). They are read once: whoever
 * starts the axis has enabled channel and buffer before. No call of iio_take() waits.
 *
 * A scan has the enabled channels in the order of their indices. Each one begins at a multiple of
 * its own size, and a scan is as long as a multiple of the largest size. A timestamp is such a
 * channel. */

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
  IIO_CHANNELS = 32,  /* largest number of enabled channels of a device */
  IIO_SCAN_MAX = 256, /* bytes of a scan, at most */
  IIO_BYTES = 4096,   /* number of bytes that are read at once; this is several scans */
  IIO_READS = 4,      /* largest number of reads in one call of iio_take() */
  IIO_SHIFT_OWN = 255 /* iio_settings_t.shift: the upper 16 bits of the value */
};

typedef struct {
  const char *device;  /* folder of the device, such as /sys/bus/iio/devices/iio:device0; or NULL */
  const char *buffer;  /* character device of the same converter, such as /dev/iio:device0 */
  const char *channel; /* name of the force channel without in_ and without an ending, such as
                        * voltage0 */
  uint8_t shift;       /* number of lowest bits of the value that are cut off, 0..31, or
                        * IIO_SHIFT_OWN */
} iio_settings_t;

/* Format of a value in a scan: `[be|le]:[s|u]bits/storagebits[Xrepeat][>>shift]`. */
typedef struct {
  bool is_big;    /* the highest byte comes first */
  bool is_signed; /* two's complement */
  uint8_t bits;   /* valid bits, 1..64 */
  uint8_t bytes;  /* size of one value with its padding: 1, 2, 4 or 8 */
  uint8_t repeat; /* number of values of the channel in a scan: 1, 2, 4 or 8 */
  uint8_t shift;  /* unused bits below the valid ones, with bits at most 8 x bytes */
} iio_type_t;

typedef struct {
  int fd;
  iio_type_t type; /* format of the values of the channel */
  uint8_t shift;   /* 0..31 */
  uint16_t offset; /* offset of the channel in a scan, in bytes */
  uint16_t scan;   /* size of a scan in bytes, 1..IIO_SCAN_MAX */
  uint16_t used;   /* number of bytes in `bytes` that are the begin of an incomplete scan */
  int error;       /* errno of the last read that has failed, else 0 */
  bool has_ended;  /* the last read was at the end of the file */
  uint8_t bytes[IIO_BYTES];
} iio_t;

/* Reads a type. Returns false if the text has another form, or numbers outside the ranges above. */
bool iio_type_of(const char *text, iio_type_t *type);

/* Returns the value at `bytes`, which has type->bytes bytes and at most 63 valid bits. */
int64_t iio_value(const iio_type_t *type, const uint8_t *bytes);

/* Opens a device. Returns NULL, or a sentence without a full stop that says what was expected and
 * what to do; the sentence stays until the next call. Needs a channel of 1 to 32 bits that is
 * enabled, without a repetition, and an enabled buffer. */
const char *iio_open(iio_t *iio, const iio_settings_t *settings);

/* Reads all available scans without waiting, at most IIO_READS x IIO_BYTES bytes. Call this
 * function in each tick. Returns true if a complete scan was read, and writes the ADC code of the
 * newest complete scan to *code: (value >> shift) + 32768 for a signed channel, value >> shift
 * otherwise, both limited to 0..65535. Without a complete scan *code does not change. An incomplete
 * scan is continued by a later call. */
bool iio_take(iio_t *iio, uint16_t *code);

/* Returns the reason why the last iio_take() could not read, as a sentence without a full stop.
 * Returns NULL if there was no error, also if no scan was available. */
const char *iio_trouble(const iio_t *iio);

#ifdef __cplusplus
}
#endif

#endif
