#include "firmware/port/stm32/board.h"

enum { MID_SCALE = 2048, PIN = 4 };

/* Initialises the DAC without its output buffer. Without the buffer the DAC reaches both ends of
 * its range. Its output resistance is then 15 kOhm, so the pin must have no load. While amp_enable
 * is low, the analog switch of the board outputs mid-scale instead of the voltage of the pin. The
 * pin is set to analog before the DAC drives it, and the DAC is set to mid-scale before it is
 * enabled. No trigger is used, so a DAC code is output one cycle of APB1 after it was written. */
void dac_init(void) {
  set_bits(&RCC->APB1ENR, RCC_APB1ENR_DACEN);
  DAC->DHR12R1 = MID_SCALE;
  pin_mode(GPIOA, PIN, PIN_ANALOG, PIN_PULL_NONE);
  DAC->CR = DAC_CR_BOFF1 | DAC_CR_EN1;
  DAC->DHR12R1 = MID_SCALE;
}

void dac_write(int16_t code) { DAC->DHR12R1 = (uint32_t)(MID_SCALE + code); }

bool dac_is_zero(void) { return (DAC->DOR1 & DAC_DOR1_DACC1DOR) == MID_SCALE; }
