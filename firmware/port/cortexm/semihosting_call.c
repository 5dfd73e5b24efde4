/* The semihosting call of a Cortex-M, a request to the host. It is the instruction BKPT with the
 * number 0xAB (ARM, "Semihosting for AArch32 and AArch64"). */

#include "firmware/port/emulated/semihosting.h"

int32_t semihosting_call(uint32_t operation, const void *argument) {
  register uint32_t r0 __asm("r0") = operation;
  register const void *r1 __asm("r1") = argument;
  __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
  return (int32_t)r0;
}
