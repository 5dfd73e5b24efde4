/* The parts of the board `blank` that depend on the chip: the tick and the serial line. The
 * interrupt vectors, the start-up, the lock and the timer of the core are the same for every
 * Cortex-M, and are in ../cortexm. */

#include "firmware/port/port.h"
#include "firmware/port/tick.h"

typedef volatile uint32_t reg_t;

/* The serial line is USART1 of the STM32F405. The code polls the USART. It sets neither the pins
 * nor the bit rate, because QEMU does not model them. The code for a real board has a ring buffer
 * for each direction, which an interrupt fills or empties. */
typedef struct {
  reg_t SR;
  reg_t DR;
  reg_t BRR;
  reg_t CR1;
} usart_t;
#define USART ((usart_t *)0x40011000)
enum { USART_SR_RXNE = 0x20, USART_SR_TXE = 0x80, USART_CR1_ENABLED = 0x200C };

/* On a board with a watchdog timer, the function port_start() also starts the watchdog timer. */
void port_start(void) {
  USART->CR1 = USART_CR1_ENABLED;
  tick_start();
}

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
