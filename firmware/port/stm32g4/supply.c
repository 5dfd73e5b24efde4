/* Monitors the supply voltage. Below 2.9 V the voltage detector causes an interrupt that switches
 * the outputs off, before the brown-out reset at 2.8 V. */

#include "firmware/port/stm32/barrier.h"
#include "firmware/port/stm32/board.h"

static volatile bool is_low;

void supply_init(void) {
  set_bits(&RCC->APB1ENR1, RCC_APB1ENR1_PWREN);
  PWR->CR3 |= PWR_CR3_UCPD1_DBDIS;
  PWR->CR2 = (PWR->CR2 & ~PWR_CR2_PLS) | PWR_CR2_PLS_6;
  PWR->CR2 |= PWR_CR2_PVDE;
  /* the output of the voltage detector rises when the supply voltage falls */
  EXTI->RTSR1 |= EXTI_RTSR1_RT16;
  EXTI->PR1 = EXTI_PR1_PIF16;
  EXTI->IMR1 |= EXTI_IMR1_IM16;
  NVIC->IPR0 = FIELD(8, 8, PRIORITY_SUPPLY);
  NVIC->ISER0 = BIT(IRQ_PVD_PVM);
}

/* Switches the outputs off. The interrupted tick may be about to output a DAC code, so port_act()
 * checks supply_is_low() after its output. */
void supply_interrupt(void) {
  EXTI->PR1 = EXTI_PR1_PIF16;
  is_low = true;
  io_make_safe();
  HANDLER_END();
}

bool supply_is_low(void) { return is_low; }

/* Updates the state of the supply voltage. Call this function once in each tick. After an interrupt
 * the state remains low until the voltage detector reports a sufficient voltage. The state is reset
 * before the detector is read, so an interrupt that occurs later is not lost. */
void supply_look(void) {
  is_low = false;
  if ((PWR->SR2 & PWR_SR2_PVDO) != 0) {
    is_low = true;
  }
}

/* Returns true if the option bytes are right. The brown-out reset must have the required level. The
 * flash must have two banks, and the chip must start from the first bank for every level of pin
 * PB8. This bank has the program, so all its pages must be protected from programming and erasing.
 * The RAM must have no parity, because with parity a read before the first write would be an error
 * (memories.c). A new chip has other option bytes. */
bool option_bytes_are_right(void) {
  const uint32_t mask = FLASH_OPTR_BOR_LEV | FLASH_OPTR_BFB2 | FLASH_OPTR_DBANK |
                        FLASH_OPTR_SRAM_PE | FLASH_OPTR_nSWBOOT0 | FLASH_OPTR_nBOOT0;
  const uint32_t pages = FLASH_WRP1AR_WRP1A_STRT | FLASH_WRP1AR_WRP1A_END;
  return (FLASH->OPTR & mask) ==
             (FLASH_OPTR_BOR_LEV_4 | FLASH_OPTR_DBANK | FLASH_OPTR_SRAM_PE | FLASH_OPTR_nBOOT0) &&
         (FLASH->WRP1AR & pages) == FLASH_WRP1AR_WRP1A_END;
}
