#ifndef FIRMWARE_APP_CURVES_H_
#define FIRMWARE_APP_CURVES_H_

/* Objects for the curve of the last cycle (firmware/cycle/curve.h): the steps of the curve, the
 * whole curve as a CANopen domain, and five points at a time for buses without long transfers.
 *
 * The curve stays until the next cycle starts. While a cycle runs or is evaluated, it cannot be
 * read: an upload and a write of cycle_curve_first are refused with FW_ERROR_STATE, and an upload
 * that is in progress is aborted when the next curve begins. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/app/fw_state.h"

/* Sets the state of the recorded curve at power-up: there is no curve. */
void curves_init(fw_t *fw);

/* Adds the newly evaluated samples to the curve. The travel of a point of the curve is the same
 * depth that the evaluation elements use. `first` is the value that cycle.evaluated had before
 * these samples were evaluated. Call curves_between() in fw_between() after
 * cycle_mode_between(). */
void curves_between(fw_t *fw, uint8_t first);

/* curves_check() checks a write to an object, and curves_written() acts on an accepted write.
 * Writes to objects that curves.c does not handle are accepted without a check. */
int curves_check(const fw_t *fw, uint16_t object);
void curves_written(fw_t *fw, uint16_t object);

/* Returns the size of the curve in bytes; FW_ERROR_STATE while a cycle runs or is evaluated; or
 * FW_ERROR_NO_DATA if there is no curve. */
int32_t curves_size(const fw_t *fw);

#endif
