#ifndef FIRMWARE_APP_SENSING_H_
#define FIRMWARE_APP_SENSING_H_

/* Tare and calibration of the force sensor: their commands and results, between ticks. */

#include "firmware/app/fw.h"

/* The commands `tare` and `calibrate`: FW_OK, FW_ERROR_RANGE where calibration_state says why there
 * is no calibration, FW_ERROR_BUSY while the store is at work. */
int sensing_command(fw_t *fw, uint16_t object);

/* Puts a tare that was found in force; while the store is at work it waits. */
void sensing_serve(fw_t *fw);

#endif
