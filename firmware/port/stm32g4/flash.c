/* The memories of the parameter store and of the archive of incidents, in bank 2 of the flash. The
 * program is in bank 1. Bank 1 can be read while bank 2 is erased or programmed.
 *
 * The flash is programmed by double words with error correction. A double word can be programmed
 * only once after an erase. The parameter store programs single words (store_memory_t). So each
 * word of the store uses one double word, whose second half stays erased, and a sector of the store
 * needs twice its size in the flash. */

#include <stddef.h>

#include "firmware/port/port.h"
#include "firmware/port/stm32/barrier.h"
#include "firmware/port/stm32/board.h"

/* Two adjacent sectors of a memory: number of their first page, counted from the begin of bank 2,
 * and number of pages in a sector. */
typedef struct {
  uint32_t first_page;
  uint32_t pages;
} sectors_t;

static const sectors_t store = {0, 16};
static const sectors_t archive = {32, 48};

#define BANK_2 UINT32_C(0x08040000)
enum { PAGE_BYTES = 2048 };

static const sectors_t *sectors_of(const void *context) { return context; }

#define ERRORS                                                                               \
  (FLASH_SR_OPERR | FLASH_SR_PROGERR | FLASH_SR_WRPERR | FLASH_SR_PGAERR | FLASH_SR_SIZERR | \
   FLASH_SR_PGSERR | FLASH_SR_MISERR | FLASH_SR_FASTERR | FLASH_SR_RDERR | FLASH_SR_OPTVERR)

/* Largest number of polls during the erase of a page, and number of loops in each poll. A poll
 * takes about 1000 cycles of the core, which are 6 us. The erase of a page typically takes 22 ms,
 * and at most 25 ms. */
enum { ERASE_POLLS_MAX = 8400, ERASE_POLL_LOOPS = 50 };

/* State of the function read_word(). IDLE: it does not run. ASKED: it reads a double word of bank
 * 2. DAMAGED: the double word has two wrong bits. */
enum { IDLE, ASKED, DAMAGED };
static volatile uint8_t reading;

uint16_t flash_corrected(void) {
  static uint16_t count;
  if ((FLASH->ECCR & FLASH_ECCR_ECCC) != 0) {
    FLASH->ECCR = FLASH_ECCR_ECCC; /* writing 1 to the flag ECCC clears it */
    count = (uint16_t)((count < UINT16_MAX) ? count + 1 : UINT16_MAX);
  }
  return count;
}

/* Handles two wrong bits in a double word of the flash. In bank 2 a power cut during programming or
 * erasing can cause this, so the program continues. In the program memory the same error is treated
 * as a fault of the core. The state of read_word() shows which memory was read. The address in ECCR
 * is not used: it is not updated while one of its flags is set, and may be wrong after an
 * interrupted erase (RM0440 3.3.2, ES0430 2.2.3). */
__attribute__((used)) static void note_damage(void) {
  if (reading != ASKED) {
    board_fail();
  }
  FLASH->ECCR = FLASH_ECCR_ECCD;
  reading = DAMAGED;
}

/* Handles the NMI. If the flag of the error correction is set, the NMI comes from the error
 * correction, otherwise from the clock security system. The present stack may be invalid, so
 * board_fail() is entered without a use of this stack. */
__attribute__((naked)) void flash_nmi(void) {
  __asm volatile(
      "movw r0, #0x2018\n" /* low half of the address of FLASH_ECCR */
      "movt r0, #0x4002\n"
      "ldr r0, [r0]\n"
      "cmp r0, #0\n" /* negative if bit 31 is 1, which is the flag FLASH_ECCR_ECCD */
      "blt note_damage\n"
      "b board_fail\n");
}

/* Waits until the flash is ready. If the flash never becomes ready, the watchdog resets the chip.
 * The drive is disabled and the outputs are off at this time. */
static void await_ready(void) {
  while ((FLASH->SR & FLASH_SR_BSY) != 0) {
  }
}

/* Permits programming of the flash. A write to bank 2 while bank 1 is read can corrupt the data
 * cache (ES0430 2.2.2). So the data cache is off from unlock() to lock(), and lock() empties it. */
static void unlock(void) {
  await_ready();
  FLASH->ACR &= ~FLASH_ACR_DCEN;
  if ((FLASH->CR & FLASH_CR_LOCK) != 0) {
    FLASH->KEYR = FLASH_KEY1;
    FLASH->KEYR = FLASH_KEY2;
  }
  /* A write of 1 clears an error bit of SR. While an error bit is 1, nothing can be programmed. */
  FLASH->SR = ERRORS;
}

static void lock(void) {
  await_ready();
  FLASH->CR = FLASH_CR_LOCK;
  const uint32_t access = FLASH->ACR;
  FLASH->ACR = access | FLASH_ACR_DCRST;
  FLASH->ACR = access;
  FLASH->ACR = access | FLASH_ACR_DCEN;
}

static uint32_t place_of(const sectors_t *sectors, uint32_t address) {
  return BANK_2 + sectors->first_page * PAGE_BYTES + 2 * address;
}

