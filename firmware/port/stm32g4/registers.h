#ifndef FIRMWARE_PORT_STM32G4_REGISTERS_H_
#define FIRMWARE_PORT_STM32G4_REGISTERS_H_

/* The registers of the STM32G474 that the code for this board uses, with the names of the reference
 * manual RM0440. This file was written for forceaxis. tools/check_svd compares every address,
 * offset and bit with the register description of the vendor in the crate stm32g4.
 *
 * A name <PERIPHERAL>_<REGISTER>_<FIELD> is the mask of a field. A name with _<VALUE> appended is
 * one value of the field. */

#include "firmware/port/stm32/registers_bits.h"
#include "firmware/port/stm32/registers_core.h"

/* Numbers of the interrupts. */

enum {
  IRQ_PVD_PVM = 1,
  IRQ_EXTI3 = 9,
  IRQ_FDCAN1_IT0 = 21,
  IRQ_TIM4 = 30,
  IRQ_USART2 = 38,
  IRQ_FDCAN2_IT0 = 86,
  IRQ_FDCAN2_IT1 = 87
};

/* Registers of the reset and clock control. */

typedef struct {
  reg_t CR;
  reg_t ICSCR;
  reg_t CFGR;
  reg_t PLLCFGR;
  reg_t unused_10[14];
  reg_t AHB1ENR;
  reg_t AHB2ENR;
  reg_t unused_50[2];
  reg_t APB1ENR1;
  reg_t APB1ENR2;
  reg_t APB2ENR;
  reg_t unused_64[9];
  reg_t CCIPR;
  reg_t unused_8C;
  reg_t BDCR;
  reg_t CSR;
} rcc_t;
#define RCC_BASE 0x40021000
#define RCC ((rcc_t *)RCC_BASE)

#define RCC_CR_HSION BIT(8)
#define RCC_CR_HSIRDY BIT(10)
#define RCC_CR_HSEON BIT(16)
#define RCC_CR_HSERDY BIT(17)
#define RCC_CR_HSEBYP BIT(18)
#define RCC_CR_CSSON BIT(19)
#define RCC_CR_PLLON BIT(24)
#define RCC_CR_PLLRDY BIT(25)
#define RCC_CFGR_SW MASK(0, 2)
#define RCC_CFGR_SW_HSI FIELD(0, 2, 1)
#define RCC_CFGR_SW_PLL FIELD(0, 2, 3)
#define RCC_CFGR_SWS MASK(2, 2)
#define RCC_CFGR_SWS_HSI FIELD(2, 2, 1)
#define RCC_CFGR_SWS_PLL FIELD(2, 2, 3)
#define RCC_CFGR_HPRE_2 FIELD(4, 4, 8)
#define RCC_CFGR_PPRE1_4 FIELD(8, 3, 5)
#define RCC_CFGR_PPRE2_2 FIELD(11, 3, 4)
#define RCC_PLLCFGR_PLLSRC_HSI FIELD(0, 2, 2)
#define RCC_PLLCFGR_PLLSRC_HSE FIELD(0, 2, 3)
#define RCC_PLLCFGR_PLLM_4 FIELD(4, 4, 3)
#define RCC_PLLCFGR_PLLM_6 FIELD(4, 4, 5)
#define RCC_PLLCFGR_PLLN_84 FIELD(8, 7, 84)
#define RCC_PLLCFGR_PLLREN BIT(24)
#define RCC_PLLCFGR_PLLR_2 FIELD(25, 2, 0)
#define RCC_AHB1ENR_CRCEN BIT(12)
#define RCC_AHB2ENR_GPIOAEN BIT(0)
#define RCC_AHB2ENR_GPIOBEN BIT(1)
#define RCC_AHB2ENR_GPIOCEN BIT(2)
#define RCC_AHB2ENR_ADC12EN BIT(13)
#define RCC_AHB2ENR_DAC1EN BIT(16)
#define RCC_APB1ENR1_TIM2EN BIT(0)
#define RCC_APB1ENR1_TIM4EN BIT(2)
#define RCC_APB1ENR1_TIM5EN BIT(3)
#define RCC_APB1ENR1_RTCAPBEN BIT(10)
#define RCC_APB1ENR1_USART2EN BIT(17)
#define RCC_APB1ENR1_FDCANEN BIT(25)
#define RCC_APB1ENR1_PWREN BIT(28)
#define RCC_APB2ENR_SYSCFGEN BIT(0)
/* Clock of the CAN controllers. The value 0 is the external crystal, and 2 is the clock of APB1. */
#define RCC_CCIPR_FDCANSEL MASK(24, 2)
#define RCC_CCIPR_FDCANSEL_PCLK1 FIELD(24, 2, 2)
#define RCC_BDCR_RTCSEL MASK(8, 2)
#define RCC_BDCR_RTCSEL_LSI FIELD(8, 2, 2)
#define RCC_BDCR_RTCEN BIT(15)
#define RCC_BDCR_BDRST BIT(16)
#define RCC_CSR_LSION BIT(0)
#define RCC_CSR_LSIRDY BIT(1)
#define RCC_CSR_RMVF BIT(23)

