#ifndef FIRMWARE_APP_CURVES_H_
#define FIRMWARE_APP_CURVES_H_

/* The curve of the last cycle (firmware/cycle/curve.h) as objects: its steps, the curve as a
 * CANopen domain, and five of its points at a time for buses without long transfers.
 *
 * The curve stays until the next cycle starts. While a cycle runs or is evaluated, it cannot be
 * read: an upload and a write of cycle_curve_first are refused with FW_ERROR_STATE, and an upload
 * that is in progress is aborted when the next curve begins. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw_state.h"

/* Sets the state at power-up: there is no curve. */
void curves_init(fw_t *fw);

/* Adds the samples that were just evaluated to the curve. Their travel is the depth that the
 * evaluation elements use. `first` is cycle.evaluated before the evaluation. Call curves_between()
 * in fw_between() after cycle_mode_between(). */
void curves_between(fw_t *fw, uint8_t first);

/* Check a write to an object and act on it. A write to an object that curves.c does not handle
 * passes. */
int curves_check(const fw_t *fw, uint16_t object);
void curves_written(fw_t *fw, uint16_t object);

/* Returns the size of the curve in bytes, FW_ERROR_STATE or FW_ERROR_NO_DATA. */
int32_t curves_size(const fw_t *fw);

#endif
