/* Counts what an emulated Cortex-M4 executes, block by block; called by Unicorn for each of them.
 */
#include <stdint.h>

typedef struct {
  uint64_t base;          /* address of the code */
  const uint32_t *before; /* instructions that begin below each halfword */
  const uint16_t *owner;  /* function that each halfword belongs to */
  uint16_t *longest;      /* bytes of the longest block that was entered at each halfword */
  uint32_t *shares;       /* instructions of each function since they were cleared */
  uint64_t total;
} counter_t;

void count_block(void *engine, uint64_t address, uint32_t size, void *user) {
  counter_t *counter = user;
  const uint64_t at = (address - counter->base) >> 1;
  const uint32_t instructions = counter->before[at + (size >> 1)] - counter->before[at];
  (void)engine;
  if (counter->longest[at] < size) {
    counter->longest[at] = (uint16_t)size;
  }
  counter->shares[counter->owner[at]] += instructions;
  counter->total += instructions;
}
