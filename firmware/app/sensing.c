#include "firmware/app/sensing.h"

#include "firmware/drive/calibration.h"

/* As the port itself, so that what depends on the object follows. */
static int write(fw_t *fw, uint16_t object, int32_t value) {
  return dictionary_write(&fw->objects, FW_SOURCE_LOCAL, object, value);
}

static int calibrate(fw_t *fw) {
  drive_signals_t *signals = &fw->drive.signals;
  if (store_is_busy(&fw->store)) {
    return FW_ERROR_BUSY; /* as for every stored parameter */
  }
  uint32_t force_scale = 0;
  signals->calibration_linearity = 0;
  signals->calibration_state =
      calibration_compute(&fw->drive.params, &force_scale, &signals->calibration_linearity);
  if (signals->calibration_state != AXIS_CALIBRATION_STATE_DONE) {
    return FW_ERROR_RANGE;
  }
  const int refusal = write(fw, AXIS_OBJ_FORCE_SCALE, (int32_t)force_scale);
  return (refusal != FW_OK) ? refusal : write(fw, AXIS_OBJ_CALIBRATION_DATE, fw->drive.params.date);
}

int sensing_command(fw_t *fw, uint16_t object) {
  if (object == AXIS_OBJ_CALIBRATE) {
    return calibrate(fw);
  }
  tare_begin(&fw->drive.tare, &fw->drive.signals);
  return FW_OK;
}

void sensing_serve(fw_t *fw) {
  if (fw->drive.tare.found != 0 && !store_is_busy(&fw->store)) {
    fw->axis.params.force_tare = fw->drive.tare.tare_q8;
    tare_done(&fw->drive.tare, &fw->drive.signals);
  }
}
