#ifndef FIRMWARE_APP_RESULTS_H_
#define FIRMWARE_APP_RESULTS_H_

/* The results of cycles as objects: the results that wait for an acknowledgement, the numbers of
 * good, bad and aborted parts, and the locks that refuse the next cycle.
 *
 * A pressed part is identified by two numbers: that of the power-up and its own. The parameter
 * store keeps both. The store is written only while the axis is disabled: the power-up once, before
 * the first cycle may start; the other counts at most every RESULTS_STORE_TICKS, and at once when a
 * lock begins. So after a power cut a part can get the number of an earlier part, but not together
 * with the same power-up. The results themselves are in RAM: they survive a reset of the node, but
 * no power cut. After a power cut, cycle_lost_first and cycle_lost_last name the results that were
 * known to wait. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw_state.h"

/* Shortest time between two writes of the counts: 10 minutes, with which a sector of the store
 * lasts for years (storage/store.h). */
enum { RESULTS_STORE_TICKS = 900000 };

/* Sets the state at power-up, not at a reset of the node: no result waits. */
void results_init(fw_t *fw);

/* Reads the numbers of parts from the parameter store. Call this function after each
 * store_load(). */
void results_loaded(fw_t *fw);

/* Check a write to an object and act on it. A write to an object that results.c does not handle
 * passes. */
int results_check(const fw_t *fw, uint16_t object, int32_t value);
void results_written(fw_t *fw, uint16_t object, int32_t value);

/* Permits cycles again after too many bad parts in a row. Returns FW_OK. */
int results_unlock(fw_t *fw);

/* Assigns the serial number that a client has written to the cycle that has just started, or
 * returns the number to its objects if the start was withdrawn. Call results_follow() before and
 * after each controlword. */
void results_follow(fw_t *fw);

/* Call results_serve() between ticks while the axis has programs, after the samples of the cycle
 * were evaluated. `ended` means that the cycle has just ended. */
void results_serve(fw_t *fw, bool ended);

/* Writes to cycle_store_state whether cycle programs and counts are stored. */
void results_show_store(fw_t *fw);

#endif
