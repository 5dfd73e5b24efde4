#include "firmware/cycle/results.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"

/* The linker scripts of the boards contain the size of a cycle_part_t as a number. */
_Static_assert(sizeof(cycle_part_t) == 192, "size of a result");

enum { ROOM_MAX = 255 };

void cycle_results_init(cycle_results_t *results, void *memory, uint32_t bytes) {
  results->parts = memory;
  results->room = 0;
  results->waiting = 0;
  uint32_t left = (memory == NULL) ? 0 : bytes;
  while (left >= sizeof(cycle_part_t) && results->room < ROOM_MAX) {
    results->parts[results->room].number = 0;
    results->room = (uint8_t)(results->room + 1);
    left -= (uint32_t)sizeof(cycle_part_t);
  }
}

/* Returns the address of the stored result of the part with the number `number`, or NULL if there
 * is no such result. If `number` is 0, returns the address of a free entry. */
static cycle_part_t *place_of(const cycle_results_t *results, uint32_t number) {
  for (uint8_t i = 0; i < results->room; i++) {
    if (results->parts[i].number == number) {
      return &results->parts[i];
    }
  }
  return NULL;
}

void cycle_results_add(cycle_results_t *results, const cycle_part_t *part) {
  fx_assert(part->number != 0 && part->elements <= CYCLE_ELEMENTS_MAX &&
            part->verdict < CYCLE_PART_VERDICTS && results->waiting <= results->room);
  cycle_part_t *place = place_of(results, 0);
  if (place != NULL) {
    fx_copy_words(place, part, sizeof(*place));
    results->waiting = (uint8_t)(results->waiting + 1);
  }
}

const cycle_part_t *cycle_results_find(const cycle_results_t *results, uint32_t number) {
  return (number == 0) ? NULL : place_of(results, number);
}

bool cycle_results_acknowledge(cycle_results_t *results, uint32_t number) {
  cycle_part_t *place = (number == 0) ? NULL : place_of(results, number);
  if (place == NULL) {
    return false;
  }
  fx_assert(results->waiting > 0);
  place->number = 0;
  results->waiting = (uint8_t)(results->waiting - 1);
  return true;
}

uint32_t cycle_results_oldest(const cycle_results_t *results) {
  uint32_t oldest = 0;
  for (uint8_t i = 0; i < results->room; i++) {
    const uint32_t number = results->parts[i].number;
    /* The numbers of pressed parts wrap, so their difference modulo 2^32 is compared. */
    if (number != 0 && (oldest == 0 || oldest - number < (uint32_t)INT32_MAX)) {
      oldest = number;
    }
  }
  return oldest;
}

bool cycle_results_have_failed(const cycle_results_t *results) {
  bool failed = false;
  for (uint8_t i = 0; i < results->room; i++) {
    const cycle_part_t *part = &results->parts[i];
    failed = failed || (part->number != 0 && part->verdict != CYCLE_PART_GOOD);
  }
  return failed;
}
