/* Start-up, trap handler, tick, lock and semihosting for the board `virt` of QEMU (riscv32) in
 * machine mode. The registers are those of RISC-V Privileged Architecture 1.12. The timer is that
 * of RISC-V ACLINT, at the addresses of the board `virt`. */

#include "firmware/port/emulated/semihosting.h"
#include "firmware/port/image.h"
#include "firmware/port/port.h"
#include "firmware/port/tick.h"

typedef volatile uint32_t reg_t;

/* Timer registers MTIMECMP of hart 0 and MTIME, with the low word first. */
#define MTIMECMP ((reg_t *)0x02004000)
#define MTIME ((reg_t *)0x0200BFF8)

#define TIMER_HZ UINT32_C(10000000)

#define CAUSE_MACHINE_TIMER UINT32_C(0x80000007)
#define MSTATUS_MIE UINT32_C(0x8)
#define MIE_MTIE UINT32_C(0x80)

int main(void);
void reset(void);
void start(void);

static volatile uint32_t entries;
static uint64_t due; /* count of the timer at which the next tick is due */
/* fraction of a count, in 1/1500 count, that is carried over to the next tick */
static uint32_t fraction;

/* The first instructions of the image. A hart (hardware thread) begins in machine mode with
 * interrupts off. */
__attribute__((naked, used, section(".vectors"))) void reset(void) {
  __asm volatile(
      "la sp, stack_top\n"
      "j start\n");
}

/* Handler of every trap. Each trap other than the timer interrupt is a fault of the program. */
__attribute__((interrupt("machine"), aligned(4))) static void trap(void) {
  uint32_t cause;
  __asm volatile("csrr %0, mcause" : "=r"(cause));
  if (cause != CAUSE_MACHINE_TIMER) {
    image_failed();
  }
  tick_interrupt();
}

__attribute__((used)) void start(void) {
  image_start_memory();
  __asm volatile("csrw mtvec, %0" ::"r"(trap));
  (void)main();
  image_failed();
}

/* Sets the time of the next tick. The compare value has 64 bits and is written in two halves. The
 * low half is set to its maximum first, so that no intermediate value requests an interrupt. */
static void set_next(void) {
  due += tick_counts(TIMER_HZ, &fraction);
  MTIMECMP[0] = UINT32_MAX;
  MTIMECMP[1] = (uint32_t)(due >> 32);
  MTIMECMP[0] = (uint32_t)due;
}

void tick_start(void) {
  due = MTIME[0]; /* The counter of QEMU starts from 0 at power-up, so its high word is 0 here. */
  set_next();
  __asm volatile("csrs mie, %0" ::"r"(MIE_MTIE));
  port_unlock();
}

void tick_interrupt(void) {
  entries++;
  set_next();
  port_tick();
}

uint32_t tick_entries(void) { return entries; }

void port_lock(void) { __asm volatile("csrc mstatus, %0" ::"r"(MSTATUS_MIE) : "memory"); }

void port_unlock(void) { __asm volatile("csrs mstatus, %0" ::"r"(MSTATUS_MIE) : "memory"); }

/* A request to the host consists of the instruction EBREAK between two shift instructions without
 * effect. None of the three instructions is compressed, and all are in one page (RISC-V
 * Semihosting, trap sequence). */
__attribute__((aligned(16))) int32_t semihosting_call(uint32_t operation, const void *argument) {
  register uint32_t a0 __asm("a0") = operation;
  register const void *a1 __asm("a1") = argument;
  __asm volatile(
      ".option push\n"
      ".option norvc\n"
      ".balign 16\n"
      "slli x0, x0, 0x1f\n"
      "ebreak\n"
      "srai x0, x0, 7\n"
      ".option pop\n"
      : "+r"(a0)
      : "r"(a1)
      : "memory");
  return (int32_t)a0;
}
