#include "firmware/port/stm32/board.h"

/* Settings of the PLL. The input of the PLL is 2 MHz. This is the clock of the ST-Link, 8 MHz,
 * divided by 4; if this clock is missing, it is the internal oscillator, 16 MHz, divided by 8. The
 * PLL multiplies its input by 168 to 336 MHz, and divides the result by 2 to 168 MHz. At a supply
 * voltage of 2.7..3.6 V the flash needs five wait states. A reset selects voltage scale 1. */
#define PLL (RCC_PLLCFGR_PLLN_168 | RCC_PLLCFGR_PLLP_2 | RCC_PLLCFGR_PLLQ_7)
#define PLL_EXTERNAL (PLL | RCC_PLLCFGR_PLLSRC | RCC_PLLCFGR_PLLM_4)
#define PLL_INTERNAL (PLL | RCC_PLLCFGR_PLLM_8)
#define PLL_FIELDS (MASK(0, 6) | MASK(6, 9) | MASK(16, 2) | MASK(24, 4) | RCC_PLLCFGR_PLLSRC)
#define CACHES (FLASH_ACR_PRFTEN | FLASH_ACR_ICEN | FLASH_ACR_DCEN)

/* Largest numbers of polls until a clock has started. A poll takes at least 6 cycles of the
 * internal oscillator. POLLS_MAX: the PLL locks within 300 us, which are 4800 cycles.
 * POLLS_OF_INPUT: an external clock is ready after a few of its own cycles. */
enum { POLLS_MAX = 4000, POLLS_OF_INPUT = 400 };

static bool is_external;

/* Polls a register. Returns true if its bits in `mask` become `wanted` within `polls_max` polls. */
static bool becomes_within(uint32_t polls_max, const reg_t *reg, uint32_t mask, uint32_t wanted) {
  for (uint32_t polls = 0; polls < polls_max; polls++) {
    if ((*reg & mask) == wanted) {
      return true;
    }
  }
  return false;
}

static bool becomes(const reg_t *reg, uint32_t mask, uint32_t wanted) {
  return becomes_within(POLLS_MAX, reg, mask, wanted);
}

/* Restores the clock settings after a reset, because another program may have changed them:
 * internal oscillator on, PLL off. Returns false if the clocks do not change in time. */
static bool fall_back(void) {
  RCC->CR |= RCC_CR_HSION;
  const bool is_ready = becomes(&RCC->CR, RCC_CR_HSIRDY, RCC_CR_HSIRDY);
  RCC->CFGR = 0;
  const bool is_slow = becomes(&RCC->CFGR, RCC_CFGR_SWS, 0);
  RCC->CR &= ~(RCC_CR_PLLON | RCC_CR_CSSON | RCC_CR_HSEON);
  const bool is_off = becomes(&RCC->CR, RCC_CR_PLLRDY | RCC_CR_HSERDY, 0);
  return is_ready && is_slow && is_off;
}

/* Starts the external clock, which is a clock signal at the pin OSC_IN, because the board has no
 * crystal. Returns false if there is no signal. */
static bool external_start(void) {
  RCC->CR |= RCC_CR_HSEBYP;
  RCC->CR |= RCC_CR_HSEON;
  if (becomes_within(POLLS_OF_INPUT, &RCC->CR, RCC_CR_HSERDY, RCC_CR_HSERDY)) {
    return true;
  }
  RCC->CR &= ~RCC_CR_HSEON;
  return false;
}

/* Starts the PLL. The voltage regulator starts with the PLL. Waits until the PLL has locked and the
 * regulator is ready. Returns false if one of them is not ready in time. */
static bool pll_start(uint32_t settings) {
  RCC->PLLCFGR = (RCC->PLLCFGR & ~PLL_FIELDS) | settings;
  RCC->CR |= RCC_CR_PLLON;
  return becomes(&RCC->CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY) &&
         becomes(&PWR->CSR, PWR_CSR_VOSRDY, PWR_CSR_VOSRDY);
}

static bool speed_up(void) {
  /* The bus clocks are divided before the clock of the core rises. They will then have their
   * largest permitted values: APB1 42 MHz, APB2 84 MHz. */
  RCC->CFGR = RCC_CFGR_PPRE1_4 | RCC_CFGR_PPRE2_2;
  RCC->CFGR |= RCC_CFGR_SW_PLL;
  return becomes(&RCC->CFGR, RCC_CFGR_SWS, RCC_CFGR_SWS_PLL);
}

bool clock_start(void) {
  RCC->APB1ENR |= RCC_APB1ENR_PWREN;
  (void)RCC->APB1ENR;
  FLASH->ACR = FLASH_ACR_LATENCY_5 | CACHES;
  if (!fall_back() || !becomes(&FLASH->ACR, FLASH_ACR_LATENCY, FLASH_ACR_LATENCY_5)) {
    return false;
  }
  is_external = external_start();
  if (!pll_start(is_external ? PLL_EXTERNAL : PLL_INTERNAL) || !speed_up()) {
    (void)fall_back();
    is_external = false;
    return false;
  }
  if (is_external) {
    /* If the external clock stops later, an NMI occurs. Then the outputs are switched off, and
     * the chip is reset and starts with the internal oscillator. */
    RCC->CR |= RCC_CR_CSSON;
  }
  return true;
}

bool clock_is_external(void) { return is_external; }

/* Returns the causes of the last reset. Clears their flags, because the flags would otherwise
 * remain over later resets. */
uint8_t reset_cause(void) {
  const uint8_t cause = (uint8_t)(RCC->CSR >> 24);
  RCC->CSR |= RCC_CSR_RMVF;
  return (uint8_t)(cause & ~1u);
}
