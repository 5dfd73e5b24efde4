/* Files and their locks are POSIX. */
#define _GNU_SOURCE

#include "firmware/port/host/store_file.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

enum { FILE_BYTES = 2 * STORE_FILE_SECTOR_BYTES, CHUNK_BYTES = 256 };

/* Whole or not at all, as far as the caller is concerned. */
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

/* What cannot be read reads as blank, which no CRC covers. */
static void read_bytes(void *context, uint32_t address, uint8_t *bytes, uint32_t count) {
  const store_file_t *store_file = context;
  memset(bytes, 0xFF, count);
  ssize_t done = 0;
  do {
    done = pread(store_file->file, bytes, count, (off_t)address);
  } while (done < 0 && errno == EINTR);
}

/* Programming clears bits and sets none. */
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
  return erase_range(store_file->file, (uint32_t)sector * STORE_FILE_SECTOR_BYTES,
                     STORE_FILE_SECTOR_BYTES);
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

/* A file that was just made, or whose making was cut off, holds nothing yet. */
static const char *check_contents(store_file_t *store_file) {
  const int file = store_file->file;
  struct stat status;
  if (fstat(file, &status) != 0) {
    return strerror(errno);
  }
  if (S_ISREG(status.st_mode) && status.st_size == FILE_BYTES) {
    return NULL;
  }
  if (!S_ISREG(status.st_mode) || status.st_size > FILE_BYTES ||
      !is_blank(store_file, (uint32_t)status.st_size)) {
    return "expected a parameter store of 32768 bytes";
  }
  return erase_range(file, 0, FILE_BYTES) ? NULL : strerror(errno);
}

const char *store_file_open(store_file_t *store_file, const char *path) {
  const int file = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (file < 0) {
    return strerror(errno);
  }
  const char *wrong = (flock(file, LOCK_EX | LOCK_NB) == 0) ? NULL : "another process has it";
  store_file->file = file;
  if (wrong == NULL) {
    wrong = check_contents(store_file);
  }
  if (wrong != NULL) {
    close(file);
    return wrong;
  }
  store_file->memory = (store_memory_t){
      .context = store_file,
      .sector_bytes = STORE_FILE_SECTOR_BYTES,
      .read = read_bytes,
      .program = program_bytes,
      .erase = erase_sector,
  };
  return NULL;
}

void store_file_close(store_file_t *store_file) { close(store_file->file); }
