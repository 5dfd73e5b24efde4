#include "firmware/port/stm32/board.h"

enum { PIN_A = 0, PIN_B = 1, FUNCTION_TIM5 = 2 };

/* Initialises the counter of the encoder. Timer 4 captures the count at the begin of each tick. The
 * counter has 32 bits and counts all four edges of the two encoder tracks. An edge is counted after
 * 8 equal samples at 84 MHz, which take 95 ns. */
void encoder_init(void) {
  set_bits(CLOCK_OF_TIM5);
  pin_alternate(GPIOA, PIN_A, FUNCTION_TIM5, PIN_PULL_UP);
  pin_alternate(GPIOA, PIN_B, FUNCTION_TIM5, PIN_PULL_UP);
  TIM5->ARR = UINT32_MAX;
  TIM5->CCMR1 = TIM_CCMR1_CC1S_TI1 | TIM_CCMR1_IC1F_8 | TIM_CCMR1_CC2S_TI2 | TIM_CCMR1_IC2F_8;
  TIM5->CCMR2 = TIM_CCMR2_CC3S_TRC;
  TIM5->CCER = TIM_CCER_CC3E;
  /* the trigger field of SMCR may not be changed while the slave mode is on */
  TIM5->SMCR = TRIGGER_OF_TICK;
  TIM5->SMCR = TRIGGER_OF_TICK | TIM_SMCR_SMS_ENCODER;
  TIM5->CNT = 0;
  TIM5->CR1 = TIM_CR1_CEN;
}

bool encoder_read(int32_t *count) {
  const bool is_captured = (TIM5->SR & TIM_SR_CC3IF) != 0;
  *count = (int32_t)TIM5->CCR3; /* reading the register CCR3 clears the capture flag */
  return is_captured;
}
