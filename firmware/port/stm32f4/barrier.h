#ifndef FIRMWARE_PORT_STM32F4_BARRIER_H_
#define FIRMWARE_PORT_STM32F4_BARRIER_H_

/* Memory barrier for the compiler: all writes to memory before the barrier are done before the
 * accesses after it. The barrier is used for data that an interrupt shares with the interrupted
 * program. */
#define BARRIER() __asm volatile("" ::: "memory")

#endif
