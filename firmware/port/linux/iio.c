/* This file uses files and folders of Linux. */
#define _GNU_SOURCE

#include "firmware/port/linux/iio.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/port/linux/load_cell.h"

enum { PATH_BYTES = 512, TEXT_BYTES = 64, ADC_BITS = 16, VALUE_BITS_MAX = 32 };

/* An enabled channel of the IIO device. */
typedef struct {
  unsigned long index;
  iio_type_t type;
  bool is_force;
} channel_t;

/* The sentence about an error that iio_open() has returned last. */
static char message[2 * PATH_BYTES];

/* Reads a decimal number from 0 to `most`, and moves *text to the first character after the
 * number. */
static bool read_number(const char **text, unsigned long most, uint8_t *number) {
  char *end;
  if (**text < '0' || **text > '9') {
    return false;
  }
  const unsigned long value = strtoul(*text, &end, 10);
  *text = end;
  *number = (uint8_t)value;
  return value <= most;
}

/* If *text begins with `word`, moves *text to the first character after `word`. */
static bool skip(const char **text, const char *word) {
  const size_t length = strlen(word);
  const bool is_there = strncmp(*text, word, length) == 0;
  *text += is_there ? length : 0;
  return is_there;
}

/* Returns true if a number is 1, 2, 4 or 8. */
static bool is_power(unsigned number) {
  return number >= 1 && number <= 8 && (number & (number - 1)) == 0;
}

/* Reads the numbers in a text `bits/storagebits[Xrepeat][>>shift]`. */
static bool read_numbers(const char **text, iio_type_t *type) {
  uint8_t storage = 0;
  type->repeat = 1;
  type->shift = 0;
  bool is_right = read_number(text, 64, &type->bits) && skip(text, "/") &&
                  read_number(text, 64, &storage) && storage % 8 == 0;
  if (is_right && skip(text, "X")) {
    is_right = read_number(text, 8, &type->repeat);
  }
  if (is_right && skip(text, ">>")) {
    is_right = read_number(text, 63, &type->shift);
  }
  type->bytes = (uint8_t)(storage / 8);
  return is_right;
}

bool iio_type_of(const char *text, iio_type_t *type) {
  type->is_big = skip(&text, "be:");
  if (!type->is_big && !skip(&text, "le:")) {
    return false;
  }
  type->is_signed = skip(&text, "s");
  if (!type->is_signed && !skip(&text, "u")) {
    return false;
  }
  if (!read_numbers(&text, type)) {
    return false;
  }
  (void)skip(&text, "\n");
  return *text == '\0' && is_power(type->bytes) && is_power(type->repeat) && type->bits >= 1 &&
         type->bits + type->shift <= 8 * type->bytes;
}

int64_t iio_value(const iio_type_t *type, const uint8_t *bytes) {
  uint64_t raw = 0;
  for (uint8_t i = 0; i < type->bytes; i++) {
    const uint8_t byte = bytes[type->is_big ? type->bytes - 1 - i : i];
    raw |= (uint64_t)byte << (8 * i);
  }
  const uint64_t range = (uint64_t)1 << type->bits;
  const uint64_t value = (raw >> type->shift) & (range - 1);
  const bool is_negative = type->is_signed && value >= range / 2;
  return is_negative ? (int64_t)value - (int64_t)range : (int64_t)value;
}

/* Writes the error sentence that iio_open() returns. */
#define FAIL(...) ((void)snprintf(message, sizeof(message), __VA_ARGS__), message)

/* Reads the first line of the file `name` in `folder`. */
static bool read_text(const char *folder, const char *name, char text[TEXT_BYTES]) {
  char path[PATH_BYTES];
  const int length = snprintf(path, sizeof(path), "%s/%s", folder, name);
  FILE *file = (length < (int)sizeof(path)) ? fopen(path, "re") : NULL;
  if (file == NULL) {
    return false;
  }
  const bool has_text = fgets(text, TEXT_BYTES, file) != NULL;
  (void)fclose(file);
  return has_text;
}

static bool is_one(const char *folder, const char *name) {
  char text[TEXT_BYTES];
  return read_text(folder, name, text) && strtol(text, NULL, 10) == 1;
}

/* Reads the index and the type of a channel. `name` is the name of the file NAME_en of this
 * channel. */
static const char *read_channel(const char *folder, const char *name, channel_t *channel) {
  char file[PATH_BYTES / 2];
  char text[TEXT_BYTES];
  char *end;
  const int length = (int)(strlen(name) - strlen("_en"));
  (void)snprintf(file, sizeof(file), "%.*s_index", length, name);
  if (!read_text(folder, file, text)) {
    return FAIL("expected a file %s/%s; name the folder of an IIO device", folder, file);
  }
  channel->index = strtoul(text, &end, 10);
  (void)snprintf(file, sizeof(file), "%.*s_type", length, name);
  if (end == text || !read_text(folder, file, text) || !iio_type_of(text, &channel->type)) {
    return FAIL("%s/%s: expected a type such as le:s24/32>>8; use a driver of the kernel's IIO",
                folder, file);
  }
  return NULL;
}

/* Adds a channel to the sorted list of channels. The list is in the order of their indices. */
static void insert(channel_t *channels, uint8_t count, const channel_t *channel) {
  uint8_t place = count;
  for (; place > 0 && channels[place - 1].index > channel->index; place--) {
    channels[place] = channels[place - 1];
  }
  channels[place] = *channel;
}

static bool is_enable_file(const char *name) {
  const size_t length = strlen(name);
  return length > strlen("_en") && length < PATH_BYTES / 4 &&
         strcmp(name + length - strlen("_en"), "_en") == 0;
}

