#include "firmware/port/port.h"
#include "firmware/port/stm32/barrier.h"
#include "firmware/port/stm32/board.h"

enum { PIN_TX = 2, PIN_RX = 3, FUNCTION_USART2 = 7, BAUD = MODBUS_BAUD_DEFAULT };

/* Size of each ring buffer in bytes, a power of 2. The input buffer has room for the bytes that
 * arrive in 20 ms while the main loop is delayed. The output buffer has room for one frame. */
enum { RING = 256 };

typedef struct {
  uint8_t bytes[RING];
  volatile uint16_t in;
  volatile uint16_t out;
} ring_t;

static ring_t received;
static ring_t to_send;

/* Format of a character on the serial line: 8 data bits and even parity. The register counts the
 * parity bit as a ninth data bit. */
#define LINE \
  (USART_CR1_UE | SERIAL_NINE_BITS | USART_CR1_PCE | USART_CR1_TE | USART_CR1_RE | USART_CR1_RXNEIE)

static uint16_t used(const ring_t *ring) { return (uint16_t)(ring->in - ring->out); }

void serial_init(uint32_t clock_hz) {
  set_bits(CLOCK_OF_PORTS);
  set_bits(CLOCK_OF_USART2);
  GPIOB->BSRR = BIT(PIN_RS485 + 16);
  pin_mode(GPIOB, PIN_RS485, PIN_OUTPUT, PIN_PULL_NONE);
  pin_alternate(GPIOA, PIN_TX, FUNCTION_USART2, PIN_PULL_UP);
  pin_alternate(GPIOA, PIN_RX, FUNCTION_USART2, PIN_PULL_UP);
  USART2->BRR = (clock_hz + BAUD / 2) / BAUD;
  USART2->CR1 = LINE;
  NVIC->IPR9 = FIELD(16, 8, PRIORITY_BUS);
  NVIC->ISER1 = BIT(IRQ_USART2 - 32);
}

void serial_interrupt(void) {
  const uint32_t status = SERIAL_STATUS;
  /* A damaged byte is accepted here, because the CRC of the frame detects it. */
  if ((status & (SERIAL_RECEIVED | SERIAL_OVERRUN)) != 0) {
    const uint8_t byte = serial_take();
    if ((status & SERIAL_RECEIVED) != 0 && used(&received) < RING) {
      received.bytes[received.in % RING] = byte;
      BARRIER();
      received.in++;
    }
  }
  const uint32_t control = USART2->CR1;
  if ((control & USART_CR1_TXEIE) != 0 && (status & SERIAL_HAS_ROOM) != 0) {
    if (used(&to_send) > 0) {
      SERIAL_OUT = to_send.bytes[to_send.out % RING];
      to_send.out++;
    } else {
      USART2->CR1 = LINE | USART_CR1_TCIE;
    }
  } else if ((control & USART_CR1_TCIE) != 0 && (status & SERIAL_SENT) != 0) {
    /* The main loop may have added bytes to the ring buffer just before this interrupt. */
    if (used(&to_send) > 0) {
      USART2->CR1 = LINE | USART_CR1_TXEIE;
    } else {
      GPIOB->BSRR = BIT(PIN_RS485 + 16);
      USART2->CR1 = LINE;
    }
  }
  HANDLER_END();
}

uint16_t port_serial_receive(uint8_t *bytes, uint16_t room) {
  uint16_t count = 0;
  while (count < room && used(&received) > 0) {
    BARRIER();
    bytes[count] = received.bytes[received.out % RING];
    BARRIER();
    received.out++;
    count++;
  }
  return count;
}

uint16_t port_serial_transmit(const uint8_t *bytes, uint16_t count) {
  uint16_t taken = 0;
  while (taken < count && used(&to_send) < RING) {
    to_send.bytes[to_send.in % RING] = bytes[taken];
    BARRIER();
    to_send.in++;
    taken++;
  }
  if (taken > 0) {
    GPIOB->BSRR = BIT(PIN_RS485);
    /* The interrupt switches the output `driver enable` off after the last byte was sent. */
    USART2->CR1 = LINE | USART_CR1_TXEIE;
  }
  return taken;
}
