#include "firmware/port/stm32f4/board.h"

enum { MID_SCALE = 2048, PIN = 4 };

/* Without its buffer the converter reaches both rails, from 15 kOhm: nothing may load the pin. The
 * board's switch, which amp_enable closes, makes mid-scale of a pin that nothing drives. The pin is
 * analog before the converter drives it, and the converter holds mid-scale before it is enabled.
 * Untriggered, a code is put out one cycle of APB1 later. */
void dac_init(void) {
  RCC->AHB1ENR |= RCC_AHB1ENR_GPIOAEN;
  RCC->APB1ENR |= RCC_APB1ENR_DACEN;
  (void)RCC->APB1ENR; /* a clock is there two cycles after its bit is */
  DAC->DHR12R1 = MID_SCALE;
  pin_mode(GPIOA, PIN, PIN_ANALOG, PIN_PULL_NONE);
  DAC->CR = DAC_CR_BOFF1 | DAC_CR_EN1;
  DAC->DHR12R1 = MID_SCALE;
}

void dac_write(int16_t code) { DAC->DHR12R1 = (uint32_t)(MID_SCALE + code); }

bool dac_is_zero(void) { return (DAC->DOR1 & DAC_DOR1_DACC1DOR) == MID_SCALE; }