/* Reads the enabled channels from the files of an open folder into channels[IIO_CHANNELS]. `force`
 * is the name of the file of the force channel, for example in_voltage0_en. */
static const char *read_channels(DIR *open, const char *folder, const char *force,
                                 channel_t *channels, uint8_t *count) {
  const struct dirent *entry;
  *count = 0;
  while ((entry = readdir(open)) != NULL) {
    if (!is_enable_file(entry->d_name) || !is_one(folder, entry->d_name)) {
      continue;
    }
    channel_t channel = {.is_force = strcmp(entry->d_name, force) == 0};
    const char *error = (*count < IIO_CHANNELS)
                            ? read_channel(folder, entry->d_name, &channel)
                            : FAIL("expected at most %d enabled channels", IIO_CHANNELS);
    if (error != NULL) {
      return error;
    }
    insert(channels, *count, &channel);
    (*count)++;
  }
  return NULL;
}

static uint32_t aligned(uint32_t offset, uint32_t size) {
  return (offset + size - 1) / size * size;
}

/* Computes the offset of the force channel in a scan, and the size of a scan. */
static const char *lay_out(iio_t *iio, const channel_t *channels, uint8_t count, const char *name) {
  uint32_t end = 0;
  uint32_t largest = 1;
  bool is_found = false;
  for (uint8_t i = 0; i < count; i++) {
    const iio_type_t *type = &channels[i].type;
    const uint32_t size = (uint32_t)type->bytes * type->repeat;
    end = aligned(end, size);
    if (channels[i].is_force) {
      is_found = true;
      iio->type = *type;
      iio->offset = (uint16_t)end;
    }
    end += size;
    largest = (size > largest) ? size : largest;
  }
  end = aligned(end, largest);
  if (!is_found) {
    return FAIL("expected that the channel %s is enabled; write 1 to in_%s_en of the device", name,
                name);
  }
  if (iio->type.bits > VALUE_BITS_MAX || iio->type.repeat > 1 || end > IIO_SCAN_MAX) {
    return FAIL(
        "channel %s: expected a single value of 1 to %d bits, in a scan of at most %d bytes", name,
        VALUE_BITS_MAX, IIO_SCAN_MAX);
  }
  iio->scan = (uint16_t)end;
  return NULL;
}

/* Reads the files of the IIO device. In newer kernels the files of the channels are also in the
 * folder `buffer0`. */
static const char *read_device(iio_t *iio, const iio_settings_t *settings) {
  char folder[PATH_BYTES / 2];
  char force[PATH_BYTES / 4];
  channel_t channels[IIO_CHANNELS];
  uint8_t count;
  (void)snprintf(folder, sizeof(folder), "%s/scan_elements", settings->device);
  (void)snprintf(force, sizeof(force), "in_%s_en", settings->channel);
  DIR *open = opendir(folder);
  if (open == NULL) {
    return FAIL("expected a folder %s: %s; name an IIO device with a buffer", folder,
                strerror(errno));
  }
  const char *error = read_channels(open, folder, force, channels, &count);
  (void)closedir(open);
  if (error == NULL) {
    error = lay_out(iio, channels, count, settings->channel);
  }
  if (error == NULL && !is_one(settings->device, "buffer/enable")) {
    error = FAIL("expected an enabled buffer; write 1 to %s/buffer/enable", settings->device);
  }
  return error;
}

static uint8_t own_shift(const iio_type_t *type) {
  return (uint8_t)((type->bits > ADC_BITS) ? type->bits - ADC_BITS : 0);
}

const char *iio_open(iio_t *iio, const iio_settings_t *settings) {
  *iio = (iio_t){.fd = -1};
  const char *error = read_device(iio, settings);
  if (error != NULL) {
    return error;
  }
  iio->shift = (settings->shift == IIO_SHIFT_OWN) ? own_shift(&iio->type) : settings->shift;
  iio->fd = open(settings->buffer, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (iio->fd < 0) {
    return FAIL("expected a buffer %s that can be read: %s", settings->buffer, strerror(errno));
  }
  return NULL;
}

/* Reads once from the IIO device. Returns true if more bytes may be available. */
static bool read_more(iio_t *iio) {
  const ssize_t count = read(iio->fd, iio->bytes + iio->used, sizeof(iio->bytes) - iio->used);
  const bool is_none = count < 0 && (errno == EAGAIN || errno == EINTR);
  iio->has_ended = count == 0;
  iio->error = (count < 0 && !is_none) ? errno : 0;
  if (count > 0) {
    iio->used = (uint16_t)(iio->used + count);
  }
  return count > 0;
}

/* Uses the newest complete scan and keeps the bytes after this scan. Returns false if there is no
 * complete scan. */
static bool take_newest(iio_t *iio, uint16_t *code) {
  const uint16_t whole = (uint16_t)(iio->used / iio->scan * iio->scan);
  if (whole == 0) {
    return false;
  }
  const uint8_t *newest = iio->bytes + whole - iio->scan;
  *code =
      load_cell_code(iio_value(&iio->type, newest + iio->offset), iio->shift, iio->type.is_signed);
  iio->used = (uint16_t)(iio->used - whole);
  memmove(iio->bytes, iio->bytes + whole, iio->used);
  return true;
}

bool iio_take(iio_t *iio, uint16_t *code) {
  bool has_scan = false;
  for (uint8_t i = 0; i < IIO_READS && read_more(iio); i++) {
    has_scan = take_newest(iio, code) || has_scan;
  }
  return has_scan;
}

const char *iio_trouble(const iio_t *iio) {
  if (iio->has_ended) {
    return "the buffer of the force has ended";
  }
  return (iio->error != 0) ? strerror(iio->error) : NULL;
}
