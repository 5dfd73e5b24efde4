#include "firmware/port/bus_drive.h"

#include "firmware/objects/generated/axis_objects_device.h"

enum { AGE_MAX = 255 }; /* largest age, in ticks, that the inputs of the axis can contain */

/* Node id of the master on the bus of the drive. If the drive has this node id, the master has the
 * node id MASTER - 1. */
enum { MASTER = 127 };

#define SAME_BIT(name, bit, key, what)                  \
  _Static_assert((bit) == (int)AXIS_DRIVE_LACKS_##name, \
                 "drive_lacks of the object table differs from DRIVE402_OBJECTS");
DRIVE402_OBJECTS(SAME_BIT)
#undef SAME_BIT

bool bus_drive_config(const device_params_t *params, drive402_config_t *config) {
  *config = (drive402_config_t){
      .scale_num = params->drive_target_num,
      .scale_den = params->drive_target_den,
      .target_max = (int32_t)params->drive_target_max,
      .heartbeat_ms = params->drive_heartbeat,
      .heartbeat_timeout_ms = params->drive_heartbeat_timeout,
      .sdo_timeout_ms = params->drive_sdo_timeout,
      .wait_ms = params->drive_wait,
      .quick_stop_ms = params->drive_quick_stop,
      .abort_option = params->drive_abort_option,
      .cycle_ms = (uint8_t)(2 * params->drive_cycle),
      .mode = params->drive_mode,
      .rpdo_type = (params->drive_target_acts == AXIS_DRIVE_TARGET_ACTS_AT_NEXT_SYNC) ? 1 : 255,
      .node_id = params->drive_node_id,
      .own_node_id = (params->drive_node_id == MASTER) ? MASTER - 1 : MASTER,
      .without = params->drive_lacks,
      .differs = params->drive_differs,
      .scale_shift = AXIS_FINE_BITS,
  };
  return params->drive_node_id != 0;
}

uint8_t bus_drive_init(bus_drive_t *drive, const drive402_config_t *config) {
  return drive402_init(&drive->master, config);
}

void bus_drive_sample(const bus_drive_t *drive, axis_inputs_t *inputs) {
  const drive402_feedback_t feedback = drive402_feedback(&drive->master);
  inputs->encoder_cnt = feedback.position_cnt;
  /* While the drive is off, the axis waits with DAC code 0, and no control law uses the position.
   * The position is not known while the master restarts the drive. */
  const uint16_t age = (feedback.on != 0) ? feedback.age_ticks : 0;
  inputs->position_age = (uint8_t)((age < AGE_MAX) ? age : AGE_MAX);
  /* A board with this drive has no other amplifier, so the bit FITTED is 1 even before the drive
   * has answered. A failure of the drive is reported to the axis only while the axis is enabled.
   * When the axis is enabled again, the master has not reset the failure yet. After the reset the
   * drive may be in the state fault for some bus cycles. If the drive stays in this state, the
   * master reports a reason again. */
  const bool fails = feedback.reason != DRIVE402_NONE && drive->was_enabled != 0;
  const bool limits = feedback.limit != 0 || feedback.saturated != 0;
  inputs->drive =
      (uint8_t)(AXIS_DRIVE_REPORT_FITTED | ((feedback.on != 0) ? AXIS_DRIVE_REPORT_ON : 0) |
                (fails ? AXIS_DRIVE_REPORT_FAULT : 0) | (limits ? AXIS_DRIVE_REPORT_LIMIT : 0));
}

void bus_drive_act(bus_drive_t *drive, const axis_outputs_t *outputs) {
  const bool is_fine = drive->master.config->scale_shift == AXIS_FINE_BITS;
  const drive402_command_t command = {
      .target = is_fine ? outputs->dac_fine : outputs->dac_code,
      .enable = outputs->amp_enable,
      .reset = (uint8_t)(outputs->amp_enable != 0 && drive->was_enabled == 0),
  };
  drive->was_enabled = outputs->amp_enable;
  drive402_tick(&drive->master, &command);
}
