#ifndef FIRMWARE_PORT_STM32F4_REGISTERS_H_
#define FIRMWARE_PORT_STM32F4_REGISTERS_H_

/* The registers of the STM32F446 and STM32F405 that the code for this board uses. They have the
 * names of the reference manuals RM0390 and RM0090; registers of the core have the names of the
 * ARMv7-M manual. This file was written for forceaxis. tools/check_svd compares every address,
 * offset and bit with the SVD files (register descriptions) of the vendor.
 *
 * A name <PERIPHERAL>_<REGISTER>_<FIELD> is the mask of a field. A name with _<VALUE> appended is
 * one value of the field. */

#include "firmware/port/stm32/registers_bits.h"
#include "firmware/port/stm32/registers_core.h"

/* Numbers of the interrupts. */

enum {
  IRQ_PVD = 1,
  IRQ_EXTI3 = 9,
  IRQ_DMA1_Stream3 = 14,
  IRQ_CAN1_RX0 = 20,
  IRQ_TIM4 = 30,
  IRQ_USART2 = 38,
  IRQ_EXTI15_10 = 40,
  IRQ_CAN2_TX = 63,
  IRQ_CAN2_RX0 = 64
};

/* Registers of the reset and clock control. */

typedef struct {
  reg_t CR;
  reg_t PLLCFGR;
  reg_t CFGR;
  reg_t unused_0C[9];
  reg_t AHB1ENR;
  reg_t unused_34[3];
  reg_t APB1ENR;
  reg_t APB2ENR;
  reg_t unused_48[10];
  reg_t BDCR;
  reg_t CSR;
} rcc_t;
#define RCC_BASE 0x40023800
#define RCC ((rcc_t *)RCC_BASE)

#define RCC_CR_HSION BIT(0)
#define RCC_CR_HSIRDY BIT(1)
#define RCC_CR_HSEON BIT(16)
#define RCC_CR_HSERDY BIT(17)
#define RCC_CR_HSEBYP BIT(18)
#define RCC_CR_CSSON BIT(19)
#define RCC_CR_PLLON BIT(24)
#define RCC_CR_PLLRDY BIT(25)
#define RCC_PLLCFGR_PLLM_4 FIELD(0, 6, 4)
#define RCC_PLLCFGR_PLLM_8 FIELD(0, 6, 8)
#define RCC_PLLCFGR_PLLN_168 FIELD(6, 9, 168)
#define RCC_PLLCFGR_PLLP_2 FIELD(16, 2, 0)
#define RCC_PLLCFGR_PLLSRC BIT(22)
#define RCC_PLLCFGR_PLLQ_7 FIELD(24, 4, 7)
#define RCC_CFGR_SW MASK(0, 2)
#define RCC_CFGR_SW_PLL FIELD(0, 2, 2)
#define RCC_CFGR_SWS MASK(2, 2)
#define RCC_CFGR_SWS_PLL FIELD(2, 2, 2)
#define RCC_CFGR_PPRE1_4 FIELD(10, 3, 5)
#define RCC_CFGR_PPRE2_2 FIELD(13, 3, 4)
#define RCC_AHB1ENR_GPIOAEN BIT(0)
#define RCC_AHB1ENR_GPIOBEN BIT(1)
#define RCC_AHB1ENR_GPIOCEN BIT(2)
#define RCC_AHB1ENR_CRCEN BIT(12)
#define RCC_AHB1ENR_DMA1EN BIT(21)
#define RCC_APB1ENR_TIM2EN BIT(0)
#define RCC_APB1ENR_TIM4EN BIT(2)
#define RCC_APB1ENR_TIM5EN BIT(3)
#define RCC_APB1ENR_SPI2EN BIT(14)
#define RCC_APB1ENR_USART2EN BIT(17)
#define RCC_APB1ENR_CAN1EN BIT(25)
#define RCC_APB1ENR_CAN2EN BIT(26)
#define RCC_APB1ENR_PWREN BIT(28)
#define RCC_APB1ENR_DACEN BIT(29)
#define RCC_APB2ENR_ADC1EN BIT(8)
#define RCC_APB2ENR_SYSCFGEN BIT(14)

