#ifndef FIRMWARE_PORT_STM32G4_CHIP_H_
#define FIRMWARE_PORT_STM32G4_CHIP_H_

/* Properties of this chip for the files in ../stm32: registers that other chips do not have in the
 * same form, and the use of the pins. */

#include "firmware/port/stm32g4/registers.h"

#define CHIP_HARDWARE "stm32g474"

/* Arguments of set_bits() that enable the clocks of peripherals or other functions. */
#define CLOCK_OF_PORTS \
  &RCC->AHB2ENR, RCC_AHB2ENR_GPIOAEN | RCC_AHB2ENR_GPIOBEN | RCC_AHB2ENR_GPIOCEN
#define CLOCK_OF_CRC &RCC->AHB1ENR, RCC_AHB1ENR_CRCEN
#define CLOCK_OF_TIM2 &RCC->APB1ENR1, RCC_APB1ENR1_TIM2EN
#define CLOCK_OF_TIM4 &RCC->APB1ENR1, RCC_APB1ENR1_TIM4EN
#define CLOCK_OF_TIM5 &RCC->APB1ENR1, RCC_APB1ENR1_TIM5EN
#define CLOCK_OF_USART2 &RCC->APB1ENR1, RCC_APB1ENR1_USART2EN
#define CLOCK_OF_RTC &RCC->APB1ENR1, RCC_APB1ENR1_PWREN | RCC_APB1ENR1_RTCAPBEN
#define CLOCK_OF_SYSCFG &RCC->APB2ENR, RCC_APB2ENR_SYSCFGEN
#define ACCESS_OF_BACKUP &PWR->CR1, PWR_CR1_DBP

/* Registers and numbers of the external interrupt lines of the inputs. */
#define LINES_ENABLED EXTI->IMR1
#define LINES_RISING EXTI->RTSR1
#define LINES_PENDING EXTI->PR1
#define LINE_OF_INDEX EXTI_IMR1_IM3

/* Setting of timer 5: its internal trigger is the trigger output of timer 4. */
#define TRIGGER_OF_TICK TIM_SMCR_TS_ITR3

/* Register with the bits that start the initialisation of the real-time clock. */
#define RTC_INITIALISATION RTC->ICSR
#define RTC_INITIALISATION_INIT RTC_ICSR_INIT
#define RTC_INITIALISATION_INITF RTC_ICSR_INITF

/* Bit that sets the CRC unit to its initial value. */
#define CRC_RESTART CRC_CR_RESET

/* Registers and bits of the serial line. */
#define SERIAL_STATUS USART2->ISR
#define SERIAL_OUT USART2->TDR
#define SERIAL_OVERRUN USART_ISR_ORE
#define SERIAL_RECEIVED USART_ISR_RXNE
#define SERIAL_SENT USART_ISR_TC
#define SERIAL_HAS_ROOM USART_ISR_TXE
#define SERIAL_NINE_BITS USART_CR1_M0

/* Returns the received byte, and clears an overrun error. */
static inline uint8_t serial_take(void) {
  USART2->ICR = USART_ICR_ORECF;
  return (uint8_t)USART2->RDR;
}

/* Pin number, on port B, of the output `driver enable` for an RS-485 transceiver. The pin is high
 * from the first bit to the last bit of a transmission. */
enum { PIN_RS485 = 10 };

/* Digital outputs 1 to 4 are pins PB12 to PB15. */
#define DIGITAL_PORT GPIOB
enum { DIGITAL_FIRST = 12 };

/* Smallest and largest DAC code that the output reaches. The output buffer of the DAC reaches 0.2 V
 * to 3.1 V of 3.3 V. */
enum { DAC_REACH_MIN = 248, DAC_REACH_MAX = 3848 };

/* Converts the stored ADC code of the internal reference to a supply voltage of 3.3 V. This chip
 * stores the code for 3.0 V. */
static inline int32_t reference_at_3_3_v(int32_t stored_code) { return stored_code * 10 / 11; }

/* CAN controllers. The program can also request the interrupt of sent frames itself. */
typedef fdcan_t can_controller_t;
#define CAN_OF_AXIS FDCAN1
#define CAN_OF_DRIVE FDCAN2
static inline void request_sent_interrupt(void) { NVIC->ISPR2 = BIT(IRQ_FDCAN2_IT1 - 64); }

/* flash.c: handler of the NMI. Both the clock security system and the flash request the NMI. */
void flash_nmi(void);

/* flash.c: if the error correction of the flash has corrected an error since the last call, counts
 * this error. Returns the number of counted errors. Call this function once in each tick. */
uint16_t flash_corrected(void);

/* memories.c: the first function of the start-up, which then calls reset(). */
_Noreturn void touch_memories(void);

/* Interrupt handlers for the vectors in startup.c. */
enum { IRQ_LAST = IRQ_FDCAN2_IT1 };
#define CHIP_RESET touch_memories
#define CHIP_NMI flash_nmi
#define CHIP_INTERRUPTS                                             \
  HANDLER(EXCEPTION_IRQ + IRQ_PVD_PVM, supply_interrupt),           \
      HANDLER(EXCEPTION_IRQ + IRQ_EXTI3, index_interrupt),          \
      HANDLER(EXCEPTION_IRQ + IRQ_FDCAN1_IT0, can_interrupt),       \
      HANDLER(EXCEPTION_IRQ + IRQ_TIM4, tick_interrupt),            \
      HANDLER(EXCEPTION_IRQ + IRQ_USART2, serial_interrupt),        \
      HANDLER(EXCEPTION_IRQ + IRQ_FDCAN2_IT0, drive_bus_interrupt), \
      HANDLER(EXCEPTION_IRQ + IRQ_FDCAN2_IT1, drive_bus_sent_interrupt)

#endif
