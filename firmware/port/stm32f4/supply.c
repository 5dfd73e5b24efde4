/* The supply. Below 2.9 V its detector switches the outputs off by interrupt, before the brown-out
 * reset at 2.7 V; five wait states and programming by words are for 2.7 V and more. */

#include "firmware/port/stm32f4/board.h"

static volatile bool is_low;

void supply_init(void) {
  RCC->APB1ENR |= RCC_APB1ENR_PWREN;
  (void)RCC->APB1ENR;
  PWR->CR = (PWR->CR & ~PWR_CR_PLS) | PWR_CR_PLS_7 | PWR_CR_PVDE;
  EXTI->RTSR |= EXTI_RTSR_TR16; /* the detector's output rises when the supply falls */
  EXTI->PR = EXTI_PR_PR16;
  EXTI->IMR |= EXTI_IMR_MR16;
  NVIC->IPR0 = FIELD(8, 8, PRIORITY_SUPPLY);
  NVIC->ISER0 = BIT(IRQ_PVD);
}

/* The tick may be about to put out a code: port_act() looks at supply_is_low() after it has. */
void supply_interrupt(void) {
  EXTI->PR = EXTI_PR_PR16;
  is_low = true;
  io_make_safe();
}

bool supply_is_low(void) { return is_low; }

/* Once a tick: an interrupt stays in force until the detector says that the supply is back. */
void supply_look(void) { is_low = (PWR->CSR & PWR_CSR_PVDO) != 0; }

/* The option bytes hold the level of the brown-out reset; as delivered it is off. */
bool supply_resets_in_time(void) { return (FLASH->OPTCR & FLASH_OPTCR_BOR_LEV) == 0; }
