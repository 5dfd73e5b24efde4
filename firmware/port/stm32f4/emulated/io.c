/* What QEMU's machine netduinoplus2 has in place of CAN, and how it waits. ../../stm32/emulated.c
 * replaces the other peripherals that this machine lacks. */

#include "firmware/fx/bytes.h"
#include "firmware/port/emulated/host_link.h"
#include "firmware/port/port.h"
#include "firmware/port/stm32/board.h"
#include "firmware/port/stm32/tick.h"

/* CAN in the emulator: a serial line transmits each frame as 12 bytes. */

enum { FRAME_BYTES = 12 };

void spi_force_ready_interrupt(void) {} /* never enabled */

void spi_force_read_interrupt(void) {} /* never enabled */

bool port_can_receive(can_frame_t *frame) {
  static uint8_t bytes[FRAME_BYTES];
  static uint8_t count;
  USART3->CR1 = USART_CR1_UE | USART_CR1_TE | USART_CR1_RE;
  while (count < FRAME_BYTES && (USART3->SR & USART_SR_RXNE) != 0) {
    bytes[count] = (uint8_t)USART3->DR;
    count++;
  }
  if (count < FRAME_BYTES) {
    return false;
  }
  count = 0;
  *frame =
      (can_frame_t){.id = (uint16_t)fx_load_le(bytes, 2), .length = bytes[2], .remote = bytes[3]};
  for (uint8_t i = 0; i < 8; i++) {
    frame->data[i] = bytes[4 + i];
  }
  return true;
}

static void send_byte(uint8_t byte) {
  while ((USART3->SR & USART_SR_TXE) == 0) {
  }
  USART3->DR = byte;
}

bool port_can_transmit(const can_frame_t *frame) {
  uint8_t head[4];
  fx_store_le(head, frame->id, 2);
  head[2] = frame->length;
  head[3] = frame->remote;
  for (uint8_t i = 0; i < 4; i++) {
    send_byte(head[i]);
  }
  for (uint8_t i = 0; i < 8; i++) {
    send_byte(frame->data[i]);
  }
  return true;
}

/* Waits for the next interrupt. The emulated USART requests an interrupt when a byte is received,
 * but not when a byte can be sent, so the interrupt is requested here. With a host the function
 * waits for the next tick without wfi, because in wfi QEMU, which counts instructions, doubles the
 * period of every timer. The main loop makes no further cycle meanwhile, because its register
 * accesses are slow. */
void port_idle(void) {
  static uint32_t seen;
  if ((USART2->CR1 & (USART_CR1_TXEIE | USART_CR1_TCIE)) != 0) {
    NVIC->ISPR1 = BIT(IRQ_USART2 - 32);
  } else if (host_link_is_open()) {
    while (tick_entries() == seen) {
    }
    seen = tick_entries();
  } else {
    __asm volatile("wfi");
  }
}
