#ifndef FIRMWARE_APP_INCIDENT_H_
#define FIRMWARE_APP_INCIDENT_H_

/* The black box (core/blackbox.h) in the firmware: its signals, and its objects. It records on
 * buses alone, while the recorder is idle. A recording that is armed ends an incident, and has the
 * buffer until recorder_arm 0. The archive (archive.h) keeps an incident over a power cut. */

#include "firmware/app/fw.h"

/* At power-up, after the recorder; `reset_error`: see blackbox_init(). */
void incident_init(fw_t *fw, uint16_t reset_error);

/* One tick of black box or recorder: the one that has the buffer. */
static inline void incident_tick(fw_t *fw, uint8_t fault) {
  if (fw->boxed != 0) {
    blackbox_tick(fw->config.blackbox, &fw->objects, fault, fw->drive.signals.error_code,
                  fw->axis.signals.tick_count);
  } else {
    recorder_tick(&fw->recorder, &fw->objects);
  }
}

/* Whether one of the two took samples in this tick. */
static inline bool incident_samples(const fw_t *fw) {
  const uint8_t state = fw->recorder.signals.recorder_state;
  return fw->boxed != 0 || state == AXIS_RECORDER_STATE_ARMED ||
         state == AXIS_RECORDER_STATE_RECORDING;
}

/* In fw_between(): starts, follows and shows the black box; CRC of an incident in steps, 1.2 s. */
void incident_serve(fw_t *fw);

/* A recording was armed. */
void incident_yield(fw_t *fw);

/* incident_command: FW_OK, or FW_ERROR_NO_DATA without an incident whose CRC is known; of load
 * without an archived one of this object table, or where the buffer has an incident or recording.
 */
int incident_command(fw_t *fw, int32_t value);

#endif
