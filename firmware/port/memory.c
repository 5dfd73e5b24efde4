/* Functions of the C library to which the compiler may add calls that are not in the source. This
 * file defines them, because the image for a board has no C library. */

#include <stddef.h>
#include <stdint.h>

void *memcpy(void *restrict to, const void *restrict from, size_t count);
void *memset(void *to, int value, size_t count);

/* Prevents the compiler from replacing the loop of memcpy() or memset() by a call of the same
 * function. */
#define PLAIN __attribute__((optimize("no-tree-loop-distribute-patterns")))

PLAIN void *memcpy(void *restrict to, const void *restrict from, size_t count) {
  uint8_t *out = to;
  const uint8_t *in = from;
  /* If both addresses are aligned, words are copied instead of bytes, because the tick copies
   * structures. */
  if ((((uintptr_t)out | (uintptr_t)in) & 3u) == 0) {
    for (; count >= 4; count -= 4) {
      *(uint32_t *)(void *)out = *(const uint32_t *)(const void *)in;
      out += 4;
      in += 4;
    }
  }
  while (count > 0) {
    *out++ = *in++;
    count--;
  }
  return to;
}

PLAIN void *memset(void *to, int value, size_t count) {
  uint8_t *out = to;
  while (count > 0) {
    *out++ = (uint8_t)value;
    count--;
  }
  return to;
}
