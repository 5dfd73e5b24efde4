#ifndef FIRMWARE_APP_SENSING_H_
#define FIRMWARE_APP_SENSING_H_

/* Tare and calibration of the force sensor: their commands and results, between ticks. */

#include "firmware/app/fw.h"

/* Acts on the commands `tare` and `calibrate`. Returns FW_OK; FW_ERROR_RANGE if the calibration
 * failed, with the reason in calibration_state; or FW_ERROR_BUSY while the store is working. */
int sensing_command(fw_t *fw, uint16_t object);

/* Makes a measured tare active. While the store is working, the tare waits. */
void sensing_serve(fw_t *fw);

#endif
