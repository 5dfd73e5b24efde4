#include "firmware/port/stm32f4/board.h"

/* HSI 16 MHz / 8 = 2 MHz, * 168 = 336 MHz, / 2 = 168 MHz. The internal oscillator needs no part of
 * the board; its 1 % is in the length of the tick and in both bit rates, which allow it. (The 8 MHz
 * of the ST-Link in its place: HSEBYP and HSEON, PLLSRC, PLLM 4.) Supply 2.7..3.6 V: five wait
 * states. Voltage scale 1 is the reset value. */
#define PLL (RCC_PLLCFGR_PLLM_8 | RCC_PLLCFGR_PLLN_168 | RCC_PLLCFGR_PLLP_2 | RCC_PLLCFGR_PLLQ_7)
#define PLL_FIELDS (MASK(0, 6) | MASK(6, 9) | MASK(16, 2) | MASK(24, 4) | RCC_PLLCFGR_PLLSRC)
#define CACHES (FLASH_ACR_PRFTEN | FLASH_ACR_ICEN | FLASH_ACR_DCEN)

/* The PLL locks within 300 us: 4800 cycles of the HSI. A poll takes at least 6. */
enum { POLLS_MAX = 4000 };

/* Whether the masked bits of a register became `wanted` in time. */
static bool becomes(const reg_t *reg, uint32_t mask, uint32_t wanted) {
  for (uint32_t polls = 0; polls < POLLS_MAX; polls++) {
    if ((*reg & mask) == wanted) {
      return true;
    }
  }
  return false;
}

bool clock_start(void) {
  FLASH->ACR = FLASH_ACR_LATENCY_5 | CACHES;
  if (!becomes(&FLASH->ACR, FLASH_ACR_LATENCY, FLASH_ACR_LATENCY_5)) {
    return false;
  }
  RCC->PLLCFGR = (RCC->PLLCFGR & ~PLL_FIELDS) | PLL;
  RCC->CR |= RCC_CR_PLLON;
  if (!becomes(&RCC->CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY)) {
    RCC->CR &= ~RCC_CR_PLLON;
    return false;
  }
  /* APB1 at 42 and APB2 at 84 MHz, which are their limits, before the core is fast. */
  RCC->CFGR = RCC_CFGR_PPRE1_4 | RCC_CFGR_PPRE2_2;
  RCC->CFGR |= RCC_CFGR_SW_PLL;
  if (!becomes(&RCC->CFGR, RCC_CFGR_SWS, RCC_CFGR_SWS_PLL)) {
    RCC->CFGR = 0;
    return false;
  }
  return true;
}

/* Its clock is twice that of APB1 where that is divided. */
void clock_counter_start(void) {
  RCC->APB1ENR |= RCC_APB1ENR_TIM2EN;
  (void)RCC->APB1ENR;
  TIM2->ARR = UINT32_MAX;
  TIM2->CR1 = TIM_CR1_CEN;
}

uint32_t clock_count(void) { return TIM2->CNT; }
