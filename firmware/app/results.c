#include "firmware/app/results.h"

#include <stddef.h>

#include "firmware/drive/cycle_mode.h"
#include "firmware/fx/bytes.h"

_Static_assert(sizeof(results_counts_t) == STORE_COUNTS_BYTES, "the stored counts");
/* The value of the object cycle_result_verdict is 1 more than the verdict on the evaluation element
 * (CYCLE_GOOD and so on). */
_Static_assert(AXIS_CYCLE_RESULT_VERDICT_GOOD == CYCLE_GOOD + 1 &&
                   AXIS_CYCLE_RESULT_VERDICT_COUNT == CYCLE_VERDICTS + 1,
               "verdicts of elements");
_Static_assert(AXIS_CYCLE_STATE_BAD == AXIS_CYCLE_STATE_GOOD + CYCLE_PART_BAD &&
                   AXIS_CYCLE_STATE_ABORTED == AXIS_CYCLE_STATE_GOOD + CYCLE_PART_ABORTED,
               "verdicts of parts");

/* Returns the result that the objects cycle_result_ show. If there is no such result, the number in
 * the returned result is 0. */
static const cycle_part_t *shown_part(const fw_t *fw) {
  static const cycle_part_t none;
  const uint32_t number = fw->device.cycle_result_number;
  const cycle_part_t *part =
      (number == 0) ? &fw->results.last : cycle_results_find(&fw->results.waiting, number);
  return (part == NULL) ? &none : part;
}

static void show_part(fw_t *fw) {
  device_signals_t *signals = &fw->device_signals;
  const cycle_part_t *part = shown_part(fw);
  const bool exists = part->number != 0;
  signals->cycle_result_part = part->number;
  signals->cycle_result_power_up = part->power_up;
  signals->cycle_result_program_crc = part->program_crc;
  signals->cycle_result_bank_crc = part->bank_crc;
  signals->cycle_result_state =
      exists ? (uint8_t)(AXIS_CYCLE_STATE_GOOD + part->verdict) : (uint8_t)AXIS_CYCLE_STATE_IDLE;
  signals->cycle_result_outcome = part->outcome;
  signals->cycle_result_phase = part->phase;
  signals->cycle_result_begin = part->begin_tick;
  signals->cycle_result_duration = part->ticks;
  signals->cycle_result_invalid = part->invalid;
  for (uint8_t i = 0; i < CYCLE_SERIAL_WORDS; i++) {
    signals->cycle_result_serial[i] = part->serial[i];
  }
  const uint8_t element = fw->device.cycle_result_element;
  const bool has_element = exists && element < part->elements;
  signals->cycle_result_value = has_element ? part->values[element] : 0;
  signals->cycle_result_tick = has_element ? part->found_ticks[element] : 0;
  signals->cycle_result_verdict = has_element ? (uint8_t)(part->verdicts[element] + 1)
                                              : (uint8_t)AXIS_CYCLE_RESULT_VERDICT_NONE;
}

/* Returns the smallest number of a part whose result no client has acknowledged, or 0 if there is
 * no such part. */
static uint32_t oldest_waiting(const fw_t *fw) {
  const uint32_t lost = fw->device_signals.cycle_lost_first;
  return (lost != 0) ? lost : cycle_results_oldest(&fw->results.waiting);
}

static void show_counts(fw_t *fw) {
  const results_counts_t *counts = &fw->results.counts;
  device_signals_t *signals = &fw->device_signals;
  signals->cycle_results_waiting = fw->results.waiting.waiting;
  signals->cycle_number = counts->number;
  signals->cycle_power_up = counts->power_up;
  signals->cycle_parts_good = counts->parts[CYCLE_PART_GOOD];
  signals->cycle_parts_bad = counts->parts[CYCLE_PART_BAD];
  signals->cycle_parts_aborted = counts->parts[CYCLE_PART_ABORTED];
  signals->cycle_bad_in_row = (uint16_t)counts->bad_in_row;
}

/* Clears the result of a pressed part. Its part number becomes 0: it is no result then. */
static void clear_part(cycle_part_t *part) {
  part->number = 0;
  part->power_up = 0;
  part->program_crc = 0;
  part->bank_crc = 0;
  part->begin_tick = 0;
  part->ticks = 0;
  part->invalid = 0;
  part->elements = 0;
  part->verdict = CYCLE_PART_GOOD;
  part->outcome = CYCLE_BY_PROGRAM;
  part->phase = 0;
  for (uint8_t i = 0; i < CYCLE_SERIAL_WORDS; i++) {
    part->serial[i] = 0;
  }
}

