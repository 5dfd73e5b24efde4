#ifndef FIRMWARE_DRIVE_PARAMETERS_H_
#define FIRMWARE_DRIVE_PARAMETERS_H_

/* Parameters of the drive: which values fit one another, and what is derived from them when they
 * are written, because it costs too much for every tick. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/drive/drive.h"

/* What the drive does when it is to stop: 6007h, 605Ah, and what 605Bh to 605Eh have in common. */
enum { ABORT_NOTHING = 0, ABORT_FAULT = 1, ABORT_DISABLE = 2, ABORT_QUICK_STOP = 3 };
enum { QUICK_STOP_DISABLE = 0, QUICK_STOP_SLOW = 1, QUICK_STOP_STAY = 5 };
enum { STOP_AT_ONCE = 0, STOP_SLOW = 1, STOP_QUICK = 2 };

/* Everything that follows from them: units, speeds and accelerations of the trajectory, ratios
 * between per mille of rated_force and counts of the reading, the homing methods on offer. */
void parameters_derive(cia402_t *drive);

/* What follows from the parameter `object` (AXIS_OBJ_), which was changed. True: a target written
 * before does not mean the same any more. */
bool parameters_written(cia402_t *drive, uint16_t object);

#endif
