#include "firmware/port/port.h"
#include "firmware/port/stm32f4/board.h"

/* 40 counts of 32 kHz / 16: 20 ms; the oscillator's 17 to 47 kHz make 14 to 38 ms of it. */
enum { RELOAD = 40 - 1 };

/* Once started it cannot be stopped. The registers take their values some cycles of the slow
 * oscillator later, long before the first feeding. */
void watchdog_start(void) {
  IWDG->KR = IWDG_KEY_START;
  IWDG->KR = IWDG_KEY_ACCESS;
  IWDG->PR = IWDG_PR_PR_16;
  IWDG->RLR = RELOAD;
}

/* The flag stays over resets until it is cleared. */
bool watchdog_fired(void) {
  const bool fired = (RCC->CSR & RCC_CSR_WDGRSTF) != 0;
  RCC->CSR |= RCC_CSR_RMVF;
  return fired;
}

void port_feed_watchdog(void) { IWDG->KR = IWDG_KEY_FEED; }
