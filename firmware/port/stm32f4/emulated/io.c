/* Functions for the QEMU machine netduinoplus2: CAN, flash, and the wait for a tick.
 * ../../stm32/emulated.c replaces the other peripherals that this machine does not have. */

#include "firmware/fx/bytes.h"
#include "firmware/port/emulated/host_link.h"
#include "firmware/port/port.h"
#include "firmware/port/stm32/board.h"
#include "firmware/port/stm32/tick.h"
#include "firmware/port/stm32f4/emulated/flash.h"

/* Memories of the parameter store and of the image slots, which are sectors in the file of the
 * flash (flash.h). Without this file these memories do not exist. */

/* descriptor of the file of the flash, which flash_memory() opens; negative: there is no file */
static int32_t flash_file;

#define STORE_BEGIN UINT32_C(0x08004000)
enum { STORE_SECTOR_BYTES = 0x4000 };

/* Reads bytes of a memory of two sectors. The second sector follows the first one in the file. */
static void read_bytes(void *context, uint32_t address, uint8_t *bytes, uint32_t count) {
  flash_file_read(flash_file, (uint32_t)(uintptr_t)context + address, bytes, count);
}

static bool program_bytes(void *context, uint32_t address, const uint8_t *bytes, uint32_t count) {
  flash_file_program(flash_file, (uint32_t)(uintptr_t)context + address, bytes, count);
  return true;
}

static uint32_t bytes_of(const void *context) {
  return ((uintptr_t)context == BOARD_SLOT_A) ? BOARD_SLOT_BYTES : STORE_SECTOR_BYTES;
}

static bool erase_sector(void *context, uint8_t sector) {
  const uint32_t bytes = bytes_of(context);
  flash_file_erase(flash_file, (uint32_t)(uintptr_t)context + sector * bytes, bytes);
  return true;
}

static store_memory_t memory_at(uint32_t begin) {
  void *context = (void *)(uintptr_t)begin;
  return (store_memory_t){.context = context,
                          .sector_bytes = bytes_of(context),
                          .read = read_bytes,
                          .program = program_bytes,
                          .erase = erase_sector};
}

const store_memory_t *flash_memory(void) {
  static store_memory_t memory;
  flash_file = flash_file_open();
  memory = memory_at(STORE_BEGIN);
  return (flash_file < 0) ? NULL : &memory;
}

const store_memory_t *flash_archive(void) { return NULL; }

const store_memory_t *flash_slots(void) {
  static store_memory_t memory;
  memory = memory_at(BOARD_SLOT_A);
  return (flash_file < 0) ? NULL : &memory;
}

/* CAN in the emulator. Each CAN frame is transmitted as 12 bytes over a serial line. */

enum { FRAME_BYTES = 12, POLLS_MAX = 500 };

void spi_force_ready_interrupt(void) {} /* Does nothing, because this interrupt is never enabled. */

void spi_force_read_interrupt(void) {} /* Does nothing, because this interrupt is never enabled. */

bool port_can_receive(can_frame_t *frame) {
  static uint8_t bytes[FRAME_BYTES];
  static uint8_t count;
  USART3->CR1 = USART_CR1_UE | USART_CR1_TE | USART_CR1_RE;
  static bool has_more;
  /* QEMU delivers the next byte soon after the previous byte was read, so this loop polls up to
   * POLLS_MAX times. */
  for (uint32_t polls = (has_more || count > 0) ? POLLS_MAX : 1; count < FRAME_BYTES && polls > 0;
       polls--) {
    if ((USART3->SR & USART_SR_RXNE) != 0) {
      bytes[count] = (uint8_t)USART3->DR;
      count++;
      polls = POLLS_MAX;
    }
  }
  has_more = count == FRAME_BYTES;
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
 * but not when a byte can be sent. So the interrupt for sending is requested here. If there is a
 * host, the function waits for the next tick without the instruction wfi: QEMU, which counts
 * instructions, doubles the period of every timer in wfi. The main loop makes no further pass
 * during this wait, because its register accesses are slow. */
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
