/* Checks of the memories at start-up: the image in the flash is compared with the CRC that
 * tools/image has appended, and the RAM is tested. */

#include "firmware/port/image.h"
#include "firmware/port/stm32/board.h"

extern const uint32_t vectors_end[];
extern const uint32_t code_begin[];
extern const uint32_t code_end[];

/* Number of words at the end of the stack for which protect.c forbids every access. */
enum { GUARD_WORDS = 8 };

/* CRC of the words from vectors_begin to vectors_end and from code_begin to code_end. It is the CRC
 * that the CRC unit of the chip computes: polynomial 0x04C11DB7, initial value all ones, highest
 * bit first. */
__attribute__((section(".image_check"), used)) static const volatile uint32_t image_crc = 0;

/* Adds the words from `at` to `end` to the CRC, four words in each pass of the loop. Each word
 * needs a read and a write. */
static void take(const uint32_t *at, const uint32_t *end) {
  for (; (uintptr_t)end - (uintptr_t)at >= 4 * sizeof(uint32_t); at += 4) {
    CRC->DR = at[0];
    CRC->DR = at[1];
    CRC->DR = at[2];
    CRC->DR = at[3];
  }
  for (; at != end; at++) {
    CRC->DR = *at;
  }
}

bool image_is_whole(void) {
  set_bits(CLOCK_OF_CRC);
  CRC->CR = CRC_RESTART;
  take(vectors_begin, vectors_end);
  take(code_begin, code_end);
  return CRC->DR == image_crc;
}

/* Tests a word of the RAM with two inverse patterns. Returns a word in which each bit is 1 that did
 * not keep both patterns. */
static inline uint32_t stuck_bits(volatile uint32_t *at) {
  const uint32_t before = *at;
  *at = UINT32_C(0x55555555);
  const uint32_t first = *at;
  *at = UINT32_C(0xAAAAAAAA);
  const uint32_t second = *at;
  *at = before;
  return ~(first ^ second);
}

/* Tests each used word of the RAM separately and restores its value afterwards, so that the stack,
 * the variables and an incident are kept. */
bool ram_is_right(void) {
  uint32_t wrong = 0;
  __asm volatile("cpsid i" ::: "memory");
  for (volatile uint32_t *at = stack_bottom + GUARD_WORDS; (uintptr_t)at < (uintptr_t)ram_end;
       at += 2) {
    wrong |= stuck_bits(at);
    wrong |= stuck_bits(at + 1);
  }
  __asm volatile("cpsie i" ::: "memory");
  return wrong == 0;
}
