/* The parts of the board `blank` that depend on the chip: vectors, start-up, tick, lock and serial
 * line. All parts except the serial line are valid for every Cortex-M. The linker script defines
 * the external symbols. */

#include "firmware/port/port.h"

typedef volatile uint32_t reg_t;

/* System timer of the processor core. */
typedef struct {
  reg_t CSR;
  reg_t RVR;
  reg_t CVR;
} systick_t;
#define SYSTICK ((systick_t *)0xE000E010)
enum { SYSTICK_RUNS_WITH_INTERRUPT = 7 }; /* clocked by the core */

/* Cycles of one tick: 168 MHz / 1500 Hz, exactly. */
#define TICK_CYCLES UINT32_C(112000)

/* The serial line is USART1 of the STM32F405. The code polls the USART and sets neither pins nor
 * bit rate, because QEMU models neither of the two. The code for a real board has a ring buffer for
 * each direction, which an interrupt fills or empties. */
typedef struct {
  reg_t SR;
  reg_t DR;
  reg_t BRR;
  reg_t CR1;
} usart_t;
#define USART ((usart_t *)0x40011000)
enum { USART_SR_RXNE = 0x20, USART_SR_TXE = 0x80, USART_CR1_ENABLED = 0x200C };

extern uint32_t stack_top[];
extern uint32_t data_begin[];
extern uint32_t data_end[];
extern const uint32_t data_load[];
extern uint32_t bss_begin[];
extern uint32_t bss_end[];

int main(void);
_Noreturn void reset(void);
void tick_interrupt(void);

/* Returns the number of words between two symbols of the linker script. The difference is computed
 * from addresses, because in C the symbols are different objects. */
static uint32_t words(const uint32_t *begin, const uint32_t *end) {
  return ((uintptr_t)end - (uintptr_t)begin) / sizeof(uint32_t);
}

/* Handler of a fault of the processor core. On a real board this function makes the outputs safe
 * and resets the chip. */
_Noreturn static void fail(void) {
  for (;;) {
  }
}

_Noreturn void reset(void) {
  const uint32_t data_words = words(data_begin, data_end);
  for (uint32_t i = 0; i < data_words; i++) {
    data_begin[i] = data_load[i];
  }
  const uint32_t bss_words = words(bss_begin, bss_end);
  for (uint32_t i = 0; i < bss_words; i++) {
    bss_begin[i] = 0;
  }
  (void)main();
  fail();
}

void tick_interrupt(void) { port_tick(); }

typedef struct {
  uint32_t *stack;
  void (*handlers[15])(void);
} vectors_t;

#define HANDLER(exception, handler) [(exception)-1] = (handler)

__attribute__((section(".vectors"), used)) static const vectors_t vectors = {
    .stack = stack_top,
    .handlers =
        {
            HANDLER(1, reset),
            HANDLER(2, fail), /* NMI */
            HANDLER(3, fail), /* hard fault, and all faults without a handler of their own */
            HANDLER(15, tick_interrupt),
        },
};

/* On a board with a watchdog timer, port_start() also starts this timer. */
void port_start(void) {
  USART->CR1 = USART_CR1_ENABLED;
  SYSTICK->RVR = TICK_CYCLES - 1;
  SYSTICK->CVR = 0;
  SYSTICK->CSR = SYSTICK_RUNS_WITH_INTERRUPT;
}

/* Masks all interrupts. The code for a real board masks only the tick interrupt, by its
 * priority. */
void port_lock(void) { __asm volatile("cpsid i" ::: "memory"); }

void port_unlock(void) { __asm volatile("cpsie i" ::: "memory"); }

uint16_t port_serial_receive(uint8_t *bytes, uint16_t room) {
  uint16_t count = 0;
  while (count < room && (USART->SR & USART_SR_RXNE) != 0) {
    bytes[count] = (uint8_t)USART->DR;
    count++;
  }
  return count;
}

uint16_t port_serial_transmit(const uint8_t *bytes, uint16_t count) {
  uint16_t taken = 0;
  while (taken < count && (USART->SR & USART_SR_TXE) != 0) {
    USART->DR = bytes[taken];
    taken++;
  }
  return taken;
}