/* Reads a word of a memory. A damaged word reads as 0. This value is not blank, and a record with
 * this value in place of the stored word is not complete. */
static uint32_t read_word(const sectors_t *sectors, uint32_t address) {
  const volatile uint32_t *place = (const volatile uint32_t *)place_of(sectors, address);
  reading = ASKED;
  BARRIER();
  const uint32_t word = *place;
  /* If the read has found an error, the NMI occurs before the next instruction. */
  __asm volatile("dsb\nisb" ::: "memory");
  const bool is_damaged = reading == DAMAGED;
  reading = IDLE;
  return is_damaged ? 0 : word;
}

/* Reads bytes of a memory with the data cache off. The data cache would also read neighbouring
 * double words, and an error could then not be attributed to one of them. */
static void read_bytes(void *context, uint32_t address, uint8_t *bytes, uint32_t count) {
  const uint32_t access = FLASH->ACR;
  FLASH->ACR = access & ~FLASH_ACR_DCEN;
  (void)flash_corrected(); /* Clears the error flag that an earlier read may have left. */
  /* Most reads are complete words at aligned addresses, so whole words are read as far as
   * possible. */
  for (; count >= 4 && (address & 3u) == 0; address += 4, bytes += 4, count -= 4) {
    const uint32_t word = read_word(sectors_of(context), address);
    bytes[0] = (uint8_t)word;
    bytes[1] = (uint8_t)(word >> 8);
    bytes[2] = (uint8_t)(word >> 16);
    bytes[3] = (uint8_t)(word >> 24);
  }
  for (uint32_t at = address; at < address + count; at++) {
    const uint32_t word = read_word(sectors_of(context), at & ~UINT32_C(3));
    bytes[at - address] = (uint8_t)(word >> (8 * (at & 3u)));
  }
  FLASH->ACR = access;
}

/* Programs a double word. This takes at most 125 us. If all bits of `word` are 1, nothing is
 * programmed, because erased memory already reads as ones. */
static bool program_word(uint32_t place, uint32_t word) {
  if (word == UINT32_MAX) {
    return true;
  }
  ((volatile uint32_t *)place)[0] = word;
  __asm volatile("isb" ::: "memory");
  ((volatile uint32_t *)place)[1] = UINT32_MAX;
  __asm volatile("dsb" ::: "memory");
  await_ready();
  return (FLASH->SR & ERRORS) == 0;
}

static bool program_bytes(void *context, uint32_t address, const uint8_t *bytes, uint32_t count) {
  bool done = true;
  unlock();
  FLASH->CR = FLASH_CR_PG;
  for (uint32_t i = 0; i < count && done; i += 4) {
    const uint32_t word = (uint32_t)bytes[i] | (uint32_t)bytes[i + 1] << 8 |
                          (uint32_t)bytes[i + 2] << 16 | (uint32_t)bytes[i + 3] << 24;
    done = program_word(place_of(sectors_of(context), address + i), word);
  }
  lock();
  return done;
}

/* Erases a page of bank 2. The ticks are masked during the erase, so this function feeds the
 * watchdog. */
static bool erase_page(uint32_t page) {
  const uint32_t control = FLASH_CR_PER | FLASH_CR_BKER | FLASH_CR_PNB(page);
  bool done = false;
  FLASH->CR = control;
  FLASH->CR = control | FLASH_CR_STRT;
  __asm volatile("dsb" ::: "memory");
  for (uint32_t polls = 0; polls < ERASE_POLLS_MAX && !done; polls++) {
    done = (FLASH->SR & FLASH_SR_BSY) == 0;
    IWDG->KR = IWDG_KEY_FEED;
    for (uint32_t i = 0; i < ERASE_POLL_LOOPS && !done; i++) {
      __asm volatile(".rept 16; nop; .endr");
    }
  }
  return done && (FLASH->SR & ERRORS) == 0;
}

static bool erase_sector(void *context, uint8_t sector) {
  const sectors_t *sectors = sectors_of(context);
  const uint32_t first = sectors->first_page + sector * sectors->pages;
  bool done = true;
  unlock();
  for (uint32_t page = first; page < first + sectors->pages && done; page++) {
    done = erase_page(page);
  }
  lock();
  return done;
}

/* Returns true if the flash has two banks with the pages that this file assumes. */
static bool has_two_banks(void) {
  return (FLASH->OPTR & (FLASH_OPTR_DBANK | FLASH_OPTR_BFB2)) == FLASH_OPTR_DBANK;
}

static store_memory_t memory_of(const sectors_t *sectors) {
  return (store_memory_t){
      .context = (void *)(uintptr_t)sectors,
      .sector_bytes = sectors->pages * PAGE_BYTES / 2,
      .read = read_bytes,
      .program = program_bytes,
      .erase = erase_sector,
  };
}

const store_memory_t *flash_memory(void) {
  static store_memory_t memory;
  memory = memory_of(&store);
  return has_two_banks() ? &memory : NULL;
}

const store_memory_t *flash_archive(void) {
  static store_memory_t memory;
  memory = memory_of(&archive);
  return has_two_banks() ? &memory : NULL;
}
