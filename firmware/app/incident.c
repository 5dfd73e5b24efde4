#include "firmware/app/incident.h"

#include <stddef.h>

#include "firmware/app/recording.h"

/* Signals that the black box records, because they show what led to an error. */
static const struct {
  uint16_t object;
  uint32_t address;
} recorded[RECORDER_CHANNELS] = {
    {AXIS_OBJ_POSITION, 0x202300},     {AXIS_OBJ_PROFILE_POSITION, 0x202B00},
    {AXIS_OBJ_FORCE_RAW, 0x202600},    {AXIS_OBJ_FORCE_DEMAND, 0x607400},
    {AXIS_OBJ_DAC_CODE, 0x202900},     {AXIS_OBJ_STATUSWORD, 0x604100},
    {AXIS_OBJ_LIMIT_REASON, 0x202200}, {AXIS_OBJ_DIGITAL_INPUTS, 0x202800},
};

static void channels_of(const fw_t *fw, recorder_channel_t channels[RECORDER_CHANNELS]) {
  for (uint8_t i = 0; i < RECORDER_CHANNELS; i++) {
    channels[i] = recording_channel(fw, recorded[i].object);
  }
}

void incident_init(fw_t *fw, uint16_t reset_error) {
  fw->boxed = 0;
  if (fw->config.blackbox != NULL) {
    recorder_channel_t channels[RECORDER_CHANNELS];
    channels_of(fw, channels);
    blackbox_init(fw->config.blackbox, fw->config.recorder_buffer, fw->config.recorder_bytes,
                  channels, reset_error);
    archive_init(&fw->archive, fw->config.archive,
                 blackbox_bytes(fw->config.recorder_bytes, channels));
  }
}

static void start(fw_t *fw) {
  recorder_channel_t channels[RECORDER_CHANNELS];
  channels_of(fw, channels);
  blackbox_start(fw->config.blackbox, channels, recording_channel(fw, AXIS_OBJ_ERROR_CODE));
}

/* Starts or stops the black box. It records while blackbox_option is `on` and the recorder does not
 * use the buffer. Returns the state of the black box. */
static uint8_t keep_recording(fw_t *fw) {
  blackbox_t *blackbox = fw->config.blackbox;
  const bool is_used = fw->recorder.signals.recorder_state != AXIS_RECORDER_STATE_IDLE;
  const bool is_wanted = fw->device.blackbox_option == AXIS_BLACKBOX_OPTION_ON && !is_used;
  if (is_wanted != blackbox_is_recording(blackbox)) {
    if (is_wanted) {
      start(fw);
    } else {
      blackbox_stop(blackbox);
    }
  }
  if (is_used) {
    return AXIS_BLACKBOX_STATE_RECORDER;
  }
  if (!blackbox_is_recording(blackbox)) {
    return AXIS_BLACKBOX_STATE_OFF;
  }
  return (blackbox->ring.signals.recorder_state == AXIS_RECORDER_STATE_ARMED)
             ? AXIS_BLACKBOX_STATE_RECORDING
             : AXIS_BLACKBOX_STATE_COMPLETING;
}

static void show(fw_t *fw, uint8_t state) {
  const blackbox_t *blackbox = fw->config.blackbox;
  device_signals_t *signals = &fw->device_signals;
  const bool is_over =
      state == AXIS_BLACKBOX_STATE_INCIDENT || state == AXIS_BLACKBOX_STATE_INCIDENT_KEPT;
  signals->blackbox_state = state;
  signals->incident_fault = blackbox->fault;
  signals->incident_error_code = blackbox->error_code;
  signals->incident_tick = (blackbox->error_code != AXIS_ERROR_CODE_NONE) ? blackbox->tick : 0;
  signals->incident_later = blackbox->later;
  signals->incident_crc = is_over ? blackbox->crc : 0;
}

void incident_serve(fw_t *fw) {
  blackbox_t *blackbox = fw->config.blackbox;
  if (blackbox == NULL) {
    return;
  }
  blackbox_follow(blackbox, fw->axis.signals.active_mode != AXIS_MODE_DISABLED,
                  fw->drive.signals.error_code, fw->axis.signals.tick_count);
  uint8_t state = AXIS_BLACKBOX_STATE_COMPLETING;
  bool complete = false;
  if (archive_is_loading(&fw->archive)) {
    /* The archive uses the buffer now, so the black box does not record. */
  } else if (!blackbox_has_incident(blackbox)) {
    state = keep_recording(fw);
  } else if (blackbox_check(blackbox)) {
    complete = true;
    state =
        (blackbox->kept != 0) ? AXIS_BLACKBOX_STATE_INCIDENT_KEPT : AXIS_BLACKBOX_STATE_INCIDENT;
  }
  archive_serve(&fw->archive, blackbox, complete,
                fw->axis.signals.active_mode == AXIS_MODE_DISABLED && !store_is_busy(&fw->store),
                fw->axis.signals.tick_count);
  fw->device_signals.incident_stored = archive_state(&fw->archive);
  fw->boxed = blackbox_is_recording(blackbox) ? 1 : 0;
  show(fw, state);
}

void incident_yield(fw_t *fw) {
  if (fw->config.blackbox != NULL) {
    blackbox_stop(fw->config.blackbox);
    fw->boxed = 0;
    show(fw, AXIS_BLACKBOX_STATE_RECORDER);
  }
}

/* Starts to load the archived incident if the black box has no incident and no recording uses the
 * buffer. */
static int load(fw_t *fw) {
  blackbox_t *blackbox = fw->config.blackbox;
  if (blackbox_has_incident(blackbox) ||
      fw->recorder.signals.recorder_state != AXIS_RECORDER_STATE_IDLE) {
    return FW_ERROR_NO_DATA;
  }
  recorder_channel_t channels[RECORDER_CHANNELS];
  channels_of(fw, channels);
  recorder_set_channels(&blackbox->ring, channels, RECORDER_CHANNELS);
  if (!archive_load(&fw->archive, blackbox)) {
    return FW_ERROR_NO_DATA;
  }
  fw->boxed = 0;
  show(fw, AXIS_BLACKBOX_STATE_COMPLETING);
  return FW_OK;
}

int incident_command(fw_t *fw, int32_t value) {
  blackbox_t *blackbox = fw->config.blackbox;
  if (blackbox != NULL && value == AXIS_INCIDENT_COMMAND_LOAD) {
    return load(fw);
  }
  if (blackbox == NULL || !blackbox_has_incident(blackbox) || !blackbox_check(blackbox)) {
    return FW_ERROR_NO_DATA;
  }
  recorder_stop(&fw->recorder);
  if (value == AXIS_INCIDENT_COMMAND_FETCH) {
    blackbox_show(blackbox, &fw->recorder);
    for (uint8_t i = 0; i < RECORDER_CHANNELS; i++) {
      fw->recorder.params.recorder_signal[i] = recorded[i].address;
    }
  } else {
    archive_clear(&fw->archive, blackbox->crc);
    blackbox_stop(blackbox);
    show(fw, AXIS_BLACKBOX_STATE_OFF);
  }
  canopen_domain_replaced(&fw->canopen, DICTIONARY_RECORDING);
  return FW_OK;
}
