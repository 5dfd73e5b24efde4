/* Handles a fault of the processor core: switches the outputs off, keeps the data of the fault over
 * the reset, and resets the chip. */

#include <stddef.h>

#include "firmware/port/image.h"
#include "firmware/port/stm32/board.h"

/* Data of a fault of the core that are kept over a reset. The start-up does not clear these
 * data. */
typedef struct {
  uint32_t magic;
  fw_core_fault_t words;
} kept_t;

static kept_t kept __attribute__((section(".noinit.core_fault")));

#define KEPT_MAGIC UINT32_C(0x4B434F46)
/* Value of the field `magic` that board_restart() sets, so that the next start does not report the
 * reset. */
#define RESTART_MAGIC UINT32_C(0x4B525453)

enum { FRAME_WORDS = 8, FRAME_LR = 5, FRAME_PC = 6 };

_Noreturn static void reset_chip(void) {
  __asm volatile("dsb" ::: "memory");
  SCB->AIRCR = SCB_AIRCR_VECTKEY | SCB_AIRCR_SYSRESETREQ;
  for (;;) {
  }
}

/* Saves the data of a fault and resets the chip. The function runs on a new stack and does not rely
 * on the state of the interrupted program. `sp` is the address at which the core has saved its
 * registers. If CFSR shows that this save also failed, the saved registers are not valid. */
__attribute__((noreturn, used)) void board_failed(uint32_t sp);

__attribute__((noreturn, used)) void board_failed(uint32_t sp) {
  io_make_safe();
  const uint32_t status = SCB->CFSR;
  const bool is_frame = sp >= (uintptr_t)stack_bottom &&
                        sp <= (uintptr_t)stack_top - FRAME_WORDS * sizeof(uint32_t) &&
                        (status & (SCB_CFSR_STKERR | SCB_CFSR_MSTKERR)) == 0;
  const uint32_t *frame = (const uint32_t *)(uintptr_t)sp;
  kept.words.pc = is_frame ? frame[FRAME_PC] : 0;
  kept.words.lr = is_frame ? frame[FRAME_LR] : 0;
  kept.words.cfsr = status;
  kept.words.hfsr = SCB->HFSR;
  kept.words.bfar = SCB->BFAR;
  kept.magic = KEPT_MAGIC;
  reset_chip();
}

_Noreturn void board_restart(void) {
  kept.magic = RESTART_MAGIC;
  reset_chip();
}

/* Enters board_failed() with a new stack. The present stack may be invalid: a push would then lock
 * the core while the outputs are still on. So the new stack is set before another function is
 * called. */
__attribute__((naked)) void board_fail(void) {
  __asm volatile(
      "mrs r0, msp\n"
      "movw r1, #:lower16:stack_top\n"
      "movt r1, #:upper16:stack_top\n"
      "msr msp, r1\n"
      "b board_failed\n");
}

/* Returns the kept data of a fault, or NULL if there was no fault. After a power-up the contents of
 * the memory are arbitrary, so the data are valid only if software has caused the reset. A reset by
 * board_restart() is not reported as a cause. */
const fw_core_fault_t *board_fault_before(uint8_t *reset_cause) {
  const bool is_software = (*reset_cause & AXIS_RESET_CAUSE_SOFTWARE) != 0;
  const bool is_kept = kept.magic == KEPT_MAGIC && is_software;
  if (kept.magic == RESTART_MAGIC && is_software) {
    *reset_cause = (uint8_t)(*reset_cause & ~AXIS_RESET_CAUSE_SOFTWARE);
  }
  kept.magic = 0;
  return is_kept ? &kept.words : NULL;
}
