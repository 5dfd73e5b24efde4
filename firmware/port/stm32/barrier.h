#ifndef FIRMWARE_PORT_STM32_BARRIER_H_
#define FIRMWARE_PORT_STM32_BARRIER_H_

/* Memory barrier for the compiler: all writes before the barrier are done before all accesses after
 * the barrier. It protects data that an interrupt and the interrupted program share. */
#define BARRIER() __asm volatile("" ::: "memory")

/* Last statement of the handler of an interrupt: a store that is not complete at the return can
 * make the core enter the handler of another interrupt than of the pending one (Arm, Cortex-M4
 * erratum 838869). */
#define HANDLER_END() __asm volatile("dsb" ::: "memory")

#endif
