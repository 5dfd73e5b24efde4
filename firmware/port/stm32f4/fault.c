/* A fault of the core: outputs off, what it was kept over the reset, reset. */

#include <stddef.h>

#include "firmware/port/stm32f4/board.h"

extern uint32_t stack_bottom[];
extern uint32_t stack_top[];

/* The start-up does not clear this. */
typedef struct {
  uint32_t magic;
  fw_core_fault_t words;
} kept_t;

static kept_t kept __attribute__((section(".noinit.core_fault")));

#define KEPT_MAGIC UINT32_C(0x4B434F46)

enum { FRAME_WORDS = 8, FRAME_LR = 5, FRAME_PC = 6 };

/* On a stack of its own making, with nothing that ran before to be trusted. `sp`: where the core
 * has pushed its frame; not if that failed as well, which CFSR tells. */
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
  __asm volatile("dsb" ::: "memory");
  SCB->AIRCR = SCB_AIRCR_VECTKEY | SCB_AIRCR_SYSRESETREQ;
  for (;;) {
  }
}

/* The stack may be what is broken: a push, and the core locks up with the outputs as they are. So
 * the stack begins anew before anything is called. */
__attribute__((naked)) void board_fail(void) {
  __asm volatile(
      "mrs r0, msp\n"
      "movw r1, #:lower16:stack_top\n"
      "movt r1, #:upper16:stack_top\n"
      "msr msp, r1\n"
      "b board_failed\n");
}

/* Memory after a power-up is arbitrary: only a reset by software can have left something. */
const fw_core_fault_t *board_fault_before(uint8_t reset_cause) {
  const bool is_kept = kept.magic == KEPT_MAGIC && (reset_cause & FW_RESET_SOFTWARE) != 0;
  kept.magic = 0;
  return is_kept ? &kept.words : NULL;
}
