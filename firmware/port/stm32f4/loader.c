/* The loader is a separate program at the begin of the flash. A reset starts the loader, and the
 * loader starts the image that slots_choose() selects. It has no variables, uses no interrupts,
 * does not change the clock, and never erases the flash. */

#include "firmware/port/stm32f4/loader.h"

#include <stddef.h>

#include "firmware/storage/slots.h"

extern uint32_t stack_top[];

_Noreturn void loader_start(void);

/* Starts the program in a slot. The vectors of the program are at the begin of the slot: sets the
 * stack pointer of the program and jumps to its start-up. */
__attribute__((naked, noreturn)) static void start(const uint32_t *vectors) {
  (void)vectors;
  __asm volatile(
      "ldr r1, [r0]\n"
      "msr msp, r1\n"
      "ldr r1, [r0, #4]\n"
      "bx r1\n");
}

/* Returns true if the image in the slot may be started now. If the image is not confirmed, stores
 * that one of its permitted attempts to start is used. If the flash cannot store this, the image
 * may not be started. */
static bool use_try(uint32_t slot) {
  const uint32_t *begin = (const uint32_t *)(uintptr_t)slot;
  const slot_trailer_t *trailer = slots_trailer(begin, BOARD_SLOT_BYTES);
  if (trailer->confirmed == SLOT_PROGRAMMED) {
    return true;
  }
  const uint32_t number = slots_next_try(trailer);
  return loader_program((uint32_t)(uintptr_t)&trailer->tries[number], SLOT_PROGRAMMED);
}

_Noreturn void loader_start(void) {
  static const uint32_t places[SLOTS] = {BOARD_SLOT_A, BOARD_SLOT_B};
  const uint32_t *const slots[SLOTS] = {(const uint32_t *)(uintptr_t)places[0],
                                        (const uint32_t *)(uintptr_t)places[1]};
  uint8_t without = 0;
  uint8_t slot = slots_choose(slots, BOARD_SLOT_BYTES, without);
  while (slot != SLOTS_NONE) {
    if (use_try(places[slot])) {
      loader_watch();
      start(slots[slot]);
    }
    without = (uint8_t)(without | 1u << slot);
    slot = slots_choose(slots, BOARD_SLOT_BYTES, without);
  }
  loader_make_safe();
  for (;;) {
    __asm volatile("wfi");
  }
}

typedef void (*handler_t)(void);

enum { EXCEPTIONS = 15 };

/* Interrupt vectors of the loader. They have no fault handlers, so a fault of the core locks the
 * core up. The pins then stay in their state after the reset. */
__attribute__((section(".vectors"), used)) static const struct {
  uint32_t *stack;
  handler_t handlers[EXCEPTIONS];
} vectors = {.stack = stack_top, .handlers = {loader_start}};
