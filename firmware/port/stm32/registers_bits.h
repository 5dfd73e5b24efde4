#ifndef FIRMWARE_PORT_STM32_REGISTERS_BITS_H_
#define FIRMWARE_PORT_STM32_REGISTERS_BITS_H_

/* Macros for bits and fields of registers. */

#include <stdint.h>

#define BIT(n) (UINT32_C(1) << (n))
/* Word in which the field of `width` bits that begins at bit `at` has the value `value`. */
#define FIELD(at, width, value) ((uint32_t)(value) << (at))
#define MASK(at, width) (((UINT32_C(1) << (width)) - 1u) << (at))

typedef volatile uint32_t reg_t;

#endif
