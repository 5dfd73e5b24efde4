#ifndef FIRMWARE_APP_INCIDENT_H_
#define FIRMWARE_APP_INCIDENT_H_

/* Functions for the signals and objects of the black box (core/blackbox.h). The black box records
 * only if the axis is on a bus, and only while the recorder is idle. If a recording is armed, an
 * incident in the black box is discarded, and the recorder uses the buffer until recorder_arm
 * becomes 0. The archive (archive.h) keeps an incident over a power cut. */

#include "firmware/app/fw_state.h"

/* Initialises the black box at power-up; the recorder must be initialised before. blackbox_init()
 * describes `reset_error`. */
void incident_init(fw_t *fw, uint16_t reset_error);

/* Computes one tick of the black box if the black box uses the buffer, otherwise one tick of the
 * recorder. */
static inline void incident_tick(fw_t *fw, uint8_t fault) {
  if (fw->boxed != 0) {
    blackbox_tick(fw->config.blackbox, &fw->objects, fault, fw->drive.signals.error_code,
                  fw->axis.signals.tick_count);
  } else {
    recorder_tick(&fw->recorder, &fw->objects);
  }
}

/* Returns true if the black box or the recorder took samples in this tick. */
static inline bool incident_samples(const fw_t *fw) {
  const uint8_t state = fw->recorder.signals.recorder_state;
  return fw->boxed != 0 || state == AXIS_RECORDER_STATE_ARMED ||
         state == AXIS_RECORDER_STATE_RECORDING;
}

/* Starts and updates the black box and its signals. Also computes the CRC of an incident in small
 * steps; together the steps take 1.2 s. Call incident_serve() in fw_between(). */
void incident_serve(fw_t *fw);

/* Call incident_yield() when a recording was armed: the black box stops, and the recorder uses the
 * buffer. */
void incident_yield(fw_t *fw);

/* Executes a command that was written to incident_command. Returns FW_OK or FW_ERROR_NO_DATA. The
 * command `load` needs an archived incident of this object table, and a buffer that contains no
 * incident and no recording. Every other command needs an incident whose CRC is complete. */
int incident_command(fw_t *fw, int32_t value);

#endif
