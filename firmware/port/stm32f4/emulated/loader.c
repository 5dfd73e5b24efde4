/* The functions of loader.h for the emulated chip. */

#include "firmware/port/stm32f4/loader.h"

#include "firmware/fx/bytes.h"
#include "firmware/port/stm32f4/emulated/flash.h"

bool loader_program(uint32_t address, uint32_t word) {
  uint8_t bytes[4];
  const int32_t file = flash_file_open();
  fx_store_le(bytes, word, sizeof(bytes));
  if (file >= 0) {
    flash_file_program(file, address, bytes, sizeof(bytes));
  }
  return file >= 0;
}

void loader_watch(void) {} /* Does nothing, because the emulated chip has no watchdog. */

void loader_make_safe(void) {} /* Does nothing, because the emulated chip has no pins. */