static void clear(results_counts_t *counts) {
  counts->power_up = 0;
  counts->number = 0;
  for (uint8_t i = 0; i < CYCLE_PART_VERDICTS; i++) {
    counts->parts[i] = 0;
  }
  counts->oldest_waiting = 0;
  counts->bad_in_row = 0;
}

void results_init(fw_t *fw) {
  results_t *results = &fw->results;
  cycle_results_init(&results->waiting, fw->config.result_memory, fw->config.result_bytes);
  clear_part(&results->last);
  clear(&results->counts);
  clear(&results->stored);
  results->given_tick = 0;
  results->starts = 0;
  results->changed = 0;
  results->urgent = 0;
  results->has_power_up = 0;
  results->is_loaded = 0;
  for (uint8_t i = 0; i < CYCLE_SERIAL_WORDS; i++) {
    results->serial[i] = 0;
  }
}

/* Reads the counts of pressed parts that were stored before this power-up. */
static void take_stored(fw_t *fw) {
  results_counts_t *counts = &fw->results.counts;
  if (store_part_bytes(&fw->store, STORE_COUNTS) == sizeof(*counts)) {
    void *bytes = counts;
    store_part_read(&fw->store, STORE_COUNTS, bytes);
  }
  if (counts->oldest_waiting != 0) {
    fw->device_signals.cycle_lost_first = counts->oldest_waiting;
    fw->device_signals.cycle_lost_last = counts->number;
  }
  if (fw->store.memory != NULL) {
    counts->power_up += 1;
  }
}

void results_loaded(fw_t *fw) {
  if (fw->results.is_loaded == 0) {
    take_stored(fw);
    fw->results.is_loaded = 1;
  }
  /* The field `stored` is the memory with the counts that the parameter store reads. The parameter
   * store also reads it later, when it continues in its other sector. */
  const uint8_t *bytes = (const uint8_t *)(const void *)&fw->results.stored;
  const bool exist = store_part_bytes(&fw->store, STORE_COUNTS) == STORE_COUNTS_BYTES;
  if (exist) {
    store_part_read(&fw->store, STORE_COUNTS, (uint8_t *)(void *)&fw->results.stored);
  }
  store_part_set(&fw->store, STORE_COUNTS,
                 (store_part_t){bytes, exist ? (uint32_t)STORE_COUNTS_BYTES : 0}, false);
  fw->results.starts = fw->drive.signals.cycle_count;
  show_counts(fw);
  show_part(fw);
}

/* Returns true while a result that is not good, or a lost result, waits for its acknowledgement. */
static bool has_failed(const fw_t *fw) {
  return fw->device_signals.cycle_lost_first != 0 ||
         cycle_results_have_failed(&fw->results.waiting);
}

static bool is_locked(const fw_t *fw) {
  const uint16_t most = fw->device.cycle_bad_in_row_max;
  return (fw->device.cycle_lock_on_bad != 0 && has_failed(fw)) ||
         (most != 0 && fw->results.counts.bad_in_row >= most);
}

/* Returns the lock (AXIS_CYCLE_STATE_) that refuses the start of a cycle, or AXIS_CYCLE_STATE_IDLE
 * if a cycle may start. */
static uint8_t lock_of(const fw_t *fw) {
  if (cycle_results_are_full(&fw->results.waiting)) {
    return AXIS_CYCLE_STATE_RESULTS_FULL;
  }
  if (is_locked(fw)) {
    return AXIS_CYCLE_STATE_LOCKED;
  }
  const bool is_counted = fw->store.memory == NULL || fw->results.has_power_up != 0;
  return is_counted ? AXIS_CYCLE_STATE_IDLE : AXIS_CYCLE_STATE_NOT_STORED;
}

