/* The timer of the tick, which is timer 4, and the free-running counter, which is timer 2. Each
 * overflow of timer 4 gives a trigger. This trigger starts the conversions of the ADC (adc.c) and
 * captures the count of the encoder (encoder.c) without any instruction. So the time of the
 * measurement does not depend on code that delays the interrupt. */

#include "firmware/port/stm32/board.h"
#include "firmware/port/stm32/tick.h"

void tick_timer_start(void) {
  set_bits(CLOCK_OF_TIM4);
  NVIC->IPR7 = FIELD(16, 8, PRIORITY_TICK);
  NVIC->ISER0 = BIT(IRQ_TIM4);
  TIM4->ARR = TICK_COUNTS - 1;
  TIM4->CR2 = TIM_CR2_MMS_UPDATE;
  TIM4->DIER = TIM_DIER_UIE;
  TIM4->CR1 = TIM_CR1_CEN;
}

void tick_timer_take(void) { TIM4->SR = 0; }

bool tick_timer_is_due(void) { return (TIM4->SR & TIM_SR_UIF) != 0; }

/* Starts the free-running counter. If the clock of APB1 is divided, the counter runs at twice the
 * clock frequency of APB1. */
void clock_counter_start(void) {
  set_bits(CLOCK_OF_TIM2);
  TIM2->ARR = UINT32_MAX;
  TIM2->CR1 = TIM_CR1_CEN;
}

uint32_t clock_count(void) { return TIM2->CNT; }
