/* This file uses POSIX functions for files and locks. */
#define _GNU_SOURCE

#include "firmware/port/host/store_file.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

enum { CHUNK_BYTES = 256, FOLDER_BYTES = 4096 };

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

/* Waits until all bytes of the file are on the disk. Returns false if the disk reports a failure.
 */
static bool synced(store_file_t *store_file) {
  store_file->run_end = 0;
  int done = 0;
  do {
    done = fdatasync(store_file->file);
  } while (done != 0 && errno == EINTR);
  return done == 0;
}

static bool has_unsynced(const store_file_t *store_file) {
  return store_file->synced_end < store_file->run_end;
}

static void read_file(int file, uint32_t address, uint8_t *bytes, uint32_t count) {
  memset(bytes, 0xFF, count);
  ssize_t done = 0;
  do {
    done = pread(file, bytes, count, (off_t)address);
  } while (done < 0 && errno == EINTR);
}

/* Returns bytes of the file that are certainly on the disk. Bytes that cannot be read or cannot be
 * written to the disk are returned as blank bytes. A record of blank bytes has no valid CRC. */
static void read_bytes(void *context, uint32_t address, uint8_t *bytes, uint32_t count) {
  store_file_t *store_file = context;
  const bool is_unsynced = has_unsynced(store_file) && address < store_file->run_end &&
                           address + count > store_file->synced_end;
  if (is_unsynced && !synced(store_file)) {
    memset(bytes, 0xFF, count);
    return;
  }
  read_file(store_file->file, address, bytes, count);
}

/* Programs bytes of the file. As in a flash memory, programming can only change bits from 1 to
 * 0. */
static bool write_cleared(int file, uint32_t address, const uint8_t *bytes, uint32_t count) {
  uint8_t chunk[CHUNK_BYTES];
  while (count > 0) {
    const uint32_t part = (count < CHUNK_BYTES) ? count : CHUNK_BYTES;
    read_file(file, address, chunk, part);
    for (uint32_t i = 0; i < part; i++) {
      chunk[i] &= bytes[i];
    }
    if (!write_all(file, address, chunk, part)) {
      return false;
    }
    address += part;
    bytes += part;
    count -= part;
  }
  return true;
}

/* Programs bytes of the file. The first of several calls with adjacent addresses has the head of a
 * record. Its bytes are on the disk before the bytes of the next calls are written. All bytes are
 * on the disk before they are read back, and before other bytes are written. */
static bool program_bytes(void *context, uint32_t address, const uint8_t *bytes, uint32_t count) {
  store_file_t *store_file = context;
  const bool is_next = store_file->run_end != 0 && address == store_file->run_end;
  if (!is_next && has_unsynced(store_file) && !synced(store_file)) {
    return false;
  }
  if (!write_cleared(store_file->file, address, bytes, count) ||
      (!is_next && !synced(store_file))) {
    return false;
  }
  store_file->run_end = address + count;
  store_file->synced_end = is_next ? store_file->synced_end : store_file->run_end;
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
  store_file_t *store_file = context;
  const uint32_t bytes = store_file->memory.sector_bytes;
  return (!has_unsynced(store_file) || synced(store_file)) &&
         erase_range(store_file->file, sector * bytes, bytes) && synced(store_file);
}

/* Returns true if a file has only blank bytes. Zeros also count as blank bytes, because a power cut
 * can leave zeros in a new file. */
static bool is_blank(int file, uint32_t count) {
  bool blank = true;
  for (uint32_t i = 0; i < count; i++) {
    uint8_t byte;
    read_file(file, i, &byte, 1);
    blank = blank && (byte == 0xFF || byte == 0);
  }
  return blank;
}

/* Waits until the directory entry of a file is on the disk. */
static bool sync_folder(const char *path) {
  char folder[FOLDER_BYTES];
  const char *slash = strrchr(path, '/');
  const size_t length = (slash == NULL) ? 0 : (size_t)(slash - path) + 1;
  if (length + 2 > sizeof(folder)) {
    errno = ENAMETOOLONG;
    return false;
  }
  memcpy(folder, path, length);
  memcpy(folder + length, ".", 2);
  const int file = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (file < 0) {
    return false;
  }
  const bool done = fsync(file) == 0;
  close(file);
  return done;
}

/* Checks the size of the file, and erases the sectors of a new file. A file whose creation was
 * interrupted is also treated as new. Returns NULL or a text with the error. */
static const char *check_contents(store_file_t *store_file, const char *path,
                                  const char *expected) {
  const int file = store_file->file;
  const uint32_t bytes = 2 * store_file->memory.sector_bytes;
  struct stat status;
  if (fstat(file, &status) != 0) {
    return strerror(errno);
  }
  if (!S_ISREG(status.st_mode) || status.st_size > bytes) {
    return expected;
  }
  const bool is_new = status.st_size < bytes;
  if (is_new && !is_blank(file, (uint32_t)status.st_size)) {
    return expected;
  }
  if ((is_new && !erase_range(file, 0, bytes)) || fsync(file) != 0) {
    return strerror(errno);
  }
  /* The process that created an older file may have ended before its name was on the disk. A file
   * is not refused if its folder may not be read. */
  return (sync_folder(path) || !is_new) ? NULL : strerror(errno);
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
  store_file->run_end = 0;
  store_file->synced_end = 0;
  store_file->memory = (store_memory_t){
      .context = store_file,
      .sector_bytes = sector_bytes,
      .read = read_bytes,
      .program = program_bytes,
      .erase = erase_sector,
  };
  if (wrong == NULL) {
    wrong = check_contents(store_file, path, expected);
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
