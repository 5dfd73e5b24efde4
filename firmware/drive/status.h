#ifndef FIRMWARE_DRIVE_STATUS_H_
#define FIRMWARE_DRIVE_STATUS_H_

/* What the drive reports: its signals in user units, and the statusword. */

#include "firmware/drive/drive_state.h"

/* Computes every signal of the drive after a tick. Counts the ticks for which the target has been
 * reached, and the ticks for which the axis has been at standstill. */
void cia402_observe(cia402_t *drive, const axis_t *axis);

/* Updates only the drive state, the error code and the statusword. Call this function after a write
 * that occurs between two ticks. */
void cia402_show(cia402_t *drive, const axis_t *axis);

#endif
