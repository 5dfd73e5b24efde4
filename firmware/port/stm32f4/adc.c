#include "firmware/port/stm32f4/board.h"

/* Channels 6 and 7: force on PA6, motor current on PA7. */
enum { PIN_FORCE = 6, PIN_CURRENT = 7 };

/* Both take 2 x (15 + 12) cycles of 21 MHz, 2.6 us. A read over this bus, half as fast as the core,
 * takes 6 to 9 of the core's cycles; a poll has four and takes 28 to 41, so that this many are 3.3
 * to 4.9 us. */
enum { POLLS_MAX = 20, PAUSE_READS = 3 };

/* The injected group: two results in registers of their own, without DMA. */
void adc_init(void) {
  RCC->AHB1ENR |= RCC_AHB1ENR_GPIOAEN;
  RCC->APB2ENR |= RCC_APB2ENR_ADC1EN;
  (void)RCC->APB2ENR;
  pin_mode(GPIOA, PIN_FORCE, PIN_ANALOG, PIN_PULL_NONE);
  pin_mode(GPIOA, PIN_CURRENT, PIN_ANALOG, PIN_PULL_NONE);
  ADC_COMMON->CCR = ADC_CCR_ADCPRE_4;
  ADC1->CR1 = ADC_CR1_SCAN | ADC_CR1_RES_12;
  ADC1->SMPR2 = ADC_SMPR2_SMP6_15 | ADC_SMPR2_SMP7_15;
  /* A group of two is the last two of its four places. */
  ADC1->JSQR = ADC_JSQR_JL_2 | ADC_JSQR_JSQ3_6 | ADC_JSQR_JSQ4_7;
  ADC1->CR2 = ADC_CR2_ADON;
}

/* A result that came too late for its tick is not taken for that of the next one. */
void adc_start(void) {
  ADC1->SR = 0;
  ADC1->CR2 = ADC_CR2_ADON | ADC_CR2_JSWSTART;
}

bool adc_read(uint16_t codes[2]) {
  for (uint32_t polls = 0; polls < POLLS_MAX; polls++) {
    if ((ADC1->SR & ADC_SR_JEOC) != 0) {
      codes[0] = (uint16_t)ADC1->JDR1;
      codes[1] = (uint16_t)ADC1->JDR2;
      return true;
    }
    for (uint32_t i = 0; i < PAUSE_READS; i++) { /* waits without being busy with instructions */
      (void)ADC1->CR1;
    }
  }
  return false;
}
