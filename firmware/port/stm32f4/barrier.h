#ifndef FIRMWARE_PORT_STM32F4_BARRIER_H_
#define FIRMWARE_PORT_STM32F4_BARRIER_H_

/* Memory barrier for the compiler: all earlier writes to memory are done before later accesses.
 * Used between an interrupt and the code that it interrupts. */
#define BARRIER() __asm volatile("" ::: "memory")

#endif
