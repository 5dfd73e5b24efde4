#ifndef FIRMWARE_PORT_STM32F4_EMULATED_FLASH_H_
#define FIRMWARE_PORT_STM32F4_EMULATED_FLASH_H_

/* The flash of the emulated chip as a file of the host. QEMU loads the contents of this file into
 * its memory before the program starts, and the program is read and executed from this memory. If
 * the program changes the flash, it changes only the file. QEMU loads the changed file at the next
 * start. */

#include <stdint.h>

/* Opens the file in the command line "flash FILE" and returns its descriptor. Returns a negative
 * number if the command line is different. */
int32_t flash_file_open(void);

/* flash_file_read() reads bytes at an address of the flash, and flash_file_program() programs
 * bytes. */
void flash_file_read(int32_t file, uint32_t address, uint8_t *bytes, uint32_t count);
void flash_file_program(int32_t file, uint32_t address, const uint8_t *bytes, uint32_t count);

/* Sets bytes of the flash to the erased state, in which all bits are 1. */
void flash_file_erase(int32_t file, uint32_t address, uint32_t count);

#endif
