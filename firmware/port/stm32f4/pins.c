#include "firmware/core/axis.h"
#include "firmware/port/stm32f4/board.h"

/* Outputs, on port B; a pull-down of the board holds each low while the chip is in reset. */
enum { AMP_ENABLE = 0, BRAKE_RELEASE = 1 };

/* Inputs, on port C. Enable chain and limit switches are closed contacts to 3.3 V with pull-downs,
 * so a broken wire reads as an open chain, or as a switch that is reached. Index and home switch
 * are high when they are on. */
enum { ENABLE = 0, LIMIT_POS = 1, LIMIT_NEG = 2, INDEX = 3, HOME = 9 };

/* Straps of the node id, on port C: to ground counts. */
enum { STRAP_FIRST = 4, STRAPS = 5 };

static void set_field(reg_t *reg, uint32_t at, uint32_t width, uint32_t value) {
  *reg = (*reg & ~MASK(at, width)) | FIELD(at, width, value);
}

void pin_mode(gpio_t *port, uint8_t pin, uint32_t mode, uint32_t pull) {
  set_field(&port->PUPDR, 2u * pin, 2, pull);
  set_field(&port->MODER, 2u * pin, 2, mode);
}

/* The function first, so that no other one is ever connected to the pin. */
void pin_alternate(gpio_t *port, uint8_t pin, uint32_t function, uint32_t pull) {
  set_field((pin < 8) ? &port->AFRL : &port->AFRH, 4u * (pin % 8u), 4, function);
  pin_mode(port, pin, PIN_ALTERNATE, pull);
}

void pins_write(bool amp_enable, bool brake_release) {
  /* The upper half of the register clears. */
  GPIOB->BSRR = (amp_enable ? BIT(AMP_ENABLE) : BIT(AMP_ENABLE + 16)) |
                (brake_release ? BIT(BRAKE_RELEASE) : BIT(BRAKE_RELEASE + 16));
}

/* An index pulse is shorter than a tick: its edge stays pending until it is read. The line is not
 * masked, so that it becomes pending, but its interrupt is never enabled. */
static void index_init(void) {
  RCC->APB2ENR |= RCC_APB2ENR_SYSCFGEN;
  (void)RCC->APB2ENR;
  SYSCFG->EXTICR1 = (SYSCFG->EXTICR1 & ~SYSCFG_EXTICR1_EXTI3) | SYSCFG_EXTICR1_EXTI3_PC;
  EXTI->RTSR |= EXTI_RTSR_TR3;
  EXTI->IMR |= EXTI_IMR_MR3;
  EXTI->PR = EXTI_PR_PR3;
}

static bool index_was_seen(void) {
  const bool seen = (EXTI->PR & EXTI_PR_PR3) != 0;
  if (seen) {
    EXTI->PR = EXTI_PR_PR3; /* writing 1 clears it */
  }
  return seen;
}

void pins_init(void) {
  pins_write(false, false);
  pin_mode(GPIOB, AMP_ENABLE, PIN_OUTPUT, PIN_PULL_NONE);
  pin_mode(GPIOB, BRAKE_RELEASE, PIN_OUTPUT, PIN_PULL_NONE);
  for (uint8_t pin = ENABLE; pin <= INDEX; pin++) {
    pin_mode(GPIOC, pin, PIN_INPUT, PIN_PULL_DOWN);
  }
  pin_mode(GPIOC, HOME, PIN_INPUT, PIN_PULL_DOWN);
  index_init();
  for (uint8_t i = 0; i < STRAPS; i++) {
    pin_mode(GPIOC, (uint8_t)(STRAP_FIRST + i), PIN_INPUT, PIN_PULL_UP);
  }
}

uint8_t pins_din(void) {
  const uint32_t levels = GPIOC->IDR;
  return (uint8_t)((((levels & BIT(ENABLE)) != 0) ? AXIS_DIN_ENABLE : 0) |
                   (((levels & BIT(LIMIT_POS)) == 0) ? AXIS_DIN_LIMIT_POS : 0) |
                   (((levels & BIT(LIMIT_NEG)) == 0) ? AXIS_DIN_LIMIT_NEG : 0) |
                   (((levels & BIT(HOME)) != 0) ? AXIS_DIN_HOME : 0) |
                   (index_was_seen() ? AXIS_DIN_INDEX : 0));
}

uint8_t pins_node_id(void) {
  return (uint8_t)((~GPIOC->IDR & MASK(STRAP_FIRST, STRAPS)) >> STRAP_FIRST);
}
