#ifndef FIRMWARE_APP_RESULTS_H_
#define FIRMWARE_APP_RESULTS_H_

/* Objects for the results of cycles: the results that wait for an acknowledgement, the numbers of
 * good, bad and aborted parts, and the locks that refuse the next cycle.
 *
 * A pressed part is identified by two numbers: the number of the power-up and the number of the
 * part. The parameter store keeps both numbers. The store is written only while the axis is
 * disabled. The number of the power-up is written once, before the first cycle may start. The other
 * counts are written at most every RESULTS_STORE_TICKS, and at once when a lock begins. So after a
 * power cut a part can get the number of an earlier part, but then the number of the power-up
 * differs. The results themselves are in RAM: they survive a reset of the node, but no power cut.
 * After a power cut, cycle_lost_first and cycle_lost_last are the first and the last number of the
 * results that waited when the counts were last stored. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw_state.h"

/* Shortest time between two writes of the counts: 10 minutes. With this time a flash sector of the
 * parameter store lasts for years (storage/store.h). */
enum { RESULTS_STORE_TICKS = 900000 };

/* Sets the state of the results at power-up: no result waits. Do not call results_init() at a reset
 * of the node. */
void results_init(fw_t *fw);

/* Reads the counts of pressed parts from the parameter store. Call this function after each
 * store_load(). */
void results_loaded(fw_t *fw);

/* results_check() checks a write to an object, and results_written() acts on an accepted write.
 * Writes to objects that results.c does not handle are accepted without a check. */
int results_check(const fw_t *fw, uint16_t object, int32_t value);
void results_written(fw_t *fw, uint16_t object, int32_t value);

/* Ends the lock that begins after too many consecutive bad parts, so that cycles may start again.
 * Returns FW_OK. */
int results_unlock(fw_t *fw);

/* When a cycle has just started, assigns to it the serial number that a client has written. If the
 * cycle was stopped before its first tick, writes the serial number back to its objects. Call
 * results_follow() before and after each controlword. */
void results_follow(fw_t *fw);

/* Call results_serve() between ticks while the axis has programs, after the samples of the cycle
 * were evaluated. `ended` is true if the cycle has just ended. */
void results_serve(fw_t *fw, bool ended);

/* Writes to the signal cycle_store_state whether the cycle programs and the counts of pressed parts
 * are stored. */
void results_show_store(fw_t *fw);

#endif
