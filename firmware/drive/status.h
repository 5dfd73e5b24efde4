#ifndef FIRMWARE_DRIVE_STATUS_H_
#define FIRMWARE_DRIVE_STATUS_H_

/* The outputs of the drive: signals in user units, and the statusword. */

#include "firmware/drive/drive.h"

/* Call it after a tick. It computes every signal of the drive, and counts for how many ticks the
 * target has been reached and the axis has been at standstill. */
void cia402_observe(cia402_t *drive, const axis_t *axis);

/* Call it after a write between ticks. It updates only the drive state, the error code and the
 * statusword. */
void cia402_show(cia402_t *drive, const axis_t *axis);

#endif
