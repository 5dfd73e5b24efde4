/* Monitors the supply voltage. Below 2.9 V the voltage detector causes an interrupt that switches
 * the outputs off, before the brown-out reset at 2.7 V. At least 2.7 V are required to read the
 * flash with five wait states and to program it by words. */

#include "firmware/port/stm32/barrier.h"
#include "firmware/port/stm32/board.h"

static volatile bool is_low;

void supply_init(void) {
  RCC->APB1ENR |= RCC_APB1ENR_PWREN;
  (void)RCC->APB1ENR;
  PWR->CR = (PWR->CR & ~PWR_CR_PLS) | PWR_CR_PLS_7 | PWR_CR_PVDE;
  /* the output of the voltage detector rises when the supply voltage falls */
  EXTI->RTSR |= EXTI_RTSR_TR16;
  EXTI->PR = EXTI_PR_PR16;
  EXTI->IMR |= EXTI_IMR_MR16;
  NVIC->IPR0 = FIELD(8, 8, PRIORITY_SUPPLY);
  NVIC->ISER0 = BIT(IRQ_PVD);
}

/* Switches the outputs off. The interrupted tick may be about to output a DAC code, so port_act()
 * checks supply_is_low() after its output. */
void supply_interrupt(void) {
  EXTI->PR = EXTI_PR_PR16;
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
  if ((PWR->CSR & PWR_CSR_PVDO) != 0) {
    is_low = true;
  }
}

/* Returns true if the option bytes set the brown-out reset to the required level, and protect
 * sector 0 with the loader from programming and erasing. In a new chip the brown-out reset is off,
 * and no sector is protected. */
bool option_bytes_are_right(void) {
  return (FLASH->OPTCR & (FLASH_OPTCR_BOR_LEV | FLASH_OPTCR_nWRP_0 | FLASH_OPTCR_SPRMOD)) == 0;
}
