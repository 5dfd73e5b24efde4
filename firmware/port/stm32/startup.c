/* Interrupt vectors and start-up of the image. The linker script defines the external symbols. */

#include "firmware/port/image.h"
#include "firmware/port/stm32/board.h"
#include "firmware/port/stm32/tick.h"

int main(void);
_Noreturn void reset(void);

_Noreturn void reset(void) {
  SCB->VTOR = (uintptr_t)vectors_begin;
  SCB->CCR |= SCB_CCR_DIV_0_TRP;
  image_start_memory();
  (void)main();
  board_fail();
  for (;;) {
  }
}

typedef void (*handler_t)(void);

enum { EXCEPTION_SYSTICK = 15, EXCEPTION_IRQ = 16 };

/* Table of interrupt vectors. The vector of an interrupt that is never enabled is 0. If such an
 * interrupt occurs, the core has a fault. */
typedef struct {
  uint32_t *stack;
  handler_t handlers[EXCEPTION_IRQ + IRQ_LAST];
} vectors_t;

#define HANDLER(exception, handler) [(exception)-1] = (handler)

__attribute__((section(".vectors"), used)) static const vectors_t vectors = {
    .stack = stack_top,
    .handlers =
        {
            HANDLER(1, CHIP_RESET),
            HANDLER(2, CHIP_NMI),
            /* hard fault, and all faults whose own handler is not enabled */
            HANDLER(3, board_fail),
            HANDLER(4, board_fail),
            HANDLER(5, board_fail),
            HANDLER(6, board_fail),
            HANDLER(11, board_fail),
            HANDLER(12, board_fail),
            HANDLER(14, board_fail),
            HANDLER(EXCEPTION_SYSTICK, tick_interrupt), /* used only in the emulator */
            CHIP_INTERRUPTS,
        },
};
