#ifndef FIRMWARE_PORT_STM32F4_CHIP_H_
#define FIRMWARE_PORT_STM32F4_CHIP_H_

/* Properties of this chip for the files in ../stm32: registers that other chips do not have in the
 * same form, and the use of the pins. */

#include "firmware/port/stm32f4/registers.h"
#include "firmware/storage/record.h"

#define CHIP_HARDWARE "stm32f446"

/* Arguments of set_bits() that enable the clocks of peripherals or other functions. */
#define CLOCK_OF_PORTS \
  &RCC->AHB1ENR, RCC_AHB1ENR_GPIOAEN | RCC_AHB1ENR_GPIOBEN | RCC_AHB1ENR_GPIOCEN
#define CLOCK_OF_CRC &RCC->AHB1ENR, RCC_AHB1ENR_CRCEN
#define CLOCK_OF_TIM2 &RCC->APB1ENR, RCC_APB1ENR_TIM2EN
#define CLOCK_OF_TIM4 &RCC->APB1ENR, RCC_APB1ENR_TIM4EN
#define CLOCK_OF_TIM5 &RCC->APB1ENR, RCC_APB1ENR_TIM5EN
#define CLOCK_OF_USART2 &RCC->APB1ENR, RCC_APB1ENR_USART2EN
#define CLOCK_OF_RTC &RCC->APB1ENR, RCC_APB1ENR_PWREN
#define CLOCK_OF_SYSCFG &RCC->APB2ENR, RCC_APB2ENR_SYSCFGEN
#define ACCESS_OF_BACKUP &PWR->CR, PWR_CR_DBP

/* Registers and numbers of the external interrupt lines of the inputs. */
#define LINES_ENABLED EXTI->IMR
#define LINES_RISING EXTI->RTSR
#define LINES_PENDING EXTI->PR
#define LINE_OF_INDEX EXTI_IMR_MR3

/* Setting of timer 5: its internal trigger is the trigger output of timer 4. */
#define TRIGGER_OF_TICK TIM_SMCR_TS_ITR2

/* Register with the bits that start the initialisation of the real-time clock. */
#define RTC_INITIALISATION RTC->ISR
#define RTC_INITIALISATION_INIT RTC_ISR_INIT
#define RTC_INITIALISATION_INITF RTC_ISR_INITF

/* Bit that sets the CRC unit to its initial value. */
#define CRC_RESTART CRC_CR_CR

/* Registers and bits of the serial line. */
#define SERIAL_STATUS USART2->SR
#define SERIAL_OUT USART2->DR
#define SERIAL_OVERRUN USART_SR_ORE
#define SERIAL_RECEIVED USART_SR_RXNE
#define SERIAL_SENT USART_SR_TC
#define SERIAL_HAS_ROOM USART_SR_TXE
#define SERIAL_NINE_BITS USART_CR1_M

/* Returns the received byte. Reading the byte also clears an overrun error. */
static inline uint8_t serial_take(void) { return (uint8_t)USART2->DR; }

/* Pin number, on port B, of the output `driver enable` for an RS-485 transceiver. The pin is high
 * from the first bit to the last bit of a transmission. */
enum { PIN_RS485 = 12 };

/* Digital outputs 1 to 4 are pins PA8 to PA11. */
#define DIGITAL_PORT GPIOA
enum { DIGITAL_FIRST = 8 };

/* Smallest and largest DAC code that the output reaches. Without its output buffer the DAC reaches
 * both ends of its range. */
enum { DAC_REACH_MIN = 0, DAC_REACH_MAX = 4095 };

/* Converts the stored ADC code of the internal reference to a supply voltage of 3.3 V. This chip
 * stores the code for 3.3 V. */
static inline int32_t reference_at_3_3_v(int32_t stored_code) { return stored_code; }

/* Addresses and size of the slots for images in the flash. The linker script has the same
 * addresses. */
#define BOARD_SLOT_A UINT32_C(0x08020000)
#define BOARD_SLOT_B UINT32_C(0x08040000)
enum { BOARD_SLOT_BYTES = 0x20000 };

/* Returns 0, because the flash of this chip has no error correction. */
static inline uint16_t flash_corrected(void) { return 0; }

/* flash.c: returns the memory of the slots for images, or NULL if there are no slots. */
const store_memory_t *flash_slots(void);

/* CAN controllers. The program can also request the interrupt of sent frames itself. */
typedef can_t can_controller_t;
#define CAN_OF_AXIS CAN1
#define CAN_OF_DRIVE CAN2
static inline void request_sent_interrupt(void) { NVIC->ISPR1 = BIT(IRQ_CAN2_TX - 32); }

/* Interrupt handlers for the vectors in startup.c. */
enum { IRQ_LAST = IRQ_CAN2_RX0 };
#define CHIP_RESET reset
#define CHIP_NMI board_fail /* the NMI is requested by the clock security system */
#define CHIP_INTERRUPTS                                                    \
  HANDLER(EXCEPTION_IRQ + IRQ_PVD, supply_interrupt),                      \
      HANDLER(EXCEPTION_IRQ + IRQ_EXTI3, index_interrupt),                 \
      HANDLER(EXCEPTION_IRQ + IRQ_DMA1_Stream3, spi_force_read_interrupt), \
      HANDLER(EXCEPTION_IRQ + IRQ_CAN1_RX0, can_interrupt),                \
      HANDLER(EXCEPTION_IRQ + IRQ_TIM4, tick_interrupt),                   \
      HANDLER(EXCEPTION_IRQ + IRQ_USART2, serial_interrupt),               \
      HANDLER(EXCEPTION_IRQ + IRQ_EXTI15_10, spi_force_ready_interrupt),   \
      HANDLER(EXCEPTION_IRQ + IRQ_CAN2_TX, drive_bus_sent_interrupt),      \
      HANDLER(EXCEPTION_IRQ + IRQ_CAN2_RX0, drive_bus_interrupt)

#endif