/* Registers of the power control. */

typedef struct {
  reg_t CR1;
  reg_t CR2;
  reg_t CR3;
  reg_t CR4;
  reg_t SR1;
  reg_t SR2;
  reg_t unused_18[26];
  reg_t CR5;
} pwr_t;
#define PWR_BASE 0x40007000
#define PWR ((pwr_t *)PWR_BASE)

#define PWR_CR1_DBP BIT(8)
#define PWR_CR1_VOS MASK(9, 2)
#define PWR_CR1_VOS_RANGE_1 FIELD(9, 2, 1)
#define PWR_CR2_PVDE BIT(0)
#define PWR_CR2_PLS MASK(1, 3)
#define PWR_CR2_PLS_6 FIELD(1, 3, 6)
/* The bit UCPD1_DBDIS disconnects the pull-down resistors of USB Type-C from pins PB4 and PB6. */
#define PWR_CR3_UCPD1_DBDIS BIT(14)
#define PWR_SR2_VOSF BIT(10)
#define PWR_SR2_PVDO BIT(11)
/* If the bit R1MODE is 0, the voltage range is range 1 boost, which is required above 150 MHz. */
#define PWR_CR5_R1MODE BIT(8)

/* Registers of the real-time clock, which is used as the second clock. */

typedef struct {
  reg_t TR;
  reg_t DR;
  reg_t SSR;
  reg_t ICSR;
  reg_t PRER;
  reg_t WUTR;
  reg_t CR;
  reg_t unused_1C[2];
  reg_t WPR;
} rtc_t;
#define RTC_BASE 0x40002800
#define RTC ((rtc_t *)RTC_BASE)

#define RTC_CR_BYPSHAD BIT(5)
#define RTC_ICSR_INITF BIT(6)
#define RTC_ICSR_INIT BIT(7)
#define RTC_PRER_PREDIV_S MASK(0, 15)
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

#define CRC_CR_RESET BIT(0)

/* Registers of the flash. */

typedef struct {
  reg_t ACR;
  reg_t PDKEYR;
  reg_t KEYR;
  reg_t OPTKEYR;
  reg_t SR;
  reg_t CR;
  reg_t ECCR;
  reg_t unused_1C;
  reg_t OPTR;
  reg_t unused_24[2];
  reg_t WRP1AR;
} flash_t;
#define FLASH_BASE 0x40022000
#define FLASH ((flash_t *)FLASH_BASE)

#define FLASH_ACR_LATENCY MASK(0, 4)
#define FLASH_ACR_LATENCY_4 FIELD(0, 4, 4)
#define FLASH_ACR_PRFTEN BIT(8)
#define FLASH_ACR_ICEN BIT(9)
#define FLASH_ACR_DCEN BIT(10)
#define FLASH_ACR_DCRST BIT(12)
#define FLASH_SR_OPERR BIT(1)
#define FLASH_SR_PROGERR BIT(3)
#define FLASH_SR_WRPERR BIT(4)
#define FLASH_SR_PGAERR BIT(5)
#define FLASH_SR_SIZERR BIT(6)
#define FLASH_SR_PGSERR BIT(7)
#define FLASH_SR_MISERR BIT(8)
#define FLASH_SR_FASTERR BIT(9)
#define FLASH_SR_RDERR BIT(14)
#define FLASH_SR_OPTVERR BIT(15)
#define FLASH_SR_BSY BIT(16)
#define FLASH_CR_PG BIT(0)
#define FLASH_CR_PER BIT(1)
#define FLASH_CR_PNB(page) FIELD(3, 7, page)
/* If the bit BKER is 1, the page to be erased is in bank 2. */
#define FLASH_CR_BKER BIT(11)
#define FLASH_CR_STRT BIT(16)
#define FLASH_CR_LOCK BIT(31)
/* Fields of the register of the error correction. ADDR_ECC, BK_ECC and SYSF_ECC: address of a
 * double word with an error, whether it is in bank 2, and whether it is in the system memory. ECCC:
 * one bit of this double word was corrected. ECCD: two of its bits are wrong, which requests an
 * NMI. A write of 1 clears ECCC or ECCD. */
