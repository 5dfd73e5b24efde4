#ifndef FIRMWARE_PORT_IMAGE_H_
#define FIRMWARE_PORT_IMAGE_H_

/* Symbols that the linker script ram.ld defines in the image of a board, and the start-up of the
 * memory of the board. */

#include <stdint.h>

extern uint32_t stack_bottom[], stack_top[], ram_end[];
extern uint32_t data_begin[], data_end[];
extern const uint32_t data_load[];
extern uint32_t bss_begin[], bss_end[];
extern uint32_t recorder_begin[], recorder_end[];
/* memories for cycle programs, for the results of parts, and for the curve of a cycle */
extern uint32_t programs_begin[], programs_end[];
extern uint32_t results_begin[], results_end[];
extern uint32_t curve_begin[], curve_end[];

/* Returns the number of bytes between two symbols of the linker script. The number is computed
 * from addresses, because these symbols are different objects in C. */
static inline uint32_t image_bytes(const uint32_t *begin, const uint32_t *end) {
  return (uint32_t)((uintptr_t)end - (uintptr_t)begin);
}

/* Copies the initial values of the variables from the flash and clears the other variables. The
 * start-up of a board calls this function before it uses any variable. */
static inline void image_start_memory(void) {
  const uint32_t data_words = image_bytes(data_begin, data_end) / sizeof(uint32_t);
  for (uint32_t i = 0; i < data_words; i++) {
    data_begin[i] = data_load[i];
  }
  const uint32_t bss_words = image_bytes(bss_begin, bss_end) / sizeof(uint32_t);
  for (uint32_t i = 0; i < bss_words; i++) {
    bss_begin[i] = 0;
  }
}

/* The code for the board implements image_failed(). cortexm/start.c calls it on a new stack when
 * the program cannot continue, for example after a fault of the core. On a real board it switches
 * the outputs off and resets the chip. */
_Noreturn void image_failed(void);

#endif
