#ifndef FIRMWARE_PORT_STM32_REGISTERS_CORE_H_
#define FIRMWARE_PORT_STM32_REGISTERS_CORE_H_

/* Registers of the processor core and of its debug unit. All other registers are in the file
 * registers.h of each chip. */

#include "firmware/port/stm32/registers_bits.h"

/* Debug unit DBGMCU: its registers select the peripherals that stop when a debugger stops the core.
 * Only a power-up resets these registers. */

typedef struct {
  reg_t IDCODE;
  reg_t CR;
  reg_t APB1_FZ;
} dbgmcu_t;
#define DBGMCU_BASE 0xE0042000
#define DBGMCU ((dbgmcu_t *)DBGMCU_BASE)

/* Registers of the processor core, ARMv7-M. */

typedef struct {
  reg_t CSR;
  reg_t RVR;
  reg_t CVR;
} systick_t;
#define SYSTICK_BASE 0xE000E010
#define SYSTICK ((systick_t *)SYSTICK_BASE)

#define SYSTICK_CSR_ENABLE BIT(0)
#define SYSTICK_CSR_TICKINT BIT(1)
#define SYSTICK_CSR_CLKSOURCE BIT(2)
#define SYSTICK_CSR_COUNTFLAG BIT(16)

typedef struct {
  reg_t unused_000[64];
  reg_t ISER0;
  reg_t ISER1;
  reg_t ISER2;
  reg_t unused_10C[29];
  reg_t ICER0;
  reg_t ICER1;
  reg_t unused_188[30];
  reg_t ISPR0;
  reg_t ISPR1;
  reg_t ISPR2;
  reg_t unused_20C[30];
  reg_t ICPR1;
  reg_t unused_288[94];
  reg_t IPR0;
  reg_t unused_404;
  reg_t IPR2;
  reg_t IPR3;
  reg_t unused_410;
  reg_t IPR5;
  reg_t unused_418;
  reg_t IPR7;
  reg_t unused_420;
  reg_t IPR9;
  reg_t IPR10;
  reg_t unused_42C[4];
  reg_t IPR15;
  reg_t IPR16;
  reg_t unused_444[4];
  reg_t IPR21;
} nvic_t;
#define NVIC_BASE 0xE000E000
#define NVIC ((nvic_t *)NVIC_BASE)

typedef struct {
  reg_t CPUID;
  reg_t ICSR;
  reg_t VTOR;
  reg_t AIRCR;
  reg_t SCR;
  reg_t CCR;
  reg_t SHPR1;
  reg_t SHPR2;
  reg_t SHPR3;
  reg_t SHCSR;
  reg_t CFSR;
  reg_t HFSR;
  reg_t DFSR;
  reg_t MMFAR;
  reg_t BFAR;
} scb_t;
#define SCB_BASE 0xE000ED00
#define SCB ((scb_t *)SCB_BASE)

#define SCB_AIRCR_SYSRESETREQ BIT(2)
#define SCB_AIRCR_VECTKEY FIELD(16, 16, 0x05FA)
#define SCB_CCR_DIV_0_TRP BIT(4)
#define SCB_CFSR_MSTKERR BIT(4)
#define SCB_CFSR_STKERR BIT(12)

/* Registers of the memory protection. If several regions contain an address, the region with the
 * highest number applies. */
typedef struct {
  reg_t TYPE;
  reg_t CTRL;
  reg_t RNR;
  reg_t RBAR;
  reg_t RASR;
} mpu_t;
#define MPU_BASE 0xE000ED90
#define MPU ((mpu_t *)MPU_BASE)

#define MPU_CTRL_ENABLE BIT(0)
#define MPU_CTRL_PRIVDEFENA BIT(2)
#define MPU_RASR_ENABLE BIT(0)
/* A region of the memory protection has 2^n bytes. */
#define MPU_RASR_SIZE(n) FIELD(1, 5, (n)-1)
/* Eighths of a region of the memory protection that are not protected, one bit for each eighth. */
#define MPU_RASR_SRD(eighths) FIELD(8, 8, eighths)
#define MPU_RASR_C BIT(17)
#define MPU_RASR_AP_NONE FIELD(24, 3, 0)
#define MPU_RASR_AP_WRITE FIELD(24, 3, 1)
#define MPU_RASR_AP_READ FIELD(24, 3, 5)
#define MPU_RASR_XN BIT(28)

#endif
