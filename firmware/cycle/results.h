#ifndef FIRMWARE_CYCLE_RESULTS_H_
#define FIRMWARE_CYCLE_RESULTS_H_

/* Results of pressed parts. A result waits in memory of the caller until a client acknowledges it.
 * Then its place in this memory is free. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/cycle/program.h"

enum { CYCLE_SERIAL_WORDS = 4 };

/* Verdict on a pressed part. ABORTED: the cycle was stopped from outside. */
enum { CYCLE_PART_GOOD = 0, CYCLE_PART_BAD = 1, CYCLE_PART_ABORTED = 2, CYCLE_PART_VERDICTS = 3 };

/* Result of a pressed part. */
typedef struct {
  uint32_t number;   /* number of the pressed part, from 1 on; 0: there is no result */
  uint32_t power_up; /* number of the power-up in which the part was pressed */
  uint32_t program_crc;
  uint32_t bank_crc;   /* CRC of the filter bank of the force law; 0: no bank was used */
  uint32_t begin_tick; /* tick in which the cycle started */
  uint32_t ticks;      /* duration of the cycle in ticks */
  /* number of ticks without a valid sample (sample.h), in phases whose samples affect the
   * verdict */
  uint32_t invalid;
  uint32_t serial[CYCLE_SERIAL_WORDS];
  int32_t values[CYCLE_ELEMENTS_MAX];       /* values of the evaluation elements, in the units of
                                             * program.h */
  uint32_t found_ticks[CYCLE_ELEMENTS_MAX]; /* tick_count of the sample that gave the value */
  uint8_t verdicts[CYCLE_ELEMENTS_MAX];     /* verdict on each evaluation element, CYCLE_GOOD and so
                                             * on (element.h) */
  uint8_t elements;                         /* number of evaluation elements */
  uint8_t verdict;                          /* verdict on the pressed part, CYCLE_PART_ */
  uint8_t outcome;                          /* how the cycle ended, CYCLE_BY_PROGRAM and so on
                                             * (cycle.h) */
  /* number of the last phase of the cycle, or of the phase in which the cycle failed */
  uint8_t phase;
} cycle_part_t;

typedef struct {
  cycle_part_t *parts; /* array of results; an entry with the part number 0 is free */
  uint8_t room;        /* number of elements of this array, 0 to 255 */
  uint8_t waiting;     /* number of results of pressed parts that wait for their acknowledgement */
} cycle_results_t;

/* Initialises a memory for results of pressed parts. It is empty then. `memory` begins at a
 * multiple of 4; if `memory` is NULL, no result waits. */
void cycle_results_init(cycle_results_t *results, void *memory, uint32_t bytes);

/* Returns true if the memory for the results of pressed parts exists but is full. */
static inline bool cycle_results_are_full(const cycle_results_t *results) {
  return results->room != 0 && results->waiting == results->room;
}

/* Copies the result of a pressed part into a free entry of the memory for results. If there is no
 * free entry, does nothing. */
void cycle_results_add(cycle_results_t *results, const cycle_part_t *part);

/* Returns the waiting result of the part with the number `number`, from 1 on, or NULL if no result
 * of this part waits. */
const cycle_part_t *cycle_results_find(const cycle_results_t *results, uint32_t number);

/* Frees the memory that contains the result of the part with the number `number`. Returns false if
 * no result of this part waits. */
bool cycle_results_acknowledge(cycle_results_t *results, uint32_t number);

/* Returns the smallest number of a pressed part whose result waits, or 0 if no result waits. */
uint32_t cycle_results_oldest(const cycle_results_t *results);

/* Returns true if the result of a bad or aborted pressed part waits for its acknowledgement. */
bool cycle_results_have_failed(const cycle_results_t *results);

#endif