static void show_bits(fw_t *fw) {
  const uint8_t state = fw->drive.signals.cycle_state;
  const uint8_t lock = fw->drive.cycle_lock;
  uint32_t bits = 0;
  if (cycle_mode_is_busy(&fw->drive)) {
    bits = AXIS_CYCLE_BITS_BUSY;
  } else if (cycle_mode_can_start(&fw->drive, &fw->axis)) {
    bits = AXIS_CYCLE_BITS_READY;
  }
  if (state >= AXIS_CYCLE_STATE_GOOD && state <= AXIS_CYCLE_STATE_ABORTED) {
    static const uint8_t verdicts[CYCLE_PART_VERDICTS] = {AXIS_CYCLE_BITS_GOOD, AXIS_CYCLE_BITS_BAD,
                                                          AXIS_CYCLE_BITS_ABORTED};
    bits |= verdicts[state - AXIS_CYCLE_STATE_GOOD];
  }
  bits |= (fw->results.waiting.waiting != 0) ? AXIS_CYCLE_BITS_WAITING : 0;
  bits |= (lock == AXIS_CYCLE_STATE_LOCKED) ? AXIS_CYCLE_BITS_LOCKED : 0;
  bits |= (lock == AXIS_CYCLE_STATE_RESULTS_FULL) ? AXIS_CYCLE_BITS_FULL : 0;
  fw->device_signals.cycle_bits = (uint16_t)bits;
}

void results_show_store(fw_t *fw) {
  static const uint8_t states[] = {
      [STORE_PARTS_STORED] = AXIS_CYCLE_STORE_STATE_STORED,
      [STORE_PARTS_WRITING] = AXIS_CYCLE_STORE_STATE_WAITING,
      [STORE_PARTS_FAILED] = AXIS_CYCLE_STORE_STATE_FAILED,
  };
  fw->device_signals.cycle_store_state = (fw->store.memory == NULL)
                                             ? (uint8_t)AXIS_CYCLE_STORE_STATE_NO_MEMORY
                                             : states[store_parts_state(&fw->store)];
}

static void count_part(results_counts_t *counts, uint8_t verdict) {
  /* No pressed part has the number 0, so the number after UINT32_MAX is 1. */
  counts->number = (counts->number == UINT32_MAX) ? 1 : counts->number + 1;
  counts->parts[verdict] += 1;
  counts->bad_in_row = (verdict == CYCLE_PART_GOOD)        ? 0
                       : (counts->bad_in_row < UINT16_MAX) ? counts->bad_in_row + 1
                                                           : UINT16_MAX;
}

static uint8_t verdict_of(const cycle_t *cycle) {
  if (cycle->good != 0) {
    return CYCLE_PART_GOOD;
  }
  return (cycle->outcome == CYCLE_STOPPED) ? CYCLE_PART_ABORTED : CYCLE_PART_BAD;
}

/* Stores the result of the cycle that has just ended. */
static void take_part(fw_t *fw) {
  results_t *results = &fw->results;
  const cycle_t *cycle = &fw->drive.cycle;
  const uint8_t verdict = verdict_of(cycle);
  count_part(&results->counts, verdict);
  cycle_part_t *part = &results->last;
  part->number = results->counts.number;
  part->power_up = results->counts.power_up;
  part->program_crc = cycle_program_crc(cycle->program);
  part->bank_crc = fw->drive.cycle_bank_crc;
  part->begin_tick = cycle->begin_tick;
  part->ticks = cycle->last_tick - cycle->begin_tick;
  part->invalid = cycle->invalid_ticks;
  part->elements = cycle->program->elements;
  part->verdict = verdict;
  part->outcome = cycle->outcome;
  part->phase = (cycle->outcome == CYCLE_BY_PROGRAM) ? cycle->phase : cycle->failed_phase;
  for (uint8_t i = 0; i < CYCLE_SERIAL_WORDS; i++) {
    part->serial[i] = results->serial[i];
  }
  for (uint8_t i = 0; i < part->elements; i++) {
    const cycle_element_result_t result = cycle_result(cycle, i);
    part->values[i] = result.value;
    part->found_ticks[i] = result.found_tick;
    part->verdicts[i] = result.verdict;
  }
  cycle_results_add(&results->waiting, part);
  results->changed = 1;
  results->urgent |= (verdict != CYCLE_PART_GOOD && is_locked(fw)) ? 1 : 0;
  show_counts(fw);
  show_part(fw);
}

/* Copies a serial number to `to` and clears it in `from`. */
static void move_serial(uint32_t to[CYCLE_SERIAL_WORDS], uint32_t from[CYCLE_SERIAL_WORDS]) {
  for (uint8_t i = 0; i < CYCLE_SERIAL_WORDS; i++) {
    to[i] = from[i];
    from[i] = 0;
  }
}

