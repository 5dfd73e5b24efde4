/* This file uses POSIX functions for files and locks. */
#define _GNU_SOURCE

#include "firmware/port/host/store_file.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

enum { CHUNK_BYTES = 256 };

/* Writes all bytes to the file. Returns false if a byte could not be written. */
static bool write_all(int file, uint32_t at, const uint8_t *bytes, uint32_t count) {
  while (count > 0) {
    const ssize_t done = pwrite(file, bytes, count, (off_t)at);
    if (done < 0 && errno == EINTR) {
      continue;
    }
    if (done <= 0) {
      return false;
    }
    at += (uint32_t)done;
    bytes += done;
    count -= (uint32_t)done;
  }
  return true;
}

/* Bytes that cannot be read from the file are returned as blank bytes; a record of blank bytes has
 * no valid CRC. */
static void read_bytes(void *context, uint32_t address, uint8_t *bytes, uint32_t count) {
  const store_file_t *store_file = context;
  memset(bytes, 0xFF, count);
  ssize_t done = 0;
  do {
    done = pread(store_file->file, bytes, count, (off_t)address);
  } while (done < 0 && errno == EINTR);
}

/* Programs bytes of the file. As in a flash memory, programming can only clear bits. */
static bool program_bytes(void *context, uint32_t address, const uint8_t *bytes, uint32_t count) {
  const store_file_t *store_file = context;
  uint8_t chunk[CHUNK_BYTES];
  while (count > 0) {
    const uint32_t part = (count < CHUNK_BYTES) ? count : CHUNK_BYTES;
    read_bytes(context, address, chunk, part);
    for (uint32_t i = 0; i < part; i++) {
      chunk[i] &= bytes[i];
    }
    if (!write_all(store_file->file, address, chunk, part)) {
      return false;
    }
    address += part;
    bytes += part;
    count -= part;
  }
  return true;
}

static bool erase_range(int file, uint32_t at, uint32_t count) {
  uint8_t blank[CHUNK_BYTES];
  memset(blank, 0xFF, sizeof(blank));
  for (uint32_t i = 0; i < count; i += CHUNK_BYTES) {
    if (!write_all(file, at + i, blank, CHUNK_BYTES)) {
      return false;
    }
  }
  return true;
}

static bool erase_sector(void *context, uint8_t sector) {
  const store_file_t *store_file = context;
  const uint32_t bytes = store_file->memory.sector_bytes;
  return erase_range(store_file->file, sector * bytes, bytes);
}

static bool is_blank(store_file_t *store_file, uint32_t count) {
  bool blank = true;
  for (uint32_t i = 0; i < count; i++) {
    uint8_t byte;
    read_bytes(store_file, i, &byte, 1);
    blank = blank && byte == 0xFF;
  }
  return blank;
}

/* Checks the size of the file, and erases the sectors of a new file. A file whose creation was
 * interrupted is also treated as new. Returns NULL or a text with the error. */
static const char *check_contents(store_file_t *store_file, const char *expected) {
  const int file = store_file->file;
  const uint32_t bytes = 2 * store_file->memory.sector_bytes;
  struct stat status;
  if (fstat(file, &status) != 0) {
    return strerror(errno);
  }
  if (S_ISREG(status.st_mode) && status.st_size == bytes) {
    return NULL;
  }
  if (!S_ISREG(status.st_mode) || status.st_size > bytes ||
      !is_blank(store_file, (uint32_t)status.st_size)) {
    return expected;
  }
  return erase_range(file, 0, bytes) ? NULL : strerror(errno);
}

static const char *open_sectors(store_file_t *store_file, const char *path, uint32_t sector_bytes,
                                const char *expected) {
  const int file = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (file < 0) {
    return strerror(errno);
  }
  const char *wrong = (flock(file, LOCK_EX | LOCK_NB) == 0)
                          ? NULL
                          : "expected a file that no other axis uses; stop the other axis";
  store_file->file = file;
  store_file->memory = (store_memory_t){
      .context = store_file,
      .sector_bytes = sector_bytes,
      .read = read_bytes,
      .program = program_bytes,
      .erase = erase_sector,
  };
  if (wrong == NULL) {
    wrong = check_contents(store_file, expected);
  }
  if (wrong != NULL) {
    close(file);
  }
  return wrong;
}

const char *store_file_open(store_file_t *store_file, const char *path) {
  return open_sectors(store_file, path, STORE_FILE_SECTOR_BYTES,
                      "expected a parameter store of 32768 bytes; name such a file or a new file");
}

const char *archive_file_open(store_file_t *store_file, const char *path) {
  return open_sectors(store_file, path, ARCHIVE_FILE_SECTOR_BYTES,
                      "expected an archive of incidents of 65536 bytes; rename this file");
}

void store_file_close(store_file_t *store_file) { close(store_file->file); }