#define RCC_BDCR_RTCSEL MASK(8, 2)
#define RCC_BDCR_RTCSEL_LSI FIELD(8, 2, 2)
#define RCC_BDCR_RTCEN BIT(15)
#define RCC_BDCR_BDRST BIT(16)

#define RCC_CSR_LSION BIT(0)
#define RCC_CSR_LSIRDY BIT(1)
#define RCC_CSR_RMVF BIT(24)

/* Registers of the power control. */

typedef struct {
  reg_t CR;
  reg_t CSR;
} pwr_t;
#define PWR_BASE 0x40007000
#define PWR ((pwr_t *)PWR_BASE)

#define PWR_CR_PVDE BIT(4)
#define PWR_CR_PLS MASK(5, 3)
#define PWR_CR_PLS_7 FIELD(5, 3, 7)
#define PWR_CR_DBP BIT(8)
#define PWR_CSR_PVDO BIT(2)
#define PWR_CSR_VOSRDY BIT(14)

/* Registers of the real-time clock, which is used as the second clock. */

typedef struct {
  reg_t TR;
  reg_t DR;
  reg_t CR;
  reg_t ISR;
  reg_t PRER;
  reg_t unused_14[4];
  reg_t WPR;
  reg_t SSR;
} rtc_t;
#define RTC_BASE 0x40002800
#define RTC ((rtc_t *)RTC_BASE)

#define RTC_CR_BYPSHAD BIT(5)
#define RTC_ISR_INITF BIT(6)
#define RTC_ISR_INIT BIT(7)
#define RTC_PRER_PREDIV_S MASK(0, 15)
#define RTC_SSR_SS MASK(0, 16)
/* Keys that unlock the registers of the real-time clock, in this order. Any other value locks the
 * registers. */
#define RTC_KEY1 UINT32_C(0xCA)
#define RTC_KEY2 UINT32_C(0x53)
#define RTC_KEY_NONE UINT32_C(0xFF)

/* Registers of the CRC unit. */

typedef struct {
  reg_t DR;
  reg_t IDR;
  reg_t CR;
} crc_t;
#define CRC_BASE 0x40023000
#define CRC ((crc_t *)CRC_BASE)

#define CRC_CR_CR BIT(0)

/* Registers of the flash. */

typedef struct {
  reg_t ACR;
  reg_t KEYR;
  reg_t OPTKEYR;
  reg_t SR;
  reg_t CR;
  reg_t OPTCR;
} flash_t;
#define FLASH_BASE 0x40023C00
#define FLASH ((flash_t *)FLASH_BASE)

#define FLASH_ACR_LATENCY MASK(0, 3)
#define FLASH_ACR_LATENCY_5 FIELD(0, 3, 5)
#define FLASH_ACR_PRFTEN BIT(8)
#define FLASH_ACR_ICEN BIT(9)
#define FLASH_ACR_DCEN BIT(10)
#define FLASH_ACR_DCRST BIT(12)
#define FLASH_SR_OPERR BIT(1)
#define FLASH_SR_WRPERR BIT(4)
#define FLASH_SR_PGAERR BIT(5)
#define FLASH_SR_PGPERR BIT(6)
#define FLASH_SR_PGSERR BIT(7)
#define FLASH_SR_RDERR BIT(8) /* The STM32F405 does not have the bit RDERR. */
#define FLASH_SR_BSY BIT(16)
#define FLASH_CR_PG BIT(0)
#define FLASH_CR_SER BIT(1)
#define FLASH_CR_SNB_1 FIELD(3, 4, 1)
#define FLASH_CR_SNB_2 FIELD(3, 4, 2)
#define FLASH_CR_SNB_4 FIELD(3, 4, 4)
#define FLASH_CR_SNB_5 FIELD(3, 4, 5)
#define FLASH_CR_SNB_6 FIELD(3, 4, 6)
#define FLASH_CR_SNB_7 FIELD(3, 4, 7)
#define FLASH_CR_PSIZE_32 FIELD(8, 2, 2)
#define FLASH_CR_STRT BIT(16)
#define FLASH_CR_LOCK BIT(31)
/* Level of the brown-out reset. The value 0 is level 3, at least 2.7 V. The value 3 is off, and is
 * the value in a new chip. */
