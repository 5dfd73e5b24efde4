#include "firmware/core/axis.h"
#include "firmware/port/stm32/barrier.h"
#include "firmware/port/stm32/board.h"

/* Pin numbers of the outputs on port B. A pull-down resistor of the board keeps each output low
 * while the chip is in reset. */
enum { AMP_ENABLE = 0, BRAKE_RELEASE = 1 };

/* Number of digital outputs. They are pins of DIGITAL_PORT, beginning with pin DIGITAL_FIRST. A
 * pull-down resistor of the board keeps each output low while the chip is in reset. */
enum { DIGITALS = 4 };

/* Pin number of an option of the board on port C. If this pin is connected to ground, amp_enable is
 * a square wave of 750 Hz while the axis is enabled. The square wave is for a charge pump or a
 * monostable: these circuits switch off when the level is constant. */
enum { STRAP_DYNAMIC = 10 };

/* Pins of the encoder tracks A and B on port A. */
#define TRACKS (BIT(0) | BIT(1))

/* Largest number of edges of the index input that are processed between two ticks. So noise at this
 * input cannot use more computing time. */
enum { EDGES_MAX = 4 };

static bool is_dynamic;
static volatile bool is_high; /* last level of the output amp_enable */
/* number of index pulses, modulo 256; only the interrupt writes this variable. `pulses_seen`: value
 * of `pulses` in the last tick */
static volatile uint8_t pulses;
static uint8_t pulses_seen;
/* number of edges of the index input since the last tick */
static volatile uint8_t edges;

/* Pin numbers of the inputs on port C. The enable chain and the limit switches are normally closed
 * contacts to 3.3 V with pull-down resistors. So a broken wire reads as an open enable chain or as
 * an active limit switch. The inputs of the index and of the home switch are high when they are
 * active. */
enum { ENABLE = 0, LIMIT_POS = 1, LIMIT_NEG = 2, INDEX = 3, HOME = 9 };

/* Pins of the node id straps on port C. Each strap is one bit of the node id. The bit is 1 if the
 * strap is connected to ground. */
enum { STRAP_FIRST = 4, STRAPS = 5 };

static void set_field(reg_t *reg, uint32_t at, uint32_t width, uint32_t value) {
  *reg = (*reg & ~MASK(at, width)) | FIELD(at, width, value);
}

void pin_mode(gpio_t *port, uint8_t pin, uint32_t mode, uint32_t pull) {
  set_field(&port->PUPDR, 2u * pin, 2, pull);
  set_field(&port->MODER, 2u * pin, 2, mode);
}

void pin_speed(gpio_t *port, uint8_t pin, uint32_t speed) {
  set_field(&port->OSPEEDR, 2u * pin, 2, speed);
}

/* Connects a pin to a peripheral function. The function is selected before the mode, so that the
 * pin is never connected to another function. */
void pin_alternate(gpio_t *port, uint8_t pin, uint32_t function, uint32_t pull) {
  set_field((pin < 8) ? &port->AFRL : &port->AFRH, 4u * (pin % 8u), 4, function);
  pin_mode(port, pin, PIN_ALTERNATE, pull);
}

void pins_write(bool amp_enable, bool brake_release) {
  is_high = amp_enable && !(is_dynamic && is_high);
  /* The upper half of the register BSRR clears pins, and the lower half sets pins. */
  GPIOB->BSRR = (is_high ? BIT(AMP_ENABLE) : BIT(AMP_ENABLE + 16)) |
                (brake_release ? BIT(BRAKE_RELEASE) : BIT(BRAKE_RELEASE + 16));
}

void pins_write_digital(uint8_t levels) {
  /* If a write to BSRR sets and clears a pin at the same time, the pin is set. */
  DIGITAL_PORT->BSRR = MASK(DIGITAL_FIRST + 16, DIGITALS) | FIELD(DIGITAL_FIRST, DIGITALS, levels);
}

/* Returns true if the pin amp_enable has the level that was output. The level is read from the pin,
 * because an external circuit may force another level. */
bool pins_enable_is_right(void) { return ((GPIOB->IDR & BIT(AMP_ENABLE)) != 0) == is_high; }

