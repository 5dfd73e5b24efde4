/* Vectors, start-up and lock of a Cortex-M, from the Cortex-M0 on. A board with interrupts besides
 * those of the core defines their vectors in the section .vectors.interrupts, from interrupt 0 on.
 */

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
            HANDLER(2, core_failed), /* NMI */
            HANDLER(3, core_failed), /* hard fault, and all faults without an enabled handler */
            HANDLER(EXCEPTION_SYSTICK, tick_interrupt),
        },
};

/* Masks all interrupts, because a Cortex-M0 cannot mask by priority. The code for a board with
 * interrupts for bytes or frames masks only the tick interrupt. */
void port_lock(void) { __asm volatile("cpsid i" ::: "memory"); }

void port_unlock(void) { __asm volatile("cpsie i" ::: "memory"); }
