#include <stddef.h>

#include "firmware/port/port.h"
#include "firmware/port/stm32/board.h"

/* Two sectors of the flash. The linker script keeps them free of code. */
typedef struct {
  uint32_t bytes; /* number of bytes of each sector that are used */
  uint32_t base[2];
  uint32_t erase[2]; /* number of each sector, as the value FLASH_CR_SNB_ of the register CR */
} sectors_t;

static const sectors_t store = {
    0x4000, {UINT32_C(0x08004000), UINT32_C(0x08008000)}, {FLASH_CR_SNB_1, FLASH_CR_SNB_2}};
static const sectors_t archive = {
    0x10000, {UINT32_C(0x08010000), UINT32_C(0x08060000)}, {FLASH_CR_SNB_4, FLASH_CR_SNB_7}};
static const sectors_t slots = {
    BOARD_SLOT_BYTES, {BOARD_SLOT_A, BOARD_SLOT_B}, {FLASH_CR_SNB_5, FLASH_CR_SNB_6}};

static const sectors_t *sectors_of(const void *context) { return context; }

/* Converts an address within two sectors to an address of the flash. */
static uint32_t place_of(const void *context, uint32_t address) {
  const sectors_t *sectors = sectors_of(context);
  return (address < sectors->bytes) ? sectors->base[0] + address
                                    : sectors->base[1] + (address - sectors->bytes);
}

#define ERRORS                                                                              \
  (FLASH_SR_OPERR | FLASH_SR_WRPERR | FLASH_SR_PGAERR | FLASH_SR_PGPERR | FLASH_SR_PGSERR | \
   FLASH_SR_RDERR)

/* A busy flash stalls instruction fetches and writes to the register CR (RM0390 3.5, 3.8.5). So if
 * the flash never becomes ready, the watchdog resets the chip. The drive is disabled and the
 * outputs are off at this time. */

/* Largest number of polls during an erase, and number of loops in each poll. A poll takes about
 * 1000 cycles of the core. An erase of 16 KiB typically takes 250 ms, and at most 800 ms. An erase
 * of 128 KiB typically takes 1 s, and at most 2 s. */
enum { ERASE_POLLS_MAX = 420000, ERASE_POLL_LOOPS = 50 };

/* Waits until the flash is ready. Call this function before a write to CR, because such a write
 * stalls the bus while the flash is busy. */
static void await_ready(void) {
  while ((FLASH->SR & FLASH_SR_BSY) != 0) {
  }
}

static void unlock(void) {
  await_ready();
  FLASH->KEYR = FLASH_KEY1;
  FLASH->KEYR = FLASH_KEY2;
  /* Writing 1 to an error bit of the register SR clears it. */
  FLASH->SR = ERRORS;
}

static void lock(void) { FLASH->CR = FLASH_CR_LOCK; }

static void unpack(uint8_t *bytes, uint32_t word) {
  bytes[0] = (uint8_t)word;
  bytes[1] = (uint8_t)(word >> 8);
  bytes[2] = (uint8_t)(word >> 16);
  bytes[3] = (uint8_t)(word >> 24);
}

static void read_bytes(void *context, uint32_t address, uint8_t *bytes, uint32_t count) {
  address = place_of(context, address);
  /* Most reads are complete words at aligned addresses, so whole words are read as far as
   * possible. */
  while (count >= 4 && (address & 3u) == 0) {
    const uint32_t word = *(const volatile uint32_t *)address;
    unpack(bytes, word);
    address += 4;
    bytes += 4;
    count -= 4;
  }
  for (uint32_t i = 0; i < count; i++) {
    bytes[i] = *(const volatile uint8_t *)(address + i);
  }
}

static bool program_word(uint32_t address, uint32_t word) {
  *(volatile uint32_t *)address = word;
  __asm volatile("dsb" ::: "memory");
  await_ready(); /* this takes at most 100 us */
  return (FLASH->SR & ERRORS) == 0;
}

static bool program_bytes(void *context, uint32_t address, const uint8_t *bytes, uint32_t count) {
  const uint32_t place = place_of(context, address);
  bool done = true;
  unlock();
  FLASH->CR = FLASH_CR_PSIZE_32 | FLASH_CR_PG;
  for (uint32_t i = 0; i < count && done; i += 4) {
    const uint32_t word = (uint32_t)bytes[i] | (uint32_t)bytes[i + 1] << 8 |
                          (uint32_t)bytes[i + 2] << 16 | (uint32_t)bytes[i + 3] << 24;
    done = program_word(place + i, word);
  }
  lock();
  return done;
}

/* Erases a sector. The function is in RAM, because during an erase an instruction fetch from the
 * flash stalls the core, and an erase lasts longer than the watchdog time. The drive is disabled.
 * The function masks interrupts, so it feeds the watchdog itself. If an erase does not end within
 * ERASE_POLLS_MAX polls, the function returns to code in the flash. There the core stalls, and the
 * watchdog resets the chip. */
__attribute__((section(".ram_code"), noinline, long_call)) static bool erase_from_ram(
    uint32_t control) {
  bool done = false;
  __asm volatile("cpsid i" ::: "memory");
  /* First the sector and the mode are written, and then the start bit separately (RM0390 3.6.3). */
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
  __asm volatile("cpsie i" ::: "memory");
  return done;
}

/* Empties the data cache, because it may still contain data that were erased. The cache can be
 * emptied only while it is off. */
static void empty_cache(void) {
  const uint32_t access = FLASH->ACR;
  FLASH->ACR = access & ~FLASH_ACR_DCEN;
  FLASH->ACR = (access & ~FLASH_ACR_DCEN) | FLASH_ACR_DCRST;
  FLASH->ACR = access & ~FLASH_ACR_DCEN;
  FLASH->ACR = access;
}

static bool erase_sector(void *context, uint8_t sector) {
  unlock();
  const uint32_t number = sectors_of(context)->erase[sector];
  const bool ended = erase_from_ram(FLASH_CR_PSIZE_32 | FLASH_CR_SER | number);
  const bool done = ended && (FLASH->SR & ERRORS) == 0;
  lock();
  empty_cache();
  return done;
}

static store_memory_t memory_of(const sectors_t *sectors) {
  return (store_memory_t){
      .context = (void *)(uintptr_t)sectors,
      .sector_bytes = sectors->bytes,
      .read = read_bytes,
      .program = program_bytes,
      .erase = erase_sector,
  };
}

const store_memory_t *flash_memory(void) {
  static store_memory_t memory;
  memory = memory_of(&store);
  return &memory;
}

const store_memory_t *flash_archive(void) {
  static store_memory_t memory;
  memory = memory_of(&archive);
  return &memory;
}

const store_memory_t *flash_slots(void) {
  static store_memory_t memory;
  memory = memory_of(&slots);
  return &memory;
}
