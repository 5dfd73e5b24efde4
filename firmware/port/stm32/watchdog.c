#include "firmware/port/port.h"
#include "firmware/port/stm32/board.h"

/* Reload value for a watchdog time of 20 ms: 40 counts of 32 kHz / 16. The frequency of the
 * oscillator may be 17 to 47 kHz, so the real time is between 14 and 38 ms. */
enum { RELOAD = 40 - 1 };

/* Largest number of polls until the registers PR and RLR have adopted their values. This takes at
 * most 5 cycles of the slow oscillator, which are 300 us. */
enum { POLLS_MAX = 20000 };

/* Starts the watchdog timer. It cannot be stopped afterwards. Until the program first feeds the
 * watchdog, the watchdog time is that after a reset, 0.35 to 1 s. This is long enough for the
 * start-up. A debugger may have left a setting with which the watchdog stops together with the
 * core. Only a power-up ends this setting. */
void watchdog_start(void) {
  DBGMCU->APB1_FZ = 0;
  IWDG->KR = IWDG_KEY_START;
  IWDG->KR = IWDG_KEY_ACCESS;
  IWDG->PR = IWDG_PR_PR_16;
  IWDG->RLR = RELOAD;
}

/* Sets the watchdog time to 20 ms. Waits until the registers have adopted their values, and then
 * feeds the watchdog for the first time, which makes the new time active. */
void watchdog_arm(void) {
  for (uint32_t polls = 0; polls < POLLS_MAX; polls++) {
    if ((IWDG->SR & (IWDG_SR_PVU | IWDG_SR_RVU)) == 0) {
      break;
    }
  }
  IWDG->KR = IWDG_KEY_FEED;
}

void port_feed_watchdog(void) { IWDG->KR = IWDG_KEY_FEED; }
