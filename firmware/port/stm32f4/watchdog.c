#include "firmware/port/port.h"
#include "firmware/port/stm32f4/board.h"

/* 40 counts of 32 kHz / 16: 20 ms; the oscillator's 17 to 47 kHz make 14 to 38 ms of it. */
enum { RELOAD = 40 - 1 };

/* Both registers take their value within 5 cycles of the slow oscillator, 300 us. */
enum { POLLS_MAX = 20000 };

/* Once started it cannot be stopped. Until it is fed it counts from its reset value, 0.35 to 1 s,
 * long enough for the start-up, which it watches. A debugger that has stopped it together with the
 * core, and has not said otherwise, would stop it for good: only a power-up ends that. */
void watchdog_start(void) {
  DBGMCU->APB1_FZ = 0;
  IWDG->KR = IWDG_KEY_START;
  IWDG->KR = IWDG_KEY_ACCESS;
  IWDG->PR = IWDG_PR_PR_16;
  IWDG->RLR = RELOAD;
}

/* Its first feeding brings the 20 ms into force, once the registers have them. */
void watchdog_arm(void) {
  for (uint32_t polls = 0; polls < POLLS_MAX; polls++) {
    if ((IWDG->SR & (IWDG_SR_PVU | IWDG_SR_RVU)) == 0) {
      break;
    }
  }
  IWDG->KR = IWDG_KEY_FEED;
}

/* The flags stay over resets until they are cleared. */
uint8_t reset_cause(void) {
  const uint8_t cause = (uint8_t)(RCC->CSR >> 24);
  RCC->CSR |= RCC_CSR_RMVF;
  return (uint8_t)(cause & ~1u);
}

void port_feed_watchdog(void) { IWDG->KR = IWDG_KEY_FEED; }
