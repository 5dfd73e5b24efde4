/* Interrupt vectors, start-up and lock for every Cortex-M, including the Cortex-M0. If a board has
 * more interrupts than those of the core, it defines their vectors in the section
 * .vectors.interrupts, beginning with interrupt 0. */

#include "firmware/port/image.h"
#include "firmware/port/port.h"
#include "firmware/port/tick.h"

int main(void);
_Noreturn void reset(void);

/* Enters image_failed() with a new stack. The present stack may be invalid: a push would then lock
 * the core. So the new stack is set before another function is called. */
__attribute__((naked)) static void core_failed(void) {
  __asm volatile(
      "ldr r0, =stack_top\n"
      "msr msp, r0\n"
      "ldr r0, =image_failed\n"
      "bx r0\n");
}

_Noreturn void reset(void) {
  image_start_memory();
  (void)main();
  core_failed();
  for (;;) {
  }
}

enum { EXCEPTION_SYSTICK = 15 };

typedef void (*handler_t)(void);

typedef struct {
  uint32_t *stack;
  handler_t handlers[EXCEPTION_SYSTICK];
} vectors_t;

#define HANDLER(exception, handler) [(exception)-1] = (handler)

__attribute__((section(".vectors"), used)) static const vectors_t vectors = {
    .stack = stack_top,
    .handlers =
        {
            HANDLER(1, reset),
            HANDLER(2, core_failed), /* non-maskable interrupt (NMI) */
            /* hard fault, and all faults whose own handler is not enabled */
            HANDLER(3, core_failed),
            HANDLER(EXCEPTION_SYSTICK, tick_interrupt),
        },
};

/* Masks all interrupts, because a Cortex-M0 cannot mask interrupts by their priority. If a board
 * has interrupts for received bytes or frames, its own code must mask only the tick interrupt. */
void port_lock(void) { __asm volatile("cpsid i" ::: "memory"); }

void port_unlock(void) { __asm volatile("cpsie i" ::: "memory"); }
