#include "firmware/port/stm32f4/loader.h"

/* Pins of amp_enable and brake_release, PB0 and PB1 (README.md), and of the digital outputs of
 * cycle programs, PA8 to PA11. */
enum { PINS_B = 0x3, MODES_B = 0x5, PINS_A = 0xF00, MODES_A = 0x550000 };

static void await_ready(void) {
  while ((FLASH->SR & FLASH_SR_BSY) != 0) {
  }
}

bool loader_program(uint32_t address, uint32_t word) {
  await_ready();
  FLASH->KEYR = FLASH_KEY1;
  FLASH->KEYR = FLASH_KEY2;
  FLASH->CR = FLASH_CR_PSIZE_32 | FLASH_CR_PG;
  *(volatile uint32_t *)(uintptr_t)address = word;
  __asm volatile("dsb" ::: "memory");
  await_ready();
  FLASH->CR = FLASH_CR_LOCK;
  return *(volatile uint32_t *)(uintptr_t)address == word;
}

void loader_watch(void) { IWDG->KR = IWDG_KEY_START; }

void loader_make_safe(void) {
  RCC->AHB1ENR |= RCC_AHB1ENR_GPIOAEN | RCC_AHB1ENR_GPIOBEN;
  (void)RCC->AHB1ENR;
  GPIOA->BSRR = (uint32_t)PINS_A << 16;
  GPIOB->BSRR = (uint32_t)PINS_B << 16;
  GPIOA->MODER |= MODES_A;
  GPIOB->MODER |= MODES_B;
}
