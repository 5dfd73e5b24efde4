#include "firmware/port/port.h"
#include "firmware/port/stm32f4/board.h"

/* 40 counts of 32 kHz / 16 are 20 ms; with the oscillator between 17 and 47 kHz they are 14 to 38
 * ms. */
enum { RELOAD = 40 - 1 };

/* Both registers adopt their values within 5 cycles of the slow oscillator, 300 us. */
enum { POLLS_MAX = 20000 };

/* Once started, the watchdog cannot be stopped. Until it is first fed it uses its reset value, 0.35
 * to 1 s, which is long enough for the start-up. A debugger that stops the watchdog together with
 * the core leaves this setting behind; then only a power-up lets the watchdog run again. */
void watchdog_start(void) {
  DBGMCU->APB1_FZ = 0;
  IWDG->KR = IWDG_KEY_START;
  IWDG->KR = IWDG_KEY_ACCESS;
  IWDG->PR = IWDG_PR_PR_16;
  IWDG->RLR = RELOAD;
}

/* The first feeding activates the time of 20 ms, when the registers have adopted their values. */
void watchdog_arm(void) {
  for (uint32_t polls = 0; polls < POLLS_MAX; polls++) {
    if ((IWDG->SR & (IWDG_SR_PVU | IWDG_SR_RVU)) == 0) {
      break;
    }
  }
  IWDG->KR = IWDG_KEY_FEED;
}

/* The flags remain over resets until they are cleared. */
uint8_t reset_cause(void) {
  const uint8_t cause = (uint8_t)(RCC->CSR >> 24);
  RCC->CSR |= RCC_CSR_RMVF;
  return (uint8_t)(cause & ~1u);
}

void port_feed_watchdog(void) { IWDG->KR = IWDG_KEY_FEED; }
