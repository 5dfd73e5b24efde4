#ifndef FIRMWARE_DRIVE_STATUS_H_
#define FIRMWARE_DRIVE_STATUS_H_

/* The drive's outputs: signals in the user's units, statusword. */

#include "firmware/drive/drive.h"

/* After a tick: every signal, and the durations of the conditions that must last. */
void cia402_observe(cia402_t *drive, const axis_t *axis);

/* State, error code and statusword alone: after a write between ticks. */
void cia402_show(cia402_t *drive, const axis_t *axis);

#endif