#define FLASH_ECCR_ADDR_ECC MASK(0, 19)
#define FLASH_ECCR_BK_ECC BIT(21)
#define FLASH_ECCR_SYSF_ECC BIT(22)
#define FLASH_ECCR_ECCIE BIT(24)
#define FLASH_ECCR_ECCC BIT(30)
#define FLASH_ECCR_ECCD BIT(31)
/* Fields of the option bytes. BOR_LEV: level of the brown-out reset; 4 is the highest level, 2.8 V,
 * and 0 is 1.7 V, the level in a new chip. BFB2: the chip starts from bank 2. DBANK: the flash has
 * two banks. nSWBOOT0: if 1, pin PB8 selects where the chip starts. Otherwise nBOOT0 selects it;
 * the value 1 selects the flash. */
#define FLASH_OPTR_BOR_LEV MASK(8, 3)
#define FLASH_OPTR_BOR_LEV_4 FIELD(8, 3, 4)
#define FLASH_OPTR_BFB2 BIT(20)
#define FLASH_OPTR_DBANK BIT(22)
/* If the bit SRAM_PE is 1, SRAM1 has no parity. */
#define FLASH_OPTR_SRAM_PE BIT(24)
#define FLASH_OPTR_nSWBOOT0 BIT(26)
#define FLASH_OPTR_nBOOT0 BIT(27)
/* Fields with the numbers of the first and the last page of bank 1 that are protected from
 * programming and erasing. */
#define FLASH_WRP1AR_WRP1A_STRT MASK(0, 7)
#define FLASH_WRP1AR_WRP1A_END MASK(16, 7)
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
#define GPIOA_BASE 0x48000000
#define GPIOB_BASE 0x48000400
#define GPIOC_BASE 0x48000800
#define GPIOA ((gpio_t *)GPIOA_BASE)
#define GPIOB ((gpio_t *)GPIOB_BASE)
#define GPIOC ((gpio_t *)GPIOC_BASE)

/* Registers of the external interrupts. Line n is pin n of the GPIO port that SYSCFG selects for
 * this line. */

typedef struct {
  reg_t MEMRMP;
  reg_t CFGR1;
  reg_t EXTICR1;
} syscfg_t;
#define SYSCFG_BASE 0x40010000
#define SYSCFG ((syscfg_t *)SYSCFG_BASE)

#define SYSCFG_EXTICR1_EXTI3 MASK(12, 4)
#define SYSCFG_EXTICR1_EXTI3_PC FIELD(12, 4, 2)

typedef struct {
  reg_t IMR1;
  reg_t EMR1;
  reg_t RTSR1;
  reg_t FTSR1;
  reg_t SWIER1;
  reg_t PR1;
} exti_t;
#define EXTI_BASE 0x40010400
#define EXTI ((exti_t *)EXTI_BASE)

#define EXTI_IMR1_IM3 BIT(3)
/* Line 16 of the external interrupts is the voltage detector for the supply voltage. */
#define EXTI_IMR1_IM16 BIT(16)
#define EXTI_RTSR1_RT16 BIT(16)
#define EXTI_PR1_PIF16 BIT(16)

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
/* TS = 3: timer 5 uses its internal trigger 3, which is the trigger output of timer
 * 4. */
#define TIM_SMCR_TS_ITR3 FIELD(4, 3, 3)
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

/* Registers of the analog-to-digital converters (ADCs). */

