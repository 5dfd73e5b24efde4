#ifndef FIRMWARE_APP_BOARD_H_
#define FIRMWARE_APP_BOARD_H_

/* Information about the board: the cause of the last reset, read at power-up, and the errors that
 * the board detects in a tick (fw_board(), in fw.h). */

#include "firmware/app/fw.h"

/* Returns the error code of a reset (AXIS_ERROR_CODE_), which is the emergency message at the start
 * and the error of an interrupted incident. Resets by the supply or the reset pin give
 * AXIS_ERROR_CODE_NONE. */
uint16_t board_reset_error(const fw_config_t *config);

/* Sets the signal reset_cause and the signals that describe a fault of the core. */
void board_show_reset(fw_t *fw);

#endif
