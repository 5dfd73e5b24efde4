/* In place of the peripherals that QEMU's netduinoplus2 lacks: RCC, flash, encoder, ADC, DAC,
 * CAN, watchdog. An axis whose sensors read zero and whose outputs nobody sees. */

#include <stddef.h>

#include "firmware/port/port.h"
#include "firmware/port/stm32f4/board.h"

void io_init(void) {}

bool io_clock_is_right(void) { return true; }

void io_make_safe(void) {}

uint8_t io_node_id(void) { return 1; }

uint32_t io_serial_number(void) { return 0; }

const store_memory_t *flash_memory(void) { return NULL; }

void watchdog_start(void) {}

void port_feed_watchdog(void) {}

bool port_sense(axis_inputs_t *inputs) {
  *inputs = (axis_inputs_t){.din = AXIS_DIN_ENABLE, .sensor_valid = 1};
  return true;
}

void port_act(const axis_outputs_t *outputs) { (void)outputs; }

bool port_can_receive(can_frame_t *frame) {
  (void)frame;
  return false;
}

bool port_can_transmit(const can_frame_t *frame) {
  (void)frame;
  return true;
}

uint8_t port_can_bus(void) { return CAN_BUS_ACTIVE; }

uint16_t port_can_lost(void) { return 0; }

/* Never enabled. */
void can_interrupt(void) {}

/* No wfi: under -icount it doubles the period of every timer. The emulated USART asks for an
 * interrupt when a byte comes, but not when one may be sent. */
void port_idle(void) {
  if ((USART2->CR1 & (USART_CR1_TXEIE | USART_CR1_TCIE)) != 0) {
    NVIC->ISPR1 = BIT(IRQ_USART2 - 32);
  }
}
