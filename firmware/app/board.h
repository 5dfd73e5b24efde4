#ifndef FIRMWARE_APP_BOARD_H_
#define FIRMWARE_APP_BOARD_H_

/* What a board says of itself: what has reset it, at power-up, and what it finds in a tick
 * (fw_board(), in fw.h). */

#include "firmware/app/fw.h"

/* The emergency of a start, and the error of an incident under way: AXIS_ERROR_CODE_ of a reset
 * that neither supply nor pin explains, none of others. */
uint16_t board_reset_error(const fw_config_t *config);

/* reset_cause, and the words of a fault of the core. */
void board_show_reset(fw_t *fw);

#endif
