#include "firmware/port/stm32f4/board.h"

/* Channels 6 and 7: force on PA6, motor current on PA7. Channel 4 is PA4, the DAC's own output. */
enum { PIN_FORCE = 6, PIN_CURRENT = 7 };

/* Both take 2 x (28 + 12) cycles of 21 MHz, 3.8 us; 28 cycles bear a source of 13 kOhm. A read over
 * this bus, half as fast as the core, takes 6 to 9 of the core's cycles; a poll has eight, so that
 * it waits without being busy with instructions. The end is a time: 5 us, 420 counts of the
 * free-running counter. */
enum { COUNTS_MAX = 5 * (CLOCK_APB1_HZ / 500000) };

static uint32_t started;

/* The injected group: two results in registers of their own, without DMA. The regular one is a
 * single conversion of a slow source. */
void adc_init(void) {
  RCC->AHB1ENR |= RCC_AHB1ENR_GPIOAEN;
  RCC->APB2ENR |= RCC_APB2ENR_ADC1EN;
  (void)RCC->APB2ENR;
  pin_mode(GPIOA, PIN_FORCE, PIN_ANALOG, PIN_PULL_NONE);
  pin_mode(GPIOA, PIN_CURRENT, PIN_ANALOG, PIN_PULL_NONE);
  ADC_COMMON->CCR = ADC_CCR_ADCPRE_4 | ADC_CCR_TSVREFE;
  ADC1->CR1 = ADC_CR1_SCAN | ADC_CR1_RES_12;
  /* The internal reference needs 10 us; 480 cycles are 23. */
  ADC1->SMPR1 = ADC_SMPR1_SMP17_480;
  ADC1->SMPR2 = ADC_SMPR2_SMP4_480 | ADC_SMPR2_SMP6_28 | ADC_SMPR2_SMP7_28;
  ADC1->SQR1 = 0; /* a group of one */
  /* A group of two is the last two of its four places. */
  ADC1->JSQR = ADC_JSQR_JL_2 | ADC_JSQR_JSQ3_6 | ADC_JSQR_JSQ4_7;
  ADC1->CR2 = ADC_CR2_ADON;
}

/* A result that came too late for its tick is not taken for that of the next one. */
void adc_start(void) {
  ADC1->SR = 0;
  ADC1->CR2 = ADC_CR2_ADON | ADC_CR2_JSWSTART;
  started = TIM2->CNT;
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
  } while (TIM2->CNT - started < COUNTS_MAX);
  return false;
}

/* Of the internal reference, or of PA4. */
void adc_start_one(bool of_reference) {
  ADC1->SQR3 = of_reference ? ADC_SQR3_SQ1_17 : ADC_SQR3_SQ1_4;
  ADC1->CR2 = ADC_CR2_ADON | ADC_CR2_SWSTART;
}

/* False: it is not done. Its flag goes with adc_start(). */
bool adc_read_one(uint16_t *code) {
  const bool done = (ADC1->SR & ADC_SR_EOC) != 0;
  *code = (uint16_t)ADC1->DR;
  return done;
}
