#ifndef FIRMWARE_APP_BOARD_H_
#define FIRMWARE_APP_BOARD_H_

/* Information about the board. The cause of the last reset is read at power-up, and errors of the
 * board are detected in each tick. */

#include "firmware/app/fw_state.h"

/* Returns the error code (AXIS_ERROR_CODE_) for the cause of the last reset. The firmware sends
 * this code in the emergency message at power-up and stores the code in an interrupted incident. A
 * reset by the supply or by the reset pin gives AXIS_ERROR_CODE_NONE. */
uint16_t board_reset_error(const fw_config_t *config);

/* Sets the signal reset_cause and the signals that describe a fault of the processor core. */
void board_show_reset(fw_t *fw);

/* Accepts the errors that the board has detected in its own hardware, as a set of AXIS_BOARD_STATE_
 * bits, and the deviation of the tick length from a second clock in 1/1000. Call fw_board() between
 * fw_prepare() and fw_control(). While an error is detected, fw_board() disables the axis in the
 * same tick with the fault of this error:
 *   board_unfit   OPTION_BYTES, IMAGE, RAM, CONVERTER, which are detected at power-up
 *   supply_wrong  SUPPLY, REFERENCE
 *   clock_wrong   TICK
 *   output_wrong  DAC, ENABLE
 * All other bits are only reported. board_state keeps the detected errors until the axis has no
 * fault. */
void fw_board(fw_t *fw, uint16_t state, int16_t tick_deviation);

/* Accepts two times of a tick in us: its duration, and the delay with which it began. For several
 * ticks, pass the largest duration and the largest delay. tick_time_max and tick_late_max keep the
 * largest values. Call fw_tick_times() between two ticks. */
void fw_tick_times(fw_t *fw, uint16_t time_us, uint16_t late_us);

#endif
