#ifndef FIRMWARE_PORT_STM32F4_LOADER_H_
#define FIRMWARE_PORT_STM32F4_LOADER_H_

/* Functions of the chip that the loader needs. loader_chip.c implements them, and emulated/loader.c
 * in the emulator. */

#include "firmware/port/stm32/board.h"

/* Programs a word of the flash. Returns true if the flash has the word then. */
bool loader_program(uint32_t address, uint32_t word);

/* Starts the watchdog with its longest time, 0.35 to 1 s, so that an image that stops before it has
 * started the watchdog itself is reset too. */
void loader_watch(void);

/* Sets the outputs amp_enable, brake_release and the outputs of cycles to low. */
void loader_make_safe(void);

#endif
