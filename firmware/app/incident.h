#ifndef FIRMWARE_APP_INCIDENT_H_
#define FIRMWARE_APP_INCIDENT_H_

/* The black box (core/blackbox.h) in the firmware: its signals and its objects. It records only on
 * buses, and only while the recorder is idle. Arming a recording discards an incident; the
 * recording uses the buffer until recorder_arm becomes 0. The archive (archive.h) keeps an incident
 * over a power cut. */

#include "firmware/app/fw.h"

/* Initialises the black box at power-up, after the recorder; for `reset_error` see
 * blackbox_init(). */
void incident_init(fw_t *fw, uint16_t reset_error);

/* Computes one tick of black box or recorder, whichever uses the buffer. */
static inline void incident_tick(fw_t *fw, uint8_t fault) {
  if (fw->boxed != 0) {
    blackbox_tick(fw->config.blackbox, &fw->objects, fault, fw->drive.signals.error_code,
                  fw->axis.signals.tick_count);
  } else {
    recorder_tick(&fw->recorder, &fw->objects);
  }
}

/* Whether black box or recorder took samples in this tick. */
static inline bool incident_samples(const fw_t *fw) {
  const uint8_t state = fw->recorder.signals.recorder_state;
  return fw->boxed != 0 || state == AXIS_RECORDER_STATE_ARMED ||
         state == AXIS_RECORDER_STATE_RECORDING;
}

/* Call it in fw_between(). It starts and updates the black box and its signals, and computes the
 * CRC of an incident in small steps, 1.2 s in total. */
void incident_serve(fw_t *fw);

/* A recording was armed: the black box gives the buffer to the recorder. */
void incident_yield(fw_t *fw);

/* Acts on a write to incident_command: FW_OK or FW_ERROR_NO_DATA. Every command needs an incident
 * whose CRC is complete, except load: load needs an archived incident of this object table and a
 * buffer without incident or recording. */
int incident_command(fw_t *fw, int32_t value);

#endif
