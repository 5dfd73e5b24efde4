#include "firmware/port/emulated/semihosting.h"

enum {
  SYS_OPEN = 0x01,
  SYS_WRITE = 0x05,
  SYS_READ = 0x06,
  SYS_SEEK = 0x0A,
  SYS_GET_CMDLINE = 0x15,
  SYS_EXIT = 0x18
};

/* Reasons for the end of a program. A processor with 32 bits passes only the number of the reason
 * to the host (ARM, "Semihosting for AArch32 and AArch64", SYS_EXIT). */
#define EXIT_BY_APPLICATION UINT32_C(0x20026)
#define EXIT_BY_ERROR UINT32_C(0x20023)

static uint32_t length_of(const char *text) {
  uint32_t length = 0;
  while (text[length] != 0) {
    length++;
  }
  return length;
}

void semihosting_command_line(char *text, uint32_t room) {
  uint32_t block[2] = {(uint32_t)(uintptr_t)text, room};
  if (semihosting_call(SYS_GET_CMDLINE, block) != 0) {
    text[0] = 0;
  }
}

int32_t semihosting_open(const char *name, uint32_t mode) {
  const uint32_t block[3] = {(uint32_t)(uintptr_t)name, mode, length_of(name)};
  return semihosting_call(SYS_OPEN, block);
}

void semihosting_seek(int32_t file, uint32_t offset) {
  const uint32_t block[2] = {(uint32_t)file, offset};
  if (semihosting_call(SYS_SEEK, block) != 0) {
    semihosting_exit();
  }
}

/* Reads `count` bytes from a file of the host. Each call of SYS_READ returns the number of bytes
 * that were not read, because a pipe may have fewer bytes than requested. */
void semihosting_read(int32_t file, uint8_t *bytes, uint32_t count) {
  while (count > 0) {
    const uint32_t block[3] = {(uint32_t)file, (uint32_t)(uintptr_t)bytes, count};
    const int32_t remaining = semihosting_call(SYS_READ, block);
    if (remaining < 0 || (uint32_t)remaining >= count) {
      semihosting_exit();
    }
    bytes += count - (uint32_t)remaining;
    count = (uint32_t)remaining;
  }
}

void semihosting_write(int32_t file, const uint8_t *bytes, uint32_t count) {
  const uint32_t block[3] = {(uint32_t)file, (uint32_t)(uintptr_t)bytes, count};
  if (semihosting_call(SYS_WRITE, block) != 0) {
    semihosting_exit();
  }
}

static _Noreturn void leave(uint32_t reason) {
  for (;;) {
    (void)semihosting_call(SYS_EXIT, (const void *)(uintptr_t)reason);
  }
}

_Noreturn void semihosting_exit(void) { leave(EXIT_BY_APPLICATION); }

_Noreturn void semihosting_fail(void) { leave(EXIT_BY_ERROR); }
