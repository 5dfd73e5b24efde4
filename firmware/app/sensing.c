#include "firmware/app/sensing.h"

#include "firmware/drive/state.h"
#include "firmware/guard/calibration.h"

static int calibrate(fw_t *fw) {
  drive_signals_t *signals = &fw->drive.signals;
  if (store_is_busy(&fw->store)) {
    /* The calibration writes stored parameters. Such writes are refused while the parameter store
     * is working. */
    return FW_ERROR_BUSY;
  }
  uint32_t force_scale = 0;
  signals->calibration_linearity = 0;
  signals->calibration_state =
      calibration_compute(&fw->drive.params, &force_scale, &signals->calibration_linearity);
  if (signals->calibration_state != AXIS_CALIBRATION_STATE_DONE) {
    return FW_ERROR_RANGE;
  }
  const int refusal = dictionary_write_value(&fw->objects, FW_SOURCE_LOCAL, AXIS_OBJ_FORCE_SCALE,
                                             (int32_t)force_scale);
  return (refusal != FW_OK)
             ? refusal
             : dictionary_write_value(&fw->objects, FW_SOURCE_LOCAL, AXIS_OBJ_CALIBRATION_DATE,
                                      fw->drive.params.date);
}

int sensing_command(fw_t *fw, uint16_t object) {
  if (object == AXIS_OBJ_CALIBRATE) {
    return calibrate(fw);
  }
  tare_begin(&fw->drive.guards.tare, &fw->drive.signals);
  return FW_OK;
}

/* Writes the measured tare to force_tare. A tare is a measurement and no change of the
 * configuration. So changed() in fw.c does not reset the date of the verified configuration
 * (1020h). */
static uint8_t write_tare(fw_t *fw) {
  /* If the axis was enabled after the last tick of the tare measurement, the tare is refused: the
   * force law keeps the tare with which the axis was enabled. */
  if (cia402_is_powered(fw->drive.signals.drive_state) ||
      fw->axis.signals.active_mode != AXIS_MODE_DISABLED) {
    return AXIS_TARE_STATE_REFUSED_ENABLED;
  }
  fw->tare_is_written = 1;
  const int refusal = dictionary_write_value(&fw->objects, FW_SOURCE_LOCAL, AXIS_OBJ_FORCE_TARE,
                                             fw->drive.guards.tare.tare_q8);
  fw->tare_is_written = 0;
  switch (refusal) {
    case FW_OK:
      return AXIS_TARE_STATE_DONE;
    /* The tare exceeds tare_band, because tare_band was reduced after the tare measurement. */
    case FW_ERROR_RANGE:
      return AXIS_TARE_STATE_REFUSED_BAND;
    default:
      return AXIS_TARE_STATE_REFUSED_ENABLED;
  }
}

void sensing_serve(fw_t *fw) {
  if (fw->drive.guards.tare.found != 0 && !store_is_busy(&fw->store)) {
    tare_done(&fw->drive.guards.tare, &fw->drive.signals, write_tare(fw));
  }
}