typedef struct {
  reg_t ISR;
  reg_t IER;
  reg_t CR;
  reg_t CFGR;
  reg_t CFGR2;
  reg_t SMPR1;
  reg_t SMPR2;
  reg_t unused_1C[5];
  reg_t SQR1;
  reg_t unused_34[3];
  reg_t DR;
  reg_t unused_44[2];
  reg_t JSQR;
  reg_t unused_50[12];
  reg_t JDR1;
  reg_t JDR2;
} adc_t;
#define ADC1_BASE 0x50000000
#define ADC1 ((adc_t *)ADC1_BASE)
#define ADC2_BASE 0x50000100
#define ADC2 ((adc_t *)ADC2_BASE)

typedef struct {
  reg_t CSR;
  reg_t unused_04;
  reg_t CCR;
} adc_common_t;
#define ADC12_COMMON_BASE 0x50000300
#define ADC12_COMMON ((adc_common_t *)ADC12_COMMON_BASE)

/* Bits of the register ISR of an ADC. Writing 1 to a bit clears it. */
#define ADC_ISR_ADRDY BIT(0)
#define ADC_ISR_EOC BIT(2)
#define ADC_ISR_EOS BIT(3)
#define ADC_ISR_JEOC BIT(5)
#define ADC_ISR_JEOS BIT(6)
#define ADC_CR_ADEN BIT(0)
#define ADC_CR_ADSTART BIT(2)
#define ADC_CR_JADSTART BIT(3)
#define ADC_CR_ADVREGEN BIT(28)
#define ADC_CR_ADCAL BIT(31)
/* If the bit JQDIS is 1, there is no queue of injected groups. */
#define ADC_CFGR_JQDIS BIT(31)
#define ADC_SMPR1_SMP3_47 FIELD(9, 3, 4)
#define ADC_SMPR1_SMP4_47 FIELD(12, 3, 4)
#define ADC_SMPR2_SMP17_640 FIELD(21, 3, 7)
#define ADC_SMPR2_SMP18_640 FIELD(24, 3, 7)
#define ADC_SQR1_SQ1_17 FIELD(6, 5, 17)
#define ADC_SQR1_SQ1_18 FIELD(6, 5, 18)
#define ADC_JSQR_JL_2 FIELD(0, 2, 1)
/* JEXTSEL = 5: the trigger output of timer 4 starts the injected group. */
#define ADC_JSQR_JEXTSEL_TIM4_TRGO FIELD(2, 5, 5)
#define ADC_JSQR_JEXTEN_RISING FIELD(7, 2, 1)
#define ADC_JSQR_JSQ1_3 FIELD(9, 5, 3)
#define ADC_JSQR_JSQ2_4 FIELD(15, 5, 4)
/* CKMODE = 3: the clock of the ADCs is the clock of the bus divided by 4. */
#define ADC_CCR_CKMODE_HCLK_4 FIELD(16, 2, 3)
#define ADC_CCR_VREFEN BIT(22)

/* Registers of the digital-to-analog converter (DAC). */

typedef struct {
  reg_t CR;
  reg_t SWTRGR;
  reg_t DHR12R1;
  reg_t unused_0C[8];
  reg_t DOR1;
  reg_t unused_30[3];
  reg_t MCR;
} dac_t;
#define DAC1_BASE 0x50000800
#define DAC1 ((dac_t *)DAC1_BASE)

#define DAC_CR_EN1 BIT(0)
#define DAC_DOR1_DACC1DOR MASK(0, 12)
/* MODE1 = 0: the output buffer of the DAC drives the pin. */
#define DAC_MCR_MODE1_BUFFER FIELD(0, 3, 0)
/* HFSEL = 2: required if the clock of the bus is above 160 MHz. */
#define DAC_MCR_HFSEL_160 FIELD(14, 2, 2)

/* Registers of the CAN controllers, and their memories for frames. */

typedef struct {
  reg_t CREL;
  reg_t ENDN;
  reg_t unused_08[4];
  reg_t CCCR;
  reg_t NBTP;
  reg_t unused_20[8];
  reg_t ECR;
  reg_t PSR;
  reg_t unused_48[2];
  reg_t IR;
  reg_t IE;
  reg_t ILS;
  reg_t ILE;
  reg_t unused_60[8];
  reg_t RXGFC;
  reg_t unused_84[3];
  reg_t RXF0S;
  reg_t RXF0A;
  reg_t unused_98[10];
  reg_t TXBC;
  reg_t TXFQS;
  reg_t TXBRP;
  reg_t TXBAR;
  reg_t TXBCR;
  reg_t TXBTO;
  reg_t TXBCF;
  reg_t TXBTIE;
} fdcan_t;
#define FDCAN1_BASE 0x40006400
#define FDCAN1 ((fdcan_t *)FDCAN1_BASE)
#define FDCAN2_BASE 0x40006800
#define FDCAN2 ((fdcan_t *)FDCAN2_BASE)

