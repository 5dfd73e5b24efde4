#ifndef FIRMWARE_APP_SENSING_H_
#define FIRMWARE_APP_SENSING_H_

/* Commands and results of the tare and of the calibration of the force sensor. These functions run
 * between ticks. */

#include "firmware/app/fw_state.h"

/* Executes the command `tare` or `calibrate`. Returns FW_OK; FW_ERROR_RANGE if the calibration
 * failed (calibration_state gives the reason); or FW_ERROR_BUSY while the parameter store is
 * working. */
int sensing_command(fw_t *fw, uint16_t object);

/* Makes a measured tare active as soon as the parameter store is not working. */
void sensing_serve(fw_t *fw);

#endif
