#include "firmware/port/stm32/board.h"

/* Pin numbers of the force and of the motor current on port A. They are channels 3 and 4 of ADC2.
 * Channel 17 of ADC2 measures pin PA4, which the DAC drives. Channel 18 of ADC1 measures the
 * internal reference. */
enum { PIN_FORCE = 6, PIN_CURRENT = 7 };

/* COUNTS_MAX limits the wait for a result to 5 us, which are 420 counts of the free-running
 * counter. Two conversions together take 2 x (47.5 + 12.5) cycles of 42 MHz, which are 2.9 us. 47.5
 * sampling cycles are enough for a source resistance of 2.2 kOhm. Each poll makes eight reads over
 * the bus, so few instructions are executed during the wait. */
enum { COUNTS_MAX = 5 * (CLOCK_APB1_HZ / 500000) };

/* While fewer than this number of counts have passed since the begin of a tick, the conversions of
 * this tick cannot have ended. They take 240 counts. */
enum { COUNTS_MIN = 190 };

/* REGULATOR_COUNTS: the voltage regulator of an ADC needs 20 us. POLLS_MAX: a calibration takes 116
 * cycles of the clock of the ADC, which is 4 MHz before the PLL is on. A poll takes at least 6
 * cycles of the core at 168 MHz. */
enum { REGULATOR_COUNTS = 20 * (CLOCK_APB1_HZ / 500000), POLLS_MAX = 4000 };

static uint32_t begun;
static const adc_t *single; /* ADC that makes the conversion that adc_start_one() has started */

static bool becomes(const reg_t *reg, uint32_t mask, uint32_t wanted) {
  for (uint32_t polls = 0; polls < POLLS_MAX; polls++) {
    if ((*reg & mask) == wanted) {
      return true;
    }
  }
  return false;
}

/* Waits for at least `counts` counts of the free-running counter. */
static void await_counts(uint32_t counts) {
  const uint32_t begin = clock_count();
  while (clock_count() - begin < counts) {
  }
}

/* Calibrates an ADC and switches it on. After a reset the bit DEEPPWD of the register CR is 1. If
 * the ADC does not respond in time, its conversions never end, so the sensors are reported as not
 * valid. */
static void converter_start(adc_t *adc) {
  adc->CR = 0; /* The ADC leaves the state deep power-down. */
  adc->CR = ADC_CR_ADVREGEN;
  await_counts(REGULATOR_COUNTS);
  adc->CR = ADC_CR_ADVREGEN | ADC_CR_ADCAL;
  if (!becomes(&adc->CR, ADC_CR_ADCAL, 0)) {
    return;
  }
  /* Before the next step the ADC needs a wait of at least four cycles of its clock. */
  await_counts(REGULATOR_COUNTS);
  adc->ISR = ADC_ISR_ADRDY;
  adc->CR = ADC_CR_ADVREGEN | ADC_CR_ADEN;
  (void)becomes(&adc->ISR, ADC_ISR_ADRDY, ADC_ISR_ADRDY);
}

/* Initialises both ADCs. The timer of the tick starts the injected group of ADC2. This group gives
 * the two results of a tick in separate registers, without DMA. The regular groups make single
 * conversions of slow sources. The clock of the ADCs is the clock of the bus divided by 4, which is
 * 42 MHz. So the trigger is not delayed by a random part of a cycle. */
void adc_init(void) {
  set_bits(&RCC->AHB2ENR, RCC_AHB2ENR_ADC12EN);
  pin_mode(GPIOA, PIN_FORCE, PIN_ANALOG, PIN_PULL_NONE);
  pin_mode(GPIOA, PIN_CURRENT, PIN_ANALOG, PIN_PULL_NONE);
  ADC12_COMMON->CCR = ADC_CCR_CKMODE_HCLK_4 | ADC_CCR_VREFEN;
  converter_start(ADC1);
  converter_start(ADC2);
  ADC1->SMPR2 = ADC_SMPR2_SMP18_640;
  ADC2->CFGR = ADC_CFGR_JQDIS;
  ADC2->SMPR1 = ADC_SMPR1_SMP3_47 | ADC_SMPR1_SMP4_47;
  ADC2->SMPR2 = ADC_SMPR2_SMP17_640;
  if ((ADC1->CR & ADC2->CR & ADC_CR_ADEN) == 0) {
    return;
  }
  ADC1->SQR1 = ADC_SQR1_SQ1_18; /* The regular group of each ADC has only one conversion. */
  ADC2->SQR1 = ADC_SQR1_SQ1_17;
  ADC2->JSQR = ADC_JSQR_JL_2 | ADC_JSQR_JEXTSEL_TIM4_TRGO | ADC_JSQR_JEXTEN_RISING |
               ADC_JSQR_JSQ1_3 | ADC_JSQR_JSQ2_4;
  ADC2->CR = ADC_CR_ADVREGEN | ADC_CR_JADSTART;
}

/* Clears a result that was too late for the last tick. A result that is present while the count of
 * the tick timer is below COUNTS_MIN cannot be a result of this tick. */
void adc_begin(void) {
  begun = TIM2->CNT;
  if (TIM4->CNT < COUNTS_MIN) {
    ADC2->ISR = ADC_ISR_JEOC | ADC_ISR_JEOS;
  }
}

static inline void pause(void) {
  (void)ADC2->CR;
  (void)ADC2->CR;
  (void)ADC2->CR;
  (void)ADC2->CR;
  (void)ADC2->CR;
  (void)ADC2->CR;
}

bool adc_read(uint16_t codes[2]) {
  do {
    if ((ADC2->ISR & ADC_ISR_JEOS) != 0) {
      codes[0] = (uint16_t)ADC2->JDR1;
      codes[1] = (uint16_t)ADC2->JDR2;
      return true;
    }
    pause();
  } while (TIM2->CNT - begun < COUNTS_MAX);
  return false;
}

static void start(adc_t *adc) {
  adc->ISR = ADC_ISR_EOC | ADC_ISR_EOS;
  if ((adc->CR & ADC_CR_ADEN) != 0) {
    adc->CR = ADC_CR_ADVREGEN | ADC_CR_ADSTART;
  }
}

/* Starts one conversion of the internal reference, or of pin PA4 if `of_reference` is false. Also
 * clears the flags of the conversions in the tick that ends. A write of 0 to a start bit has no
 * effect. ADC1 converts the reference in each case, because it makes no other conversions, and a
 * conversion that begins more than 1 ms after the previous one may be wrong (ES0430 2.7.9). */
void adc_start_one(bool of_reference) {
  ADC2->ISR = ADC_ISR_JEOC | ADC_ISR_JEOS;
  start(ADC1);
  if (!of_reference) {
    start(ADC2);
  }
  single = of_reference ? ADC1 : ADC2;
}

/* Reads the result of the conversion that adc_start_one() has started. Returns false if the
 * conversion has not finished. */
bool adc_read_one(uint16_t *code) {
  const bool done = (single->ISR & ADC_ISR_EOC) != 0;
  *code = (uint16_t)single->DR;
  return done;
}
