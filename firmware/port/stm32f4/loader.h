#ifndef FIRMWARE_PORT_STM32F4_LOADER_H_
#define FIRMWARE_PORT_STM32F4_LOADER_H_

/* Functions for the chip that the loader needs. loader_chip.c implements them for the chip, and
 * emulated/loader.c for the emulator. */

#include "firmware/port/stm32/board.h"

/* Programs a word of the flash. Returns true if the flash contains this word afterwards. */
bool loader_program(uint32_t address, uint32_t word);

/* Starts the watchdog with its longest time, 0.35 to 1 s. So the chip is also reset if an image
 * stops before it has started the watchdog itself. */
void loader_watch(void);

/* Sets the outputs amp_enable and brake_release and the digital outputs of cycle programs to
 * low. */
void loader_make_safe(void);

#endif