/* Initialises the interrupt of the index input. An index pulse is shorter than a tick, so its edge
 * must cause an interrupt. */
static void index_init(void) {
  set_bits(CLOCK_OF_SYSCFG);
  SYSCFG->EXTICR1 = (SYSCFG->EXTICR1 & ~SYSCFG_EXTICR1_EXTI3) | SYSCFG_EXTICR1_EXTI3_PC;
  LINES_RISING |= LINE_OF_INDEX;
  LINES_PENDING = LINE_OF_INDEX;
  LINES_ENABLED |= LINE_OF_INDEX;
  NVIC->IPR2 = FIELD(8, 8, PRIORITY_BUS);
  NVIC->ISER0 = BIT(IRQ_EXTI3);
}

/* Detects an index pulse. A true index pulse lasts as long as A and B are both high, so the index
 * input is still high here. A noise spike has already ended. After EDGES_MAX edges the interrupt is
 * disabled until the next tick. This is done with a register of the core in which a write of 0 has
 * no effect. The mask of the external interrupts is not used for this, because it belongs to
 * several lines and is written only at power-up. */
void index_interrupt(void) {
  LINES_PENDING = LINE_OF_INDEX; /* writing 1 to a bit of this register clears the pending edge */
  if ((GPIOA->IDR & TRACKS) == TRACKS && (GPIOC->IDR & BIT(INDEX)) != 0) {
    pulses++;
  }
  edges++;
  if (edges >= EDGES_MAX) {
    NVIC->ICER0 = BIT(IRQ_EXTI3);
  }
  HANDLER_END();
}

/* Returns true if there was an index pulse since the last call. The interrupt may occur between any
 * two instructions. A pulse that is counted after the read of the number is reported in the next
 * tick. */
static bool index_was_seen(void) {
  const uint8_t now = pulses;
  const bool seen = now != pulses_seen;
  pulses_seen = now;
  edges = 0;
  NVIC->ISER0 = BIT(IRQ_EXTI3);
  return seen;
}

void pins_init(void) {
  pins_write(false, false);
  pin_mode(GPIOB, AMP_ENABLE, PIN_OUTPUT, PIN_PULL_NONE);
  pin_mode(GPIOB, BRAKE_RELEASE, PIN_OUTPUT, PIN_PULL_NONE);
  pins_write_digital(0);
  for (uint8_t i = 0; i < DIGITALS; i++) {
    pin_mode(DIGITAL_PORT, (uint8_t)(DIGITAL_FIRST + i), PIN_OUTPUT, PIN_PULL_NONE);
  }
  for (uint8_t pin = ENABLE; pin <= INDEX; pin++) {
    pin_mode(GPIOC, pin, PIN_INPUT, PIN_PULL_DOWN);
  }
  pin_mode(GPIOC, HOME, PIN_INPUT, PIN_PULL_DOWN);
  index_init();
  for (uint8_t i = 0; i < STRAPS; i++) {
    pin_mode(GPIOC, (uint8_t)(STRAP_FIRST + i), PIN_INPUT, PIN_PULL_UP);
  }
  pin_mode(GPIOC, STRAP_DYNAMIC, PIN_INPUT, PIN_PULL_UP);
}

/* Reads the options of the board. Call this function only when the pull-up resistors have had time
 * to act. */
void pins_read_options(void) { is_dynamic = (GPIOC->IDR & BIT(STRAP_DYNAMIC)) == 0; }

uint8_t pins_din(void) {
  const uint32_t levels = GPIOC->IDR;
  return (uint8_t)((((levels & BIT(ENABLE)) != 0) ? AXIS_DIGITAL_INPUTS_ENABLE : 0) |
                   (((levels & BIT(LIMIT_POS)) == 0) ? AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE : 0) |
                   (((levels & BIT(LIMIT_NEG)) == 0) ? AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE : 0) |
                   (((levels & BIT(HOME)) != 0) ? AXIS_DIGITAL_INPUTS_HOME : 0) |
                   (index_was_seen() ? AXIS_DIGITAL_INPUTS_INDEX : 0));
}

uint8_t pins_node_id(void) {
  return (uint8_t)((~GPIOC->IDR & MASK(STRAP_FIRST, STRAPS)) >> STRAP_FIRST);
}
