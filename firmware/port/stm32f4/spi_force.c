/* A converter of the force on SPI2. Each ready conversion causes an interrupt, which starts a
 * transfer by DMA. The interrupt at the end of the transfer processes the reading. */

#include "firmware/port/converter.h"
#include "firmware/port/port.h"
#include "firmware/port/stm32/barrier.h"
#include "firmware/port/stm32/board.h"

/* Pin numbers. The pins of SPI2 are on port B. The pins of chip select and READY are on port C.
 * READY is low while a reading is ready. The pin DOUT/RDY of the AD7193 must be connected to both
 * MISO and READY. */
enum { PIN_SCK = 13, PIN_MISO = 14, PIN_MOSI = 15, FUNCTION_SPI2 = 5 };
enum { PIN_SELECT = 11, PIN_READY = 12 };

/* Settings of the SPI bus. Its clock is 42 MHz / 32 = 1.3 MHz. The ADS1256 permits at most a
 * quarter of its own clock, which is 1.9 MHz. A byte takes 6.1 us. */
#define SPI_BUS (SPI_CR1_MSTR | SPI_CR1_BR_32 | SPI_CR1_SSI | SPI_CR1_SSM | SPI_CR1_CPHA)

#define COUNTS_OF_US (CLOCK_APB1_HZ / 500000)

/* Longest times to wait at power-up, in us. TRANSFER_US: for the transfer of six bytes.
 * CONVERSION_US: for a conversion, including the first settling. */
enum { TRANSFER_US = 100, CONVERSION_US = 2000, AGE_MAX = 255 };

#define FLAGS_IN \
  (DMA_LIFCR_CFEIF3 | DMA_LIFCR_CDMEIF3 | DMA_LIFCR_CTEIF3 | DMA_LIFCR_CHTIF3 | DMA_LIFCR_CTCIF3)
#define FLAGS_OUT \
  (DMA_HIFCR_CFEIF4 | DMA_HIFCR_CDMEIF4 | DMA_HIFCR_CTEIF4 | DMA_HIFCR_CHTIF4 | DMA_HIFCR_CTCIF4)

static uint8_t kind; /* value of the object force_converter; 0: no converter */
static uint8_t sent[CONVERTER_BYTES];
static uint8_t received[CONVERTER_BYTES];
/* state of the force converter; only the interrupt writes this variable */
static converter_t converter;
static volatile uint8_t readings; /* number of readings without an error, modulo 256 */
static volatile uint8_t errors;   /* number of readings with an error, modulo 256 */
static uint8_t seen;              /* value that the counter `readings` had in the last tick */
static uint8_t errors_seen;
static uint8_t age = AGE_MAX;

bool spi_force_is_fitted(void) { return kind != AXIS_FORCE_CONVERTER_ADC; }

/* Begins the exchange of `count` bytes by DMA. The registers of a DMA stream are written while the
 * stream is off and its flags are clear. */
static void begin_transfer(uint8_t count, uint32_t interrupt) {
  DMA1->LIFCR = FLAGS_IN;
  DMA1->HIFCR = FLAGS_OUT;
  DMA1->S3NDTR = count;
  DMA1->S4NDTR = count;
  DMA1->S3CR = DMA_S3CR_MINC | interrupt | DMA_S3CR_EN;
  DMA1->S4CR = DMA_S4CR_MINC | DMA_S4CR_DIR_OUT | DMA_S4CR_EN;
}

static void pause_for(uint32_t us) {
  const uint32_t begin = clock_count();
  while (clock_count() - begin < us * COUNTS_OF_US) {
  }
}

static bool is_ready(void) { return (GPIOC->IDR & BIT(PIN_READY)) == 0; }

static bool wait_for_conversion(void) {
  const uint32_t begin = clock_count();
  while (!is_ready()) {
    if (clock_count() - begin > CONVERSION_US * COUNTS_OF_US) {
      return false;
    }
  }
  return true;
}

static bool do_step(const converter_step_t *step) {
  for (uint8_t i = 0; i < CONVERTER_BYTES; i++) {
    sent[i] = step->sent[i];
    received[i] = 0;
  }
  if (step->after_ready && !wait_for_conversion()) {
    return false;
  }
  BARRIER();
  begin_transfer(step->count, 0);
  const uint32_t begin = clock_count();
  while ((DMA1->LISR & DMA_LISR_TCIF3) == 0) {
    if (clock_count() - begin > TRANSFER_US * COUNTS_OF_US) {
      return false;
    }
  }
  BARRIER();
  pause_for(step->pause_us);
  return converter_is_right(step, received);
}

static bool configure(uint8_t gain) {
  converter_step_t step;
  uint8_t number = 0;
  while (converter_step(kind, gain, number, &step)) {
    if (!do_step(&step)) {
      return false;
    }
    number++;
  }
  return number > 0;
}

