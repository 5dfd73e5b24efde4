#include "firmware/app/board.h"

#include <stddef.h>

#include "firmware/objects/generated/axis_objects_device.h"
#include "firmware/objects/generated/axis_objects_drive.h"

uint16_t board_reset_error(const fw_config_t *config) {
  const uint32_t cause = config->reset_cause;
  if (config->core_fault != NULL) {
    return AXIS_ERROR_CODE_CORE_FAULT;
  }
  if ((cause & (AXIS_RESET_CAUSE_WATCHDOG | AXIS_RESET_CAUSE_WINDOW)) != 0) {
    return AXIS_ERROR_CODE_WATCHDOG_RESET;
  }
  if ((cause & (AXIS_RESET_CAUSE_SOFTWARE | AXIS_RESET_CAUSE_LOW_POWER)) != 0) {
    return AXIS_ERROR_CODE_CORE_FAULT;
  }
  const bool browned_out =
      (cause & AXIS_RESET_CAUSE_BROWN_OUT) != 0 && (cause & AXIS_RESET_CAUSE_POWER) == 0;
  return browned_out ? AXIS_ERROR_CODE_BROWNOUT_RESET : AXIS_ERROR_CODE_NONE;
}

void board_show_reset(fw_t *fw) {
  device_signals_t *signals = &fw->device_signals;
  signals->reset_cause = fw->config.reset_cause;
  if (fw->config.core_fault != NULL) {
    signals->core_fault_pc = fw->config.core_fault->pc;
    signals->core_fault_lr = fw->config.core_fault->lr;
    signals->core_fault_cfsr = fw->config.core_fault->cfsr;
    signals->core_fault_hfsr = fw->config.core_fault->hfsr;
    signals->core_fault_bfar = fw->config.core_fault->bfar;
  }
}

void fw_board(fw_t *fw, uint16_t state, int16_t tick_deviation) {
  enum { KINDS = 4 };
  static const struct {
    uint16_t found;
    uint8_t fault;
  } faults[KINDS] = {
      {AXIS_BOARD_STATE_OPTION_BYTES | AXIS_BOARD_STATE_IMAGE | AXIS_BOARD_STATE_RAM |
           AXIS_BOARD_STATE_CONVERTER,
       AXIS_FAULT_BOARD_UNFIT},
      {AXIS_BOARD_STATE_SUPPLY | AXIS_BOARD_STATE_REFERENCE, AXIS_FAULT_SUPPLY_WRONG},
      {AXIS_BOARD_STATE_TICK, AXIS_FAULT_CLOCK_WRONG},
      {AXIS_BOARD_STATE_DAC | AXIS_BOARD_STATE_ENABLE, AXIS_FAULT_OUTPUT_WRONG},
  };
  const uint32_t faulty =
      ~(uint32_t)(AXIS_BOARD_STATE_CLOCK_INTERNAL | AXIS_BOARD_STATE_TICK_UNKNOWN);
  device_signals_t *signals = &fw->device_signals;
  /* While a fault is latched the outputs are off, so the cause of the fault may end before a client
   * reads board_state. Therefore board_state keeps the detected errors while a fault is latched. */
  const uint32_t before = (fw->axis.signals.fault != AXIS_FAULT_NONE) ? signals->board_state : 0;
  signals->board_state = (uint16_t)(state | (before & faulty));
  signals->tick_deviation = tick_deviation;
  if ((state & faulty) != 0) {
    for (uint8_t i = 0; i < KINDS; i++) {
      if ((state & faults[i].found) != 0) {
        axis_fault(&fw->axis, faults[i].fault);
      }
    }
  }
}

void fw_tick_times(fw_t *fw, uint16_t time_us, uint16_t late_us) {
  device_signals_t *signals = &fw->device_signals;
  if (time_us > signals->tick_time_max) {
    signals->tick_time_max = time_us;
  }
  if (late_us > signals->tick_late_max) {
    signals->tick_late_max = late_us;
  }
}
