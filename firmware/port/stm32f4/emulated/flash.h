#ifndef FIRMWARE_PORT_STM32F4_EMULATED_FLASH_H_
#define FIRMWARE_PORT_STM32F4_EMULATED_FLASH_H_

/* The flash of the emulated chip as a file of the host. QEMU loads the contents of this file into
 * the memory before it starts, and the program reads and runs the memory. What the program changes
 * it changes in the file, which QEMU loads at the next start. */

#include <stdint.h>

/* Returns the file that the command line "flash FILE" names, or a negative number with another
 * command line. */
int32_t flash_file_open(void);

/* Read and program bytes at an address of the flash. */
void flash_file_read(int32_t file, uint32_t address, uint8_t *bytes, uint32_t count);
void flash_file_program(int32_t file, uint32_t address, const uint8_t *bytes, uint32_t count);

/* Sets bytes to the erased state. */
void flash_file_erase(int32_t file, uint32_t address, uint32_t count);

#endif