#define FLASH_OPTCR_BOR_LEV MASK(2, 2)
/* The bit nWRP_0 is 0 if sector 0 is protected from programming and erasing. */
#define FLASH_OPTCR_nWRP_0 BIT(16)
/* If the bit SPRMOD is 1, the bits nWRP select protection from reading as data. The STM32F405 does
 * not have the bit SPRMOD. */
#define FLASH_OPTCR_SPRMOD BIT(31)
/* Keys that unlock FLASH_CR, in this order. */
#define FLASH_KEY1 UINT32_C(0x45670123)
#define FLASH_KEY2 UINT32_C(0xCDEF89AB)

/* Registers of the pins. */

typedef struct {
  reg_t MODER;
  reg_t OTYPER;
  reg_t OSPEEDR;
  reg_t PUPDR;
  reg_t IDR;
  reg_t ODR;
  reg_t BSRR;
  reg_t LCKR;
  reg_t AFRL;
  reg_t AFRH;
} gpio_t;
#define GPIOA_BASE 0x40020000
#define GPIOB_BASE 0x40020400
#define GPIOC_BASE 0x40020800
#define GPIOA ((gpio_t *)GPIOA_BASE)
#define GPIOB ((gpio_t *)GPIOB_BASE)
#define GPIOC ((gpio_t *)GPIOC_BASE)

/* Registers of the external interrupts. Line n is pin n of the GPIO port that SYSCFG selects for
 * this line. */

typedef struct {
  reg_t MEMRM;
  reg_t PMC;
  reg_t EXTICR1;
  reg_t EXTICR2;
  reg_t EXTICR3;
  reg_t EXTICR4;
} syscfg_t;
#define SYSCFG_BASE 0x40013800
#define SYSCFG ((syscfg_t *)SYSCFG_BASE)

#define SYSCFG_EXTICR1_EXTI3 MASK(12, 4)
#define SYSCFG_EXTICR1_EXTI3_PC FIELD(12, 4, 2)
#define SYSCFG_EXTICR4_EXTI12 MASK(0, 4)
#define SYSCFG_EXTICR4_EXTI12_PC FIELD(0, 4, 2)

typedef struct {
  reg_t IMR;
  reg_t EMR;
  reg_t RTSR;
  reg_t FTSR;
  reg_t SWIER;
  reg_t PR;
} exti_t;
#define EXTI_BASE 0x40013C00
#define EXTI ((exti_t *)EXTI_BASE)

#define EXTI_IMR_MR3 BIT(3)
#define EXTI_RTSR_TR3 BIT(3)
#define EXTI_PR_PR3 BIT(3)
#define EXTI_IMR_MR12 BIT(12)
#define EXTI_FTSR_TR12 BIT(12)
#define EXTI_SWIER_SWIER12 BIT(12)
#define EXTI_PR_PR12 BIT(12)
/* Line 16 of the external interrupts is the voltage detector for the supply voltage. */
#define EXTI_IMR_MR16 BIT(16)
#define EXTI_RTSR_TR16 BIT(16)
#define EXTI_PR_PR16 BIT(16)

/* Registers of the timers. Timer 5 counts the encoder, timer 2 is the free-running counter, and
 * timer 4 is the timer of the tick. */

typedef struct {
  reg_t CR1;
  reg_t CR2;
  reg_t SMCR;
  reg_t DIER;
  reg_t SR;
  reg_t EGR;
  reg_t CCMR1;
  reg_t CCMR2;
  reg_t CCER;
  reg_t CNT;
  reg_t PSC;
  reg_t ARR;
  reg_t unused_30;
  reg_t CCR1;
  reg_t CCR2;
  reg_t CCR3;
} tim_t;
#define TIM2_BASE 0x40000000
#define TIM2 ((tim_t *)TIM2_BASE)
#define TIM4_BASE 0x40000800
#define TIM4 ((tim_t *)TIM4_BASE)
#define TIM5_BASE 0x40000C00
#define TIM5 ((tim_t *)TIM5_BASE)

#define TIM_CR1_CEN BIT(0)
/* MMS = 2: the trigger output of the timer is its update event, which is the overflow
 * of the counter. */
