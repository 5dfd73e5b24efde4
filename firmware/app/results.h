#ifndef FIRMWARE_APP_RESULTS_H_
#define FIRMWARE_APP_RESULTS_H_

/* The results of cycles as objects: the results that wait for an acknowledgement, the counts of
 * parts, and the locks.
 *
 * A part is identified by the number of the power-up and its own number. Both are counted in the
 * parameter store. The store is written only while the axis is disabled: the power-up once, before
 * the first cycle may start; the other counts at most every RESULTS_STORE_TICKS, and at once when a
 * lock begins. So after a power cut the number of a part can repeat, but in another power-up. The
 * results themselves are in RAM and survive a reset of the node, but no power cut; then
 * cycle_lost_first and cycle_lost_last name those that were known to wait. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw.h"

/* 10 minutes: a sector of the store then lasts for years (storage/store.h). */
enum { RESULTS_STORE_TICKS = 900000 };

/* Sets the state at power-up, not at a reset of the node: no result waits. */
void results_init(fw_t *fw);

/* Takes the stored counts, after each store_load(). */
void results_loaded(fw_t *fw);

/* Check a write to an object and act on it. Other objects of the same part pass. */
int results_check(const fw_t *fw, uint16_t object, int32_t value);
void results_written(fw_t *fw, uint16_t object, int32_t value);

/* Permits cycles again after too many bad parts in a row. Returns FW_OK. */
int results_unlock(fw_t *fw);

/* Takes the serial number for a cycle that has just started, or gives it back if the start was
 * withdrawn. Call results_follow() before and after each controlword. */
void results_follow(fw_t *fw);

/* Call results_serve() between ticks while the axis has programs, after the samples of the cycle
 * were evaluated. `ended` means that the cycle has just ended. */
void results_serve(fw_t *fw, bool ended);

/* Shows whether programs and counts are stored. */
void results_show_store(fw_t *fw);

#endif