static bool has_serial(const fw_t *fw) {
  uint32_t bits = 0;
  for (uint8_t i = 0; i < CYCLE_SERIAL_WORDS; i++) {
    bits |= fw->device.cycle_serial[i];
  }
  return bits != 0;
}

void results_follow(fw_t *fw) {
  results_t *results = &fw->results;
  const uint32_t started = fw->drive.signals.cycle_count - results->starts;
  if (started == 1) {
    move_serial(results->serial, fw->device.cycle_serial);
  } else if (started != 0 && !has_serial(fw)) {
    /* The start of the cycle was withdrawn, because the cycle was stopped before its first tick. */
    move_serial(fw->device.cycle_serial, results->serial);
  }
  results->starts = fw->drive.signals.cycle_count;
}

/* Returns true if the counts of parts must be written to the parameter store now. `is_given` is
 * true if the store has already tried to write the same counts and has failed. */
static bool are_due(const fw_t *fw, bool is_given) {
  const results_t *results = &fw->results;
  const uint32_t age = fw->axis.signals.tick_count - results->given_tick;
  const bool is_first = results->has_power_up == 0 && !is_given;
  return is_first || results->urgent != 0 ||
         (age >= RESULTS_STORE_TICKS && (is_given || results->changed != 0));
}

/* Passes the counts of pressed parts to the parameter store if they must be written now. */
static void give_counts(fw_t *fw) {
  results_t *results = &fw->results;
  const bool has_failed = store_parts_state(&fw->store) == STORE_PARTS_FAILED;
  const bool is_given = !store_part_is_stored(&fw->store, STORE_COUNTS);
  if (fw->store.memory == NULL || store_is_busy(&fw->store) || (is_given && !has_failed)) {
    return;
  }
  if (!is_given && results->stored.power_up == results->counts.power_up) {
    results->has_power_up = 1;
  }
  if (are_due(fw, is_given)) {
    fx_copy_words(&results->stored, &results->counts, sizeof(results->stored));
    results->stored.oldest_waiting = oldest_waiting(fw);
    results->changed = 0;
    results->urgent = 0;
    results->given_tick = fw->axis.signals.tick_count;
    const void *bytes = &results->stored;
    store_part_set(&fw->store, STORE_COUNTS, (store_part_t){bytes, STORE_COUNTS_BYTES}, true);
  }
}

void results_serve(fw_t *fw, bool ended) {
  results_follow(fw);
  if (ended) {
    take_part(fw);
  }
  give_counts(fw);
  fw->drive.cycle_lock = lock_of(fw);
  show_bits(fw);
}

int results_check(const fw_t *fw, uint16_t object, int32_t value) {
  const uint32_t number = (uint32_t)value;
  if (object == AXIS_OBJ_CYCLE_ACKNOWLEDGE && number > fw->results.counts.number &&
      number != fw->device_signals.cycle_lost_last &&
      cycle_results_find(&fw->results.waiting, number) == NULL) {
    return FW_ERROR_RANGE;
  }
  const bool needs_memory = object == AXIS_OBJ_CYCLE_LOCK_ON_BAD && value != 0;
  return (needs_memory && fw->results.waiting.room == 0) ? FW_ERROR_NO_MEMORY : FW_OK;
}

static void acknowledge(fw_t *fw, uint32_t number) {
  device_signals_t *signals = &fw->device_signals;
  if (cycle_results_acknowledge(&fw->results.waiting, number)) {
    fw->results.changed = 1;
  } else if (number != 0 && number == signals->cycle_lost_last) {
    signals->cycle_lost_first = 0;
    signals->cycle_lost_last = 0;
    fw->results.changed = 1;
  }
  show_counts(fw);
  show_part(fw);
}

void results_written(fw_t *fw, uint16_t object, int32_t value) {
  if (object == AXIS_OBJ_CYCLE_ACKNOWLEDGE) {
    acknowledge(fw, (uint32_t)value);
  } else if (object == AXIS_OBJ_CYCLE_RESULT_NUMBER || object == AXIS_OBJ_CYCLE_RESULT_ELEMENT) {
    show_part(fw);
  }
}

int results_unlock(fw_t *fw) {
  fw->results.counts.bad_in_row = 0;
  fw->results.changed = 1;
  fw->results.urgent = 1;
  show_counts(fw);
  return FW_OK;
}
