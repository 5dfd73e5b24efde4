#include "firmware/port/stm32f4/emulated/flash.h"

#include "firmware/port/emulated/semihosting.h"

enum { LINE_BYTES = 256, PIECE_BYTES = 64, ERASED = 0xFF };

#define FLASH_BASE UINT32_C(0x08000000)

int32_t flash_file_open(void) {
  static const char command[] = "flash ";
  char line[LINE_BYTES];
  semihosting_command_line(line, sizeof(line));
  for (uint32_t i = 0; i < sizeof(command) - 1; i++) {
    if (line[i] != command[i]) {
      return -1;
    }
  }
  return semihosting_open(&line[sizeof(command) - 1], SEMIHOSTING_CHANGE);
}

void flash_file_read(int32_t file, uint32_t address, uint8_t *bytes, uint32_t count) {
  semihosting_seek(file, address - FLASH_BASE);
  semihosting_read(file, bytes, count);
}

/* Programs bytes of the flash: as in a flash memory, bits change only from 1 to 0. */
void flash_file_program(int32_t file, uint32_t address, const uint8_t *bytes, uint32_t count) {
  for (uint32_t i = 0; i < count; i++) {
    uint8_t byte;
    flash_file_read(file, address + i, &byte, 1);
    byte &= bytes[i];
    semihosting_seek(file, address + i - FLASH_BASE);
    semihosting_write(file, &byte, 1);
  }
}

void flash_file_erase(int32_t file, uint32_t address, uint32_t count) {
  uint8_t erased[PIECE_BYTES];
  for (uint32_t i = 0; i < PIECE_BYTES; i++) {
    erased[i] = ERASED;
  }
  semihosting_seek(file, address - FLASH_BASE);
  for (uint32_t i = 0; i < count; i += PIECE_BYTES) {
    semihosting_write(file, erased, PIECE_BYTES);
  }
}