#define FDCAN_CCCR_INIT BIT(0)
#define FDCAN_CCCR_CCE BIT(1)
#define FDCAN_NBTP_NTSEG2(quanta) FIELD(0, 7, (quanta)-1)
#define FDCAN_NBTP_NTSEG1(quanta) FIELD(8, 8, (quanta)-1)
#define FDCAN_NBTP_NBRP(divider) FIELD(16, 9, (divider)-1)
#define FDCAN_NBTP_NSJW(quanta) FIELD(25, 7, (quanta)-1)
#define FDCAN_PSR_ACT MASK(3, 2)
#define FDCAN_PSR_EP BIT(5)
#define FDCAN_PSR_BO BIT(7)
/* Bits of the register IR of a CAN controller. Writing 1 to a bit clears it. */
#define FDCAN_IR_RF0N BIT(0)
#define FDCAN_IR_RF0L BIT(2)
#define FDCAN_IR_TC BIT(7)
#define FDCAN_IE_RF0NE BIT(0)
#define FDCAN_IE_TCE BIT(7)
/* If the bit SMSG is 1, the interrupts of sent frames (TC and TCF) use interrupt line 1. */
#define FDCAN_ILS_SMSG BIT(2)
#define FDCAN_ILE_EINT0 BIT(0)
#define FDCAN_ILE_EINT1 BIT(1)
#define FDCAN_RXGFC_RRFE BIT(0)
#define FDCAN_RXGFC_ANFE_REJECT FIELD(2, 2, 2)
#define FDCAN_RXGFC_ANFS_FIFO_0 FIELD(4, 2, 0)
#define FDCAN_RXF0S_F0FL MASK(0, 4)
#define FDCAN_RXF0S_F0GI MASK(8, 2)
#define FDCAN_TXFQS_TFQPI MASK(16, 2)
#define FDCAN_TXFQS_TFQF BIT(21)
#define FDCAN_TXBRP_TRP MASK(0, 3)
#define FDCAN_TXBTIE_TIE MASK(0, 3)

/* The memory for frames of each controller. It has 28 filters, 8 extended filters, two FIFOs with 3
 * received frames each, 3 events, and 3 frames to send. */
#define FDCAN_MEMORY_BASE 0x4000A400
enum {
  FDCAN_MEMORY_WORDS = 212,
  /* offset in words, in the memory for frames, of the first frame of FIFO 0 */
  FDCAN_MEMORY_RXF0 = 44,
  /* offset in words, in the memory for frames, of the first frame to send */
  FDCAN_MEMORY_TX = 158,
  FDCAN_FRAME_WORDS = 18
};

/* Registers of the serial line. */

typedef struct {
  reg_t CR1;
  reg_t CR2;
  reg_t CR3;
  reg_t BRR;
  reg_t unused_10[3];
  reg_t ISR;
  reg_t ICR;
  reg_t RDR;
  reg_t TDR;
} usart_t;
#define USART2_BASE 0x40004400
#define USART2 ((usart_t *)USART2_BASE)

#define USART_CR1_UE BIT(0)
#define USART_CR1_RE BIT(2)
#define USART_CR1_TE BIT(3)
#define USART_CR1_RXNEIE BIT(5)
#define USART_CR1_TCIE BIT(6)
#define USART_CR1_TXEIE BIT(7)
#define USART_CR1_PCE BIT(10)
#define USART_CR1_M0 BIT(12)
#define USART_ISR_ORE BIT(3)
#define USART_ISR_RXNE BIT(5)
#define USART_ISR_TC BIT(6)
#define USART_ISR_TXE BIT(7)
#define USART_ICR_ORECF BIT(3)

/* Address of the unique device ID, which has three words. */
#define UID_BASE 0x1FFF7590
/* Address of a 16-bit value: the ADC code of the internal reference at a supply voltage of 3.0 V.
 * The manufacturer has measured this code. */
#define VREFINT_CAL_BASE 0x1FFF75AA

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