#define TIM_CR2_MMS_UPDATE FIELD(4, 3, 2)
#define TIM_SMCR_SMS_ENCODER FIELD(0, 3, 3)
/* TS = 2: timer 5 uses its internal trigger 2, which is the trigger output of timer
 * 4. */
#define TIM_SMCR_TS_ITR2 FIELD(4, 3, 2)
#define TIM_DIER_UIE BIT(0)
#define TIM_SR_UIF BIT(0)
#define TIM_SR_CC3IF BIT(3)
#define TIM_CCMR1_CC1S_TI1 FIELD(0, 2, 1)
#define TIM_CCMR1_IC1F_8 FIELD(4, 4, 3)
#define TIM_CCMR1_CC2S_TI2 FIELD(8, 2, 1)
#define TIM_CCMR1_IC2F_8 FIELD(12, 4, 3)
/* CC3S = 3: channel 3 captures the count at the selected internal trigger. */
#define TIM_CCMR2_CC3S_TRC FIELD(0, 2, 3)
#define TIM_CCER_CC3E BIT(8)

/* Registers of the analog-to-digital converter (ADC). */

typedef struct {
  reg_t SR;
  reg_t CR1;
  reg_t CR2;
  reg_t SMPR1;
  reg_t SMPR2;
  reg_t unused_14[6];
  reg_t SQR1;
  reg_t SQR2;
  reg_t SQR3;
  reg_t JSQR;
  reg_t JDR1;
  reg_t JDR2;
  reg_t JDR3;
  reg_t JDR4;
  reg_t DR;
} adc_t;
#define ADC1_BASE 0x40012000
#define ADC1 ((adc_t *)ADC1_BASE)

typedef struct {
  reg_t CSR;
  reg_t CCR;
} adc_common_t;
#define ADC_COMMON_BASE 0x40012300
#define ADC_COMMON ((adc_common_t *)ADC_COMMON_BASE)

#define ADC_SR_EOC BIT(1)
#define ADC_SR_JEOC BIT(2)
#define ADC_CR1_SCAN BIT(8)
#define ADC_CR1_RES_12 FIELD(24, 2, 0)
#define ADC_CR2_ADON BIT(0)
/* JEXTSEL = 9: the trigger output of timer 4 starts the injected group. */
#define ADC_CR2_JEXTSEL_TIM4_TRGO FIELD(16, 4, 9)
#define ADC_CR2_JEXTEN_RISING FIELD(20, 2, 1)
#define ADC_CR2_SWSTART BIT(30)
#define ADC_SMPR1_SMP17_480 FIELD(21, 3, 7)
#define ADC_SMPR2_SMP4_480 FIELD(12, 3, 7)
#define ADC_SMPR2_SMP6_28 FIELD(18, 3, 2)
#define ADC_SMPR2_SMP7_28 FIELD(21, 3, 2)
#define ADC_SQR3_SQ1_4 FIELD(0, 5, 4)
#define ADC_SQR3_SQ1_17 FIELD(0, 5, 17)
#define ADC_JSQR_JSQ3_6 FIELD(10, 5, 6)
#define ADC_JSQR_JSQ4_7 FIELD(15, 5, 7)
#define ADC_JSQR_JL_2 FIELD(20, 2, 1)
#define ADC_CCR_ADCPRE_4 FIELD(16, 2, 1)
#define ADC_CCR_TSVREFE BIT(23)

/* Registers of the digital-to-analog converter (DAC). */

typedef struct {
  reg_t CR;
  reg_t SWTRIGR;
  reg_t DHR12R1;
  reg_t unused_0C[8];
  reg_t DOR1;
} dac_t;
#define DAC_BASE 0x40007400
#define DAC ((dac_t *)DAC_BASE)

#define DAC_CR_EN1 BIT(0)
#define DAC_CR_BOFF1 BIT(1)
#define DAC_DOR1_DACC1DOR MASK(0, 12)

/* Registers of the CAN controllers. The filters of both controllers are in the registers of
 * CAN1. */

