#ifndef FIRMWARE_PORT_STM32F4_BARRIER_H_
#define FIRMWARE_PORT_STM32F4_BARRIER_H_

/* What was written to memory before is there when what comes next is seen: between an interrupt and
 * what it interrupts. */
#define BARRIER() __asm volatile("" ::: "memory")

#endif
