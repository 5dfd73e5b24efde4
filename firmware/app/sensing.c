#include "firmware/app/sensing.h"

#include "firmware/app/law.h"
#include "firmware/drive/state.h"
#include "firmware/guard/calibration.h"

/* Puts the result in force, and what depends on it: a command cannot write objects itself. */
static void adopt(fw_t *fw, uint32_t force_scale) {
  drive_params_t *params = &fw->drive.params;
  const int32_t scale_before = (int32_t)params->force_scale;
  const int32_t date_before = params->calibration_date;
  params->force_scale = force_scale;
  params->calibration_date = params->date;
  cia402_written(&fw->drive, &fw->axis, AXIS_OBJ_FORCE_SCALE, scale_before, (int32_t)force_scale);
  cia402_written(&fw->drive, &fw->axis, AXIS_OBJ_CALIBRATION_DATE, date_before, params->date);
  law_certify(fw);
  fw->canopen.params.configuration_date = 0; /* 1020h: not the verified configuration any more */
  fw->canopen.params.configuration_time = 0;
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
  adopt(fw, force_scale);
  return FW_OK;
}

int sensing_command(fw_t *fw, uint16_t object) {
  if (object == AXIS_OBJ_CALIBRATE) {
    return calibrate(fw);
  }
  tare_begin(&fw->drive.guards.tare, &fw->drive.signals);
  return FW_OK;
}

void sensing_serve(fw_t *fw) {
  if (fw->drive.guards.tare.found == 0 || store_is_busy(&fw->store)) {
    return;
  }
  /* Enabled since its last reading: the law begins with the tare that it was enabled with. */
  const bool enabled = cia402_is_powered(fw->drive.signals.drive_state) ||
                       fw->axis.signals.active_mode != AXIS_MODE_DISABLED;
  if (!enabled) {
    fw->axis.params.force_tare = fw->drive.guards.tare.tare_q8;
  }
  tare_done(&fw->drive.guards.tare, &fw->drive.signals,
            enabled ? AXIS_TARE_STATE_REFUSED_ENABLED : AXIS_TARE_STATE_DONE);
}
