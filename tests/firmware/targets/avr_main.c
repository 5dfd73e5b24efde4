/* Prints laws_probe(ROUNDS) on the serial port of an ATmega2560 and stops; needs no library. */

#include <stdint.h>

uint32_t laws_probe(uint32_t rounds);
void start(void);
void body(void);

static volatile uint8_t *reg(uint16_t address) { return (volatile uint8_t *)address; }

enum { UCSR0A = 0xC0, UCSR0B = 0xC1, UDR0 = 0xC6, SPL = 0x5D, SPH = 0x5E };

static void put(uint8_t c) {
  while ((*reg(UCSR0A) & 0x20u) == 0) {
  }
  *reg(UDR0) = c;
}

/* The first word of the flash is where the chip starts; there is no data to copy. */
__attribute__((naked, section(".vectors"))) void start(void) {
  __asm__ volatile("clr r1");
  *reg(SPL) = 0xFF;
  *reg(SPH) = 0x21;
  __asm__ volatile("rjmp body");
}

void body(void) {
  *reg(UCSR0B) = 0x08;
  const uint32_t hash = laws_probe(ROUNDS);
  for (uint8_t i = 0; i < 8; i++) {
    const uint8_t digit = (uint8_t)((hash >> (28 - 4 * i)) & 15u);
    put((uint8_t)((digit < 10) ? digit + '0' : digit - 10 + 'a'));
  }
  put('\n');
  __asm__ volatile("cli\n sleep");
  for (;;) {
  }
}
