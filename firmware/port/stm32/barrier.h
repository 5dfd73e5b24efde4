#ifndef FIRMWARE_PORT_STM32_BARRIER_H_
#define FIRMWARE_PORT_STM32_BARRIER_H_

/* Memory barrier for the compiler. All writes before the barrier are done before all accesses after
 * the barrier. The barrier protects data that an interrupt and the interrupted program share. */
#define BARRIER() __asm volatile("" ::: "memory")

/* Last statement of every interrupt handler. If a store is not complete when the handler returns,
 * the core can enter the handler of a wrong interrupt (Arm, Cortex-M4 erratum 838869). */
#define HANDLER_END() __asm volatile("dsb" ::: "memory")

#endif