typedef struct {
  reg_t MCR;
  reg_t MSR;
  reg_t TSR;
  reg_t RF0R;
  reg_t RF1R;
  reg_t IER;
  reg_t ESR;
  reg_t BTR;
  reg_t unused_20[88];
  reg_t TI0R; /* first register of the three mailboxes; each mailbox has four registers */
  reg_t TDT0R;
  reg_t TDL0R;
  reg_t TDH0R;
  reg_t TI1R;
  reg_t TDT1R;
  reg_t TDL1R;
  reg_t TDH1R;
  reg_t TI2R;
  reg_t TDT2R;
  reg_t TDL2R;
  reg_t TDH2R;
  reg_t RI0R;
  reg_t RDT0R;
  reg_t RDL0R;
  reg_t RDH0R;
  reg_t unused_1C0[16];
  reg_t FMR;
  reg_t FM1R;
  reg_t unused_208;
  reg_t FS1R;
  reg_t unused_210;
  reg_t FFA1R;
  reg_t unused_218;
  reg_t FA1R;
  reg_t unused_220[8];
  reg_t F0R1;
  reg_t F0R2;
  reg_t unused_248[26];
  reg_t F14R1;
  reg_t F14R2;
} can_t;
#define CAN1_BASE 0x40006400
#define CAN1 ((can_t *)CAN1_BASE)
#define CAN2_BASE 0x40006800
#define CAN2 ((can_t *)CAN2_BASE)

#define CAN_MCR_INRQ BIT(0)
#define CAN_MCR_TXFP BIT(2)
#define CAN_MCR_RFLM BIT(3)
#define CAN_MSR_INAK BIT(0)
#define CAN_TSR_RQCP0 BIT(0)
#define CAN_TSR_ABRQ0 BIT(7)
#define CAN_TSR_RQCP1 BIT(8)
#define CAN_TSR_ABRQ1 BIT(15)
#define CAN_TSR_RQCP2 BIT(16)
#define CAN_TSR_ABRQ2 BIT(23)
#define CAN_TSR_TME0 BIT(26)
#define CAN_TSR_TME1 BIT(27)
#define CAN_TSR_TME2 BIT(28)
#define CAN_RF0R_FMP0 MASK(0, 2)
#define CAN_RF0R_FOVR0 BIT(4)
#define CAN_RF0R_RFOM0 BIT(5)
#define CAN_IER_TMEIE BIT(0)
#define CAN_IER_FMPIE0 BIT(1)
#define CAN_ESR_EPVF BIT(1)
#define CAN_ESR_BOFF BIT(2)
#define CAN_BTR_BRP(divider) FIELD(0, 10, (divider)-1)
#define CAN_BTR_TS1_10 FIELD(16, 4, 9)
#define CAN_BTR_TS1_11 FIELD(16, 4, 10)
#define CAN_BTR_TS2_2 FIELD(20, 3, 1)
#define CAN_BTR_TS2_3 FIELD(20, 3, 2)
#define CAN_BTR_SJW_2 FIELD(24, 2, 1)
#define CAN_BTR_SJW_3 FIELD(24, 2, 2)
#define CAN_TI0R_TXRQ BIT(0)
#define CAN_TI0R_RTR BIT(1)
#define CAN_TI0R_STID(id) FIELD(21, 11, id)
#define CAN_RI0R_RTR BIT(1)
#define CAN_RI0R_IDE BIT(2)
#define CAN_RDT0R_DLC MASK(0, 4)
#define CAN_FMR_FINIT BIT(0)
/* Field with the number of the first filter that belongs to CAN2. */
#define CAN_FMR_CAN2SB MASK(8, 6)
#define CAN_FMR_CAN2SB_14 FIELD(8, 6, 14)
#define CAN_FS1R_FSC0 BIT(0)
#define CAN_FS1R_FSC14 BIT(14)
#define CAN_FA1R_FACT0 BIT(0)
#define CAN_FA1R_FACT14 BIT(14)

/* Registers of the serial peripheral interface (SPI). */

typedef struct {
  reg_t CR1;
  reg_t CR2;
  reg_t SR;
  reg_t DR;
} spi_t;
#define SPI2_BASE 0x40003800
#define SPI2 ((spi_t *)SPI2_BASE)

