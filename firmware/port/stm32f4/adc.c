#include "firmware/port/stm32/board.h"

/* Pins of the ADC on port A. Channel 6 measures the force on pin PA6, and channel 7 measures the
 * motor current on pin PA7. Channel 4 measures pin PA4, which the DAC drives. */
enum { PIN_FORCE = 6, PIN_CURRENT = 7 };

/* COUNTS_MAX limits the wait for a result to 5 us, which are 420 counts of the free-running
 * counter. Two conversions together take 2 x (28 + 12) cycles of 21 MHz, which are 3.8 us. 28
 * sampling cycles are enough for a source resistance of 13 kOhm. Each poll makes eight reads over
 * the peripheral bus. Each read takes 6 to 9 cycles of the core, so few instructions are executed
 * during the wait. */
enum { COUNTS_MAX = 5 * (CLOCK_APB1_HZ / 500000) };

/* COUNTS_MIN: while fewer than this number of counts have passed since the begin of a tick, the
 * conversions of this tick cannot have ended. They take 320 counts. */
enum { COUNTS_MIN = 250, STABLE_COUNTS = 3 * (CLOCK_APB1_HZ / 500000) };

/* Setting of the ADC with which the timer of the tick starts the two conversions of the injected
 * group. */
#define ON (ADC_CR2_ADON | ADC_CR2_JEXTEN_RISING | ADC_CR2_JEXTSEL_TIM4_TRGO)

static uint32_t begun;

/* Initialises the ADC. The injected group gives the two results of a tick in separate registers,
 * without DMA. The regular group makes single conversions of slow sources. */
void adc_init(void) {
  set_bits(&RCC->APB2ENR, RCC_APB2ENR_ADC1EN);
  pin_mode(GPIOA, PIN_FORCE, PIN_ANALOG, PIN_PULL_NONE);
  pin_mode(GPIOA, PIN_CURRENT, PIN_ANALOG, PIN_PULL_NONE);
  ADC_COMMON->CCR = ADC_CCR_ADCPRE_4 | ADC_CCR_TSVREFE;
  ADC1->CR1 = ADC_CR1_SCAN | ADC_CR1_RES_12;
  /* The internal reference needs a sampling time of 10 us; 480 cycles are 23 us. */
  ADC1->SMPR1 = ADC_SMPR1_SMP17_480;
  ADC1->SMPR2 = ADC_SMPR2_SMP4_480 | ADC_SMPR2_SMP6_28 | ADC_SMPR2_SMP7_28;
  ADC1->SQR1 = 0; /* The regular group of the ADC has only one conversion. */
  /* If the injected group has two conversions, they use the last two of the four entries in
   * JSQR. */
  ADC1->JSQR = ADC_JSQR_JL_2 | ADC_JSQR_JSQ3_6 | ADC_JSQR_JSQ4_7;
  ADC1->CR2 = ON;
  /* The ADC is stable 3 us after it was switched on. No conversion may be started before (RM0390
   * 13.3.6). */
  const uint32_t begin = clock_count();
  while (clock_count() - begin < STABLE_COUNTS) {
  }
}

/* Clears a result that was too late for the last tick. A result that is present while the count of
 * the tick timer is below COUNTS_MIN cannot be a result of this tick. */
void adc_begin(void) {
  begun = TIM2->CNT;
  if (TIM4->CNT < COUNTS_MIN) {
    ADC1->SR = 0;
  }
}

static inline void pause(void) {
  (void)ADC1->CR1;
  (void)ADC1->CR1;
  (void)ADC1->CR1;
  (void)ADC1->CR1;
  (void)ADC1->CR1;
  (void)ADC1->CR1;
}

bool adc_read(uint16_t codes[2]) {
  do {
    if ((ADC1->SR & ADC_SR_JEOC) != 0) {
      codes[0] = (uint16_t)ADC1->JDR1;
      codes[1] = (uint16_t)ADC1->JDR2;
      return true;
    }
    pause();
  } while (TIM2->CNT - begun < COUNTS_MAX);
  return false;
}

/* Starts one conversion of the internal reference, or of pin PA4 if `of_reference` is false. Also
 * clears the flags of the conversions in the tick that ends. */
void adc_start_one(bool of_reference) {
  ADC1->SR = 0;
  ADC1->SQR3 = of_reference ? ADC_SQR3_SQ1_17 : ADC_SQR3_SQ1_4;
  ADC1->CR2 = ON | ADC_CR2_SWSTART;
}

/* Reads the result of the conversion that adc_start_one() has started. Returns false if the
 * conversion has not finished. */
bool adc_read_one(uint16_t *code) {
  const bool done = (ADC1->SR & ADC_SR_EOC) != 0;
  *code = (uint16_t)ADC1->DR;
  return done;
}
