/* Compares the length of the tick with the slow oscillator of the watchdog. This oscillator is
 * independent of all other clocks of the chip. The rate of the slow oscillator is between 17 and 47
 * kHz (LSI of the chip). At power-up this rate is measured with the internal oscillator of 16 MHz,
 * which has an error of at most 4 %. Afterwards the length of the tick is measured with the slow
 * oscillator. The real-time clock counts the cycles of the slow oscillator. */

#include "firmware/port/stm32/board.h"
#include "firmware/port/stm32/tick.h"

/* Number of counts of the slow oscillator (nominally 32 kHz) during which its rate is measured. The
 * measurement takes 0.4 to 1.2 ms and has an error of 5 %. */
enum { MEASURED = 20 };

/* WINDOW_TICKS: number of ticks in one comparison. They take 10 ms, which are 170 to 470 counts of
 * the slow oscillator. PERMILLE_MAX: largest accepted error of the tick length in 1/1000. The
 * temperature drift of the two oscillators together is smaller. */
enum { WINDOW_TICKS = 15, PERMILLE_MAX = 250 };

/* Largest number of polls until the real-time clock changes by one count. A count lasts at most 59
 * us, 941 cycles of the internal oscillator, and a poll takes at least 6 cycles. */
enum { POLLS_MAX = 4000 };

/* number of cycles of the 16 MHz oscillator during MEASURED counts of the slow oscillator; 0: not
 * known */
static uint32_t cycles;
static uint32_t before; /* count of the real-time clock at the start of the present comparison */
static uint8_t ticks = WINDOW_TICKS;
static bool is_compared;
static bool is_running; /* true: `before` is valid */
static int16_t permille;

static bool becomes(const reg_t *reg, uint32_t mask, uint32_t wanted) {
  for (uint32_t polls = 0; polls < POLLS_MAX; polls++) {
    if ((*reg & mask) == wanted) {
      return true;
    }
  }
  return false;
}

/* Starts the real-time clock. It counts the cycles of the slow oscillator downwards from 32767, and
 * is read without synchronisation. Returns false if the clock does not start. */
static bool counter_start(void) {
  /* set_bits() reads the register back; after this read, the registers of the backup domain can be
   * written */
  set_bits(ACCESS_OF_BACKUP);
  /* A reset of the backup domain permits a new selection of the clock source. After a power-up the
   * reset is needed even if the slow oscillator was already selected, because the oscillator may be
   * unstable otherwise (erratum "Unstable LSI when it clocks RTC", ES0430). The firmware keeps no
   * data in the backup domain. */
  RCC->BDCR = RCC_BDCR_BDRST;
  RCC->BDCR = 0;
  RCC->CSR |= RCC_CSR_LSION;
  if (!becomes(&RCC->CSR, RCC_CSR_LSIRDY, RCC_CSR_LSIRDY)) {
    return false;
  }
  RCC->BDCR = RCC_BDCR_RTCSEL_LSI;
  RCC->BDCR = RCC_BDCR_RTCSEL_LSI | RCC_BDCR_RTCEN;
  RTC->WPR = RTC_KEY1;
  RTC->WPR = RTC_KEY2;
  RTC->CR |= RTC_CR_BYPSHAD;
  RTC_INITIALISATION |= RTC_INITIALISATION_INIT;
  const bool done =
      becomes(&RTC_INITIALISATION, RTC_INITIALISATION_INITF, RTC_INITIALISATION_INITF);
  /* PRER is written twice, because its two fields must be written one after the other. */
  RTC->PRER = RTC_PRER_PREDIV_S;
  RTC->PRER = RTC_PRER_PREDIV_S;
  RTC_INITIALISATION &= ~RTC_INITIALISATION_INIT;
  RTC->WPR = RTC_KEY_NONE;
  return done;
}

/* Waits until the count of the real-time clock changes. Returns false if it does not change within
 * POLLS_MAX polls. */
static bool await_count(void) {
  const uint32_t now = RTC->SSR;
  for (uint32_t polls = 0; polls < POLLS_MAX; polls++) {
    if (RTC->SSR != now) {
      return true;
    }
  }
  return false;
}

/* Measures the rate of the slow oscillator. At this time the core and clock_count() run from the
 * internal oscillator. */
void second_clock_start(void) {
  set_bits(CLOCK_OF_RTC);
  if (!counter_start() || !await_count()) {
    return;
  }
  const uint32_t begin = clock_count();
  for (uint32_t i = 0; i < MEASURED; i++) {
    if (!await_count()) {
      return;
    }
  }
  cycles = clock_count() - begin;
}

/* Computes the error of the tick length in 1/1000 from the counts of the real-time clock during a
 * comparison. If ticks are too long, there are more counts: the true time of the comparison is
 * counts / MEASURED * cycles / 16 MHz. */
static void compare(uint32_t counts) {
  const uint32_t window_us = WINDOW_TICKS * UINT32_C(2000) / 3;
  const uint32_t per_window = MEASURED * (CLOCK_HSI_HZ / 1000000u) * window_us;
  /* The product does not overflow 32 bits, even if ticks are 20 times too long: it is then 20 times
   * 470 counts times 18824 cycles. */
  const int32_t thousands = (int32_t)(counts * cycles / (per_window / 1000u)) - 1000;
  permille = (int16_t)((thousands > INT16_MAX) ? INT16_MAX : thousands);
  is_compared = true;
}

void second_clock_tick(void) {
  if (ticks < WINDOW_TICKS) {
    ticks++;
    return;
  }
  const uint32_t now = RTC->SSR;
  if (is_running && cycles != 0) {
    compare((before - now) & RTC_PRER_PREDIV_S); /* the counter has 15 bits and counts downwards */
  }
  before = now;
  is_running = true;
  ticks = 1;
}

int16_t second_clock_permille(void) { return permille; }

/* Returns the result of the comparison of the tick with the slow oscillator, as AXIS_BOARD_STATE_
 * bits. It is an error if the slow oscillator does not run, because the watchdog needs it too. */
uint16_t second_clock_state(void) {
  if (cycles == 0 || permille > PERMILLE_MAX || permille < -PERMILLE_MAX) {
    return AXIS_BOARD_STATE_TICK;
  }
  return is_compared ? 0 : AXIS_BOARD_STATE_TICK_UNKNOWN;
}
