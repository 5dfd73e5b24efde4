#ifndef FIRMWARE_PORT_STM32_BARRIER_H_
#define FIRMWARE_PORT_STM32_BARRIER_H_

/* Memory barrier for the compiler: all writes before the barrier are done before all accesses after
 * the barrier. It protects data that an interrupt and the interrupted program share. */
#define BARRIER() __asm volatile("" ::: "memory")

#endif
