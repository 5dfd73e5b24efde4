#ifndef FIRMWARE_APP_BOARD_H_
#define FIRMWARE_APP_BOARD_H_

/* Information about the board: the cause of the last reset, read at power-up, and the errors that
 * the board detects in a tick (fw_board(), in fw.h). */

#include "firmware/app/fw.h"

/* Returns the error code (AXIS_ERROR_CODE_) for the cause of the last reset. The firmware sends
 * this code in the emergency message at power-up and stores the code in an interrupted incident. A
 * reset by the supply or by the reset pin gives AXIS_ERROR_CODE_NONE. */
uint16_t board_reset_error(const fw_config_t *config);

/* Sets the signal reset_cause and the signals that describe a fault of the processor core. */
void board_show_reset(fw_t *fw);

#endif