static void spi_init(void) {
  RCC->AHB1ENR |= RCC_AHB1ENR_GPIOBEN | RCC_AHB1ENR_GPIOCEN | RCC_AHB1ENR_DMA1EN;
  RCC->APB1ENR |= RCC_APB1ENR_SPI2EN;
  RCC->APB2ENR |= RCC_APB2ENR_SYSCFGEN;
  (void)RCC->APB2ENR;
  /* The clock signal of the ADS1256 is low when it is idle. The clock signal of the AD7193 is high
   * when it is idle. */
  const bool is_high = kind == AXIS_FORCE_CONVERTER_AD7193;
  SPI2->CR1 = SPI_BUS | (is_high ? SPI_CR1_CPOL : 0);
  SPI2->CR2 = SPI_CR2_RXDMAEN | SPI_CR2_TXDMAEN;
  SPI2->CR1 |= SPI_CR1_SPE;
  pin_alternate(GPIOB, PIN_SCK, FUNCTION_SPI2, is_high ? PIN_PULL_UP : PIN_PULL_DOWN);
  pin_alternate(GPIOB, PIN_MISO, FUNCTION_SPI2, PIN_PULL_UP);
  pin_alternate(GPIOB, PIN_MOSI, FUNCTION_SPI2, PIN_PULL_DOWN);
  pin_speed(GPIOB, PIN_SCK, PIN_SPEED_MEDIUM);
  pin_speed(GPIOB, PIN_MOSI, PIN_SPEED_MEDIUM);
  pin_mode(GPIOC, PIN_READY, PIN_INPUT, PIN_PULL_UP);
  DMA1->S3PAR = (uintptr_t)&SPI2->DR;
  DMA1->S4PAR = (uintptr_t)&SPI2->DR;
  DMA1->S3M0AR = (uintptr_t)received;
  DMA1->S4M0AR = (uintptr_t)sent;
  /* Chip select was high, which has reset the interface of the converter. It stays low from now
   * on. */
  GPIOC->BSRR = BIT(PIN_SELECT);
  pin_mode(GPIOC, PIN_SELECT, PIN_OUTPUT, PIN_PULL_NONE);
  pause_for(1);
  GPIOC->BSRR = BIT(PIN_SELECT + 16);
  pause_for(1);
}

bool spi_force_start(const device_params_t *params) {
  kind = params->force_converter;
  if (kind == AXIS_FORCE_CONVERTER_ADC || !io_clock_is_right()) {
    return true;
  }
  spi_init();
  if (!configure(params->force_converter_gain)) {
    return false;
  }
  for (uint8_t i = 0; i < CONVERTER_BYTES; i++) {
    sent[i] = 0;
  }
  SYSCFG->EXTICR4 = (SYSCFG->EXTICR4 & ~SYSCFG_EXTICR4_EXTI12) | SYSCFG_EXTICR4_EXTI12_PC;
  EXTI->FTSR |= EXTI_FTSR_TR12;
  EXTI->PR = EXTI_PR_PR12;
  NVIC->IPR3 = FIELD(16, 8, PRIORITY_BUS);
  NVIC->IPR10 = FIELD(0, 8, PRIORITY_BUS);
  EXTI->IMR |= EXTI_IMR_MR12;
  NVIC->ISER0 = BIT(IRQ_DMA1_Stream3);
  NVIC->ISER1 = BIT(IRQ_EXTI15_10 - 32);
  return true;
}

/* Starts the transfer of a reading. Until the transfer is complete, the edges on READY are data
 * bits of the AD7193. So this interrupt is disabled; as in pins.c, the mask of the external
 * interrupts is not used for this. After the pending bit of an edge was cleared, the request can
 * remain for a short time and cause the interrupt again. If no reading is ready, such an interrupt
 * is ignored. */
void spi_force_ready_interrupt(void) {
  EXTI->PR = EXTI_PR_PR12; /* writing 1 to a bit of this register clears the pending edge */
  if (is_ready()) {
    NVIC->ICER1 = BIT(IRQ_EXTI15_10 - 32);
    begin_transfer(converter_bytes(kind), DMA_S3CR_TCIE);
  }
  HANDLER_END();
}

void spi_force_read_interrupt(void) {
  DMA1->LIFCR = FLAGS_IN;
  if (converter_take(&converter, kind, received)) {
    readings++;
  } else {
    errors++;
  }
  EXTI->PR = EXTI_PR_PR12;
  NVIC->ICPR1 = BIT(IRQ_EXTI15_10 - 32);
  NVIC->ISER1 = BIT(IRQ_EXTI15_10 - 32);
  /* If another conversion became ready meanwhile, its edge has been cleared, so READY is checked
   * here. */
  if (is_ready()) {
    EXTI->SWIER = EXTI_SWIER_SWIER12;
  }
  HANDLER_END();
}

bool spi_force_sample(axis_inputs_t *inputs) {
  const uint8_t now = readings;
  const uint8_t failed = errors;
  if (now != seen) {
    age = 0;
  } else if (age < AGE_MAX) {
    age++;
  }
  const bool is_right = failed == errors_seen;
  seen = now;
  errors_seen = failed;
  inputs->adc_code[0] = converter_adc_code(converter.code, port_firmware()->axis.params.adc_bits);
  inputs->force_age = age;
  return is_right;
}