#define SPI_CR1_CPHA BIT(0)
#define SPI_CR1_CPOL BIT(1)
#define SPI_CR1_MSTR BIT(2)
#define SPI_CR1_BR_32 FIELD(3, 3, 4)
#define SPI_CR1_SPE BIT(6)
#define SPI_CR1_SSI BIT(8)
#define SPI_CR1_SSM BIT(9)
#define SPI_CR2_RXDMAEN BIT(0)
#define SPI_CR2_TXDMAEN BIT(1)

/* Registers of the direct memory access (DMA). In DMA1, with channel 0, stream 3 is the input of
 * SPI2 and stream 4 is its output. */

typedef struct {
  reg_t LISR;
  reg_t HISR;
  reg_t LIFCR;
  reg_t HIFCR;
  reg_t unused_10[18];
  reg_t S3CR;
  reg_t S3NDTR;
  reg_t S3PAR;
  reg_t S3M0AR;
  reg_t unused_68[2];
  reg_t S4CR;
  reg_t S4NDTR;
  reg_t S4PAR;
  reg_t S4M0AR;
} dma_t;
#define DMA1_BASE 0x40026000
#define DMA1 ((dma_t *)DMA1_BASE)

#define DMA_LISR_TCIF3 BIT(27)
#define DMA_LIFCR_CFEIF3 BIT(22)
#define DMA_LIFCR_CDMEIF3 BIT(24)
#define DMA_LIFCR_CTEIF3 BIT(25)
#define DMA_LIFCR_CHTIF3 BIT(26)
#define DMA_LIFCR_CTCIF3 BIT(27)
#define DMA_HIFCR_CFEIF4 BIT(0)
#define DMA_HIFCR_CDMEIF4 BIT(2)
#define DMA_HIFCR_CTEIF4 BIT(3)
#define DMA_HIFCR_CHTIF4 BIT(4)
#define DMA_HIFCR_CTCIF4 BIT(5)
#define DMA_S3CR_EN BIT(0)
#define DMA_S3CR_TCIE BIT(4)
#define DMA_S3CR_MINC BIT(10)
#define DMA_S4CR_EN BIT(0)
#define DMA_S4CR_DIR_OUT FIELD(6, 2, 1)
#define DMA_S4CR_MINC BIT(10)

/* Registers of the serial line. */

typedef struct {
  reg_t SR;
  reg_t DR;
  reg_t BRR;
  reg_t CR1;
  reg_t CR2;
  reg_t CR3;
} usart_t;
#define USART2_BASE 0x40004400
#define USART2 ((usart_t *)USART2_BASE)
#define USART3_BASE 0x40004800
#define USART3 ((usart_t *)USART3_BASE)

#define USART_SR_ORE BIT(3)
#define USART_SR_RXNE BIT(5)
#define USART_SR_TC BIT(6)
#define USART_SR_TXE BIT(7)
#define USART_CR1_RE BIT(2)
#define USART_CR1_TE BIT(3)
#define USART_CR1_RXNEIE BIT(5)
#define USART_CR1_TCIE BIT(6)
#define USART_CR1_TXEIE BIT(7)
#define USART_CR1_PCE BIT(10)
#define USART_CR1_M BIT(12)
#define USART_CR1_UE BIT(13)

/* Address of the unique device ID, which has three words. */
#define UID_BASE 0x1FFF7A10
/* Address of a 16-bit value: the ADC code of the internal reference at a supply voltage of 3.3 V.
 * The manufacturer has measured this code. */
#define VREFINT_CAL_BASE 0x1FFF7A2A

/* Registers of the independent watchdog. */

typedef struct {
  reg_t KR;
  reg_t PR;
  reg_t RLR;
  reg_t SR;
} iwdg_t;
#define IWDG_BASE 0x40003000
#define IWDG ((iwdg_t *)IWDG_BASE)

#define IWDG_SR_PVU BIT(0)
#define IWDG_SR_RVU BIT(1)
#define IWDG_PR_PR_16 FIELD(0, 3, 2)
/* Values that are written to the register KR of the watchdog. */
#define IWDG_KEY_FEED UINT32_C(0xAAAA)
#define IWDG_KEY_ACCESS UINT32_C(0x5555)
#define IWDG_KEY_START UINT32_C(0xCCCC)

#endif
