#include "firmware/port/stm32/board.h"

/* Settings of the PLL. The input of the PLL is 4 MHz. This is the crystal, 24 MHz, divided by 6; if
 * the crystal does not run, it is the internal oscillator, 16 MHz, divided by 4. The PLL multiplies
 * its input by 84 to 336 MHz, and divides the result by 2 to 168 MHz. Above 150 MHz the voltage
 * regulator must be in range 1 boost. At 136 to 170 MHz the flash needs four wait states (RM0440,
 * table of wait states). */
#define PLL (RCC_PLLCFGR_PLLN_84 | RCC_PLLCFGR_PLLR_2 | RCC_PLLCFGR_PLLREN)
#define PLL_EXTERNAL (PLL | RCC_PLLCFGR_PLLSRC_HSE | RCC_PLLCFGR_PLLM_6)
#define PLL_INTERNAL (PLL | RCC_PLLCFGR_PLLSRC_HSI | RCC_PLLCFGR_PLLM_4)
#define CACHES (FLASH_ACR_PRFTEN | FLASH_ACR_ICEN | FLASH_ACR_DCEN)

/* Largest numbers of polls until a clock has started. A poll takes at least 6 cycles of the
 * internal oscillator. POLLS_MAX: the PLL locks within 40 us, which are 640 cycles.
 * POLLS_OF_CRYSTAL: the crystal starts within 2 ms, which are 32,000 cycles; twice this time is
 * accepted. */
enum { POLLS_MAX = 4000, POLLS_OF_CRYSTAL = 11000 };

/* Number of loops of a pause of 1 us. In this pause the core runs at half its clock, before it runs
 * at 168 MHz. A loop takes at least 3 cycles of 84 MHz. */
enum { LOOPS_OF_1_US = 32 };

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
  RCC->CFGR = RCC_CFGR_SW_HSI;
  const bool is_slow = becomes(&RCC->CFGR, RCC_CFGR_SWS, RCC_CFGR_SWS_HSI);
  RCC->CR &= ~(RCC_CR_PLLON | RCC_CR_CSSON | RCC_CR_HSEON);
  const bool is_off = becomes(&RCC->CR, RCC_CR_PLLRDY | RCC_CR_HSERDY, 0);
  return is_ready && is_slow && is_off;
}

/* Sets the voltage regulator to range 1 boost. Returns false if the regulator is not ready in
 * time. */
static bool raise_voltage(void) {
  PWR->CR1 = (PWR->CR1 & ~PWR_CR1_VOS) | PWR_CR1_VOS_RANGE_1;
  PWR->CR5 &= ~PWR_CR5_R1MODE;
  return becomes(&PWR->SR2, PWR_SR2_VOSF, 0);
}

/* Starts the external clock, which is the crystal of the board. Returns false if the crystal does
 * not start. */
static bool external_start(void) {
  RCC->CR &= ~RCC_CR_HSEBYP;
  RCC->CR |= RCC_CR_HSEON;
  if (becomes_within(POLLS_OF_CRYSTAL, &RCC->CR, RCC_CR_HSERDY, RCC_CR_HSERDY)) {
    return true;
  }
  RCC->CR &= ~RCC_CR_HSEON;
  return false;
}

/* Starts the PLL. Returns false if the PLL does not lock in time. */
static bool pll_start(uint32_t settings) {
  RCC->PLLCFGR = settings;
  RCC->CR |= RCC_CR_PLLON;
  return becomes(&RCC->CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY);
}

/* Makes the PLL the clock of the core. The clocks of the buses are set first, to the same
 * frequencies as in the STM32F446: APB1 to 42 MHz, APB2 to 84 MHz. If its clock will be above 80
 * MHz, the core must run at half this clock for at least 1 us before (RM0440, range 1 boost). */
static bool speed_up(void) {
  const uint32_t buses = RCC_CFGR_PPRE1_4 | RCC_CFGR_PPRE2_2;
  RCC->CFGR = buses | RCC_CFGR_HPRE_2 | RCC_CFGR_SW_HSI;
  RCC->CFGR = buses | RCC_CFGR_HPRE_2 | RCC_CFGR_SW_PLL;
  const bool done = becomes(&RCC->CFGR, RCC_CFGR_SWS, RCC_CFGR_SWS_PLL);
  for (uint32_t i = 0; i < LOOPS_OF_1_US; i++) {
    __asm volatile("nop");
  }
  if (done) {
    RCC->CFGR = buses | RCC_CFGR_SW_PLL;
  }
  return done;
}

bool clock_start(void) {
  set_bits(&RCC->APB1ENR1, RCC_APB1ENR1_PWREN);
  FLASH->ACR = FLASH_ACR_LATENCY_4 | CACHES;
  if (!fall_back() || !becomes(&FLASH->ACR, FLASH_ACR_LATENCY, FLASH_ACR_LATENCY_4) ||
      !raise_voltage()) {
    return false;
  }
  is_external = external_start();
  if (!pll_start(is_external ? PLL_EXTERNAL : PLL_INTERNAL) || !speed_up()) {
    (void)fall_back();
    is_external = false;
    return false;
  }
  if (is_external) {
    /* If the crystal stops later, an NMI occurs. Then the outputs are switched off, and the
     * chip is reset and starts with the internal oscillator. */
    RCC->CR |= RCC_CR_CSSON;
  }
  return true;
}

bool clock_is_external(void) { return is_external; }

/* Returns the causes of the last reset. Clears their flags, because the flags would otherwise
 * remain over later resets. The upper byte of the register has the bits of AXIS_RESET_CAUSE_, with
 * two exceptions. Bit 25 is the load of the option bytes, which is not reported as a cause. Bit 27
 * means a power-up and also a brown-out. */
uint8_t reset_cause(void) {
  const uint8_t cause = (uint8_t)(RCC->CSR >> 24);
  RCC->CSR |= RCC_CSR_RMVF;
  return (uint8_t)(cause & ~3u);
}
