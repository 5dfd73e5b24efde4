#include "firmware/app/fw.h"

#include <stddef.h>

#include "firmware/app/board.h"
#include "firmware/app/curves.h"
#include "firmware/app/incident.h"
#include "firmware/app/law.h"
#include "firmware/app/lss_settings.h"
#include "firmware/app/ownership.h"
#include "firmware/app/programs.h"
#include "firmware/app/recording.h"
#include "firmware/app/reports.h"
#include "firmware/app/results.h"
#include "firmware/app/sensing.h"
#include "firmware/app/update.h"
#include "firmware/drive/cycle_mode.h"
#include "firmware/drive/state.h"
#include "firmware/fx/bytes.h"
#include "firmware/objects/value.h"

_Static_assert(sizeof(fw_t) < 65536, "offsets of objects have 16 bits");
_Static_assert(FW_SOURCE_CANOPEN == (int)AXIS_COMMAND_SOURCE_CANOPEN &&
                   FW_SOURCE_MODBUS == (int)AXIS_COMMAND_SOURCE_MODBUS &&
                   FW_SOURCE_LCM == (int)AXIS_COMMAND_SOURCE_LCM,
               "sources have the numbers of command_source");
_Static_assert(offsetof(fw_t, objects) == 0, "offsets of objects count from the dictionary");
/* TPDOs copy the bytes of mapped values directly from memory, so the processor must store the
 * lowest byte of a value first. */
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the lowest byte comes first");
/* Some protocol codes are enumerators above 32767, so the folders app, canopen and drive need an
 * int of 32 bits. The folders fx, core and objects work with a shorter int. */
_Static_assert(sizeof(int) >= sizeof(int32_t), "app, canopen and drive need an int of 32 bits");

static void wake(fw_t *fw) {
  if (fw->live == 0) {
    fw->live = 1;
    cia402_wake(&fw->drive, &fw->axis);
  }
}

/* Returns the latched fault. During a fault reaction, returns the fault that will be latched when
 * the reaction ends. */
static uint8_t fault_of(const fw_t *fw) {
  const uint8_t latched = fw->axis.signals.fault;
  return (latched != AXIS_FAULT_NONE) ? latched : fw->drive.fault;
}

/* Returns true if the running first motion test refuses a write to this object. The test keeps the
 * bounds with which it began. */
static bool is_frozen(const fw_t *fw, uint16_t object) {
  return guards_freeze(&fw->drive.guards, object);
}

/* Returns the largest permitted value of dac_bits. If the axis has a drive on a bus, this is 16,
 * because such a drive receives all bits of the output code. */
static uint8_t most_dac_bits(const fw_t *fw) {
  const bool is_any = fw->config.dac_bits == 0 || fw->device.drive_node_id != 0;
  return is_any ? (uint8_t)AXIS_DAC_BITS_MAX : fw->config.dac_bits;
}

static int check_axis(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value) {
  const fw_t *fw = fw_of_const(objects);
  /* A native mode is refused if it is written over a bus, because it would bypass the state machine
   * of the drive. */
  if (object == AXIS_OBJ_MODE && value != AXIS_MODE_DISABLED &&
      (source != FW_SOURCE_LOCAL || fault_of(fw) != AXIS_FAULT_NONE)) {
    return FW_ERROR_STATE;
  }
  if (is_frozen(fw, object)) {
    return FW_ERROR_STATE;
  }
  if (object == AXIS_OBJ_ADC_BITS && !law_banks_fit(&fw->banks, (uint8_t)value)) {
    return FW_ERROR_RANGE;
  }
  if (object == AXIS_OBJ_DAC_BITS && value > most_dac_bits(fw)) {
    return FW_ERROR_RANGE;
  }
  return axis_check(&fw->axis, object, value);
}

static void axis_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                         int32_t value) {
  fw_t *fw = fw_of(objects);
  axis_parameter_written(&fw->axis, object, previous, value);
  if (object == AXIS_OBJ_ADC_BITS) {
    law_adc_written(fw);
  }
  if (value != previous) {
    guards_written(&fw->drive.guards, &fw->drive.signals, object);
  }
  if (object == AXIS_OBJ_MODE) {
    if (value == AXIS_MODE_DISABLED) {
      ownership_disabled(fw, source);
    }
    cia402_native_mode(&fw->drive, &fw->axis, (uint8_t)value);
  }
}

/* Evaluates the samples of the running cycle. Stores the result if the cycle has ended. */
static void serve_cycle(fw_t *fw) {
  bool ended = false;
  if (cycle_mode_is_busy(&fw->drive)) {
    const uint8_t first = fw->drive.cycle.evaluated;
    cycle_mode_between(&fw->drive);
    curves_between(fw, first);
    ended = !cycle_mode_is_busy(&fw->drive);
  }
  if (fw->drive.program != NULL || fw->library.count != 0) {
    results_serve(fw, ended);
  }
}

static int check_drive(const dictionary_t *objects, uint8_t source, uint16_t object,
                       int32_t value) {
  (void)source;
  const fw_t *fw = fw_of_const(objects);
  return is_frozen(fw, object) ? FW_ERROR_STATE : cia402_check(&fw->drive, object, value);
}

static void drive_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                          int32_t value) {
  fw_t *fw = fw_of(objects);
  if (object == AXIS_OBJ_CONTROLWORD) {
    if (fw->drive.cycle.state == CYCLE_ENDED) {
      /* The result of the last pressed part must be complete before the next cycle starts. */
      serve_cycle(fw);
    }
    results_follow(fw);
    ownership_command(fw, source, (uint16_t)previous, (uint16_t)value);
    results_follow(fw);
  } else {
    cia402_written(&fw->drive, &fw->axis, object, previous, value);
    if (object == AXIS_OBJ_FORCE_SCALE) {
      law_certify(fw);
    }
  }
}

static int check_device(const dictionary_t *objects, uint8_t source, uint16_t object,
                        int32_t value) {
  (void)source;
  const fw_t *fw = fw_of_const(objects);
  int refusal = programs_check(fw, object, value);
  if (refusal == FW_OK) {
    refusal = results_check(fw, object, value);
  }
  if (refusal == FW_OK) {
    refusal = curves_check(fw, object);
  }
  return (refusal != FW_OK) ? refusal : lss_settings_check(fw, object, value);
}

static void device_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                           int32_t value) {
  ownership_written(objects, source, object, previous, value);
  programs_written(fw_of(objects), object, previous, value);
  results_written(fw_of(objects), object, value);
  curves_written(fw_of(objects), object);
}

static int check_node(const dictionary_t *objects, uint8_t source, uint16_t object, int32_t value) {
  (void)source;
  return canopen_check(&fw_of_const(objects)->canopen, object, value);
}

static void node_written(dictionary_t *objects, uint8_t source, uint16_t object, int32_t previous,
                         int32_t value) {
  (void)source;
  fw_t *fw = fw_of(objects);
  canopen_written(&fw->canopen, objects, object, previous, value);
  if (value != previous && canopen_watches_by(object)) {
    ownership_check_watch(fw);
  }
}

/* Returns `refusal`, the result of a command to the parameter store. After an accepted command,
 * store_state shows at once that the store is working. */
static int begin_store(fw_t *fw, int refusal) {
  if (refusal == FW_OK) {
    fw->device_signals.store_state = AXIS_STORE_STATE_SAVING;
  }
  return refusal;
}

static int command_recorder(fw_t *fw, bool arm) {
  /* Signals of the drive can be recorded only if the firmware computes the drive. */
  if (arm && fw->live == 0 && recording_needs_drive(fw)) {
    wake(fw);
  }
  const int refusal = recording_command(fw, arm);
  if (refusal == FW_OK && arm) {
    incident_yield(fw);
  }
  return refusal;
}

static int command_other(fw_t *fw, uint16_t object, uint32_t value) {
  if (object == AXIS_OBJ_PROGRAM_CONTROL) {
    return update_command(fw, value);
  }
  return (object == AXIS_OBJ_CYCLE_UNLOCK) ? results_unlock(fw)
                                           : programs_command(fw, object, value);
}

static int command(dictionary_t *objects, uint16_t object, int32_t value) {
  fw_t *fw = fw_of(objects);
  switch (object) {
    case AXIS_OBJ_FAULT_RESET:
      return cia402_fault_reset(&fw->drive, &fw->axis);
    case AXIS_OBJ_STORE_PARAMETERS:
    case AXIS_OBJ_STORE_ALL:
      return begin_store(fw, store_save(&fw->store));
    case AXIS_OBJ_RESTORE_DEFAULTS:
    case AXIS_OBJ_RESTORE_ALL:
      return begin_store(fw, store_forget(&fw->store));
    case AXIS_OBJ_TARE:
    case AXIS_OBJ_CALIBRATE:
      return sensing_command(fw, object);
    case AXIS_OBJ_EXCITATION_RUN:
      return cia402_excite(&fw->drive, &fw->axis, value == AXIS_EXCITATION_RUN_START);
    case AXIS_OBJ_INCIDENT_COMMAND:
      return incident_command(fw, value);
    case AXIS_OBJ_RECORDER_ARM:
      return command_recorder(fw, value != 0);
    default:
      return command_other(fw, object, (uint32_t)value);
  }
}

/* Ends a running cycle if the written value affects the verdict on the pressed part. After a change
 * of a stored parameter, resets the date of the verified configuration (1020h), because the present
 * configuration then differs from it. */
static void changed(dictionary_t *objects, uint16_t object) {
  fw_t *fw = fw_of(objects);
  if (axis_objects[object].in_cycle == AXIS_IN_CYCLE_ENDS) {
    cycle_mode_change(&fw->drive);
  }
  if (axis_objects[object].stored != 0 && object != AXIS_OBJ_CONFIGURATION_DATE &&
      object != AXIS_OBJ_CONFIGURATION_TIME && fw->tare_is_written == 0) {
    canopen_params_t *params = &fw->canopen.params;
    params->configuration_date = 0;
    params->configuration_time = 0;
  }
}

static const char *text(const dictionary_t *objects, uint16_t index) {
  const fw_t *fw = fw_of_const(objects);
  switch (index) {
    case 0x1008:
      return "forceaxis";
    case 0x1009:
      return (fw->config.hardware == NULL) ? "none" : fw->config.hardware;
    default:
      return (fw->config.software == NULL) ? FW_VERSION " " AXIS_OBJECTS_HASH_TEXT
                                           : fw->config.software;
  }
}

static int32_t domain_size(const dictionary_t *objects, uint16_t index) {
  const fw_t *fw = fw_of_const(objects);
  return (index == DICTIONARY_CURVE) ? curves_size(fw) : recording_size(fw);
}

static uint32_t domain_read(const dictionary_t *objects, uint16_t index, uint32_t offset,
                            uint8_t *bytes, uint32_t count) {
  const fw_t *fw = fw_of_const(objects);
  return (index == DICTIONARY_CURVE) ? cycle_curve_bytes(&fw->curve, offset, bytes, count)
                                     : recorder_bytes(&fw->recorder, offset, bytes, count);
}

/* Table for the object dictionary. For each block of objects it has the offset of the values, the
 * function that checks a write, and the function that acts on a write. */
static const dictionary_owner_t owner = {
    .blocks =
        {
            [AXIS_BLOCK_AXIS_PARAMETER] = {offsetof(fw_t, axis.params), check_axis, axis_written},
            [AXIS_BLOCK_AXIS_SIGNAL] = {offsetof(fw_t, axis.signals), NULL, NULL},
            [AXIS_BLOCK_LAW_PARAMETER] = {offsetof(fw_t, banks.params), law_check, law_written},
            [AXIS_BLOCK_LAW_SIGNAL] = {offsetof(fw_t, banks.signals), NULL, NULL},
            [AXIS_BLOCK_RECORDER_PARAMETER] = {offsetof(fw_t, recorder.params), recording_check,
                                               NULL},
            [AXIS_BLOCK_RECORDER_SIGNAL] = {offsetof(fw_t, recorder.signals), NULL, NULL},
            [AXIS_BLOCK_DRIVE_PARAMETER] = {offsetof(fw_t, drive.params), check_drive,
                                            drive_written},
            [AXIS_BLOCK_DRIVE_SIGNAL] = {offsetof(fw_t, drive.signals), NULL, NULL},
            [AXIS_BLOCK_CANOPEN_PARAMETER] = {offsetof(fw_t, canopen.params), check_node,
                                              node_written},
            [AXIS_BLOCK_CANOPEN_SIGNAL] = {offsetof(fw_t, canopen.signals), NULL, NULL},
            [AXIS_BLOCK_DEVICE_PARAMETER] = {offsetof(fw_t, device), check_device, device_written},
            [AXIS_BLOCK_DEVICE_SIGNAL] = {offsetof(fw_t, device_signals), NULL, NULL},
        },
    .permit = ownership_permit,
    .changed = changed,
    .command = command,
    .text = text,
    .domain_size = domain_size,
    .domain_read = domain_read,
    .download_most = programs_download_most,
    .download_begin = programs_download_begin,
    .download_append = programs_download_append,
    .download_end = programs_download_end,
};

/* Returns true if the axis was commissioned: the newest saved parameter set is complete and active.
 * Returns false if there is no saved set, if the last save was interrupted, or if the set was saved
 * under another object table and some of its entries are not active. */
static bool is_commissioned(uint8_t store_state) {
  return store_state == AXIS_STORE_STATE_LOADED ||
         store_state == AXIS_STORE_STATE_LOADED_OLD_DEFAULTS;
}

/* Sets every parameter and signal to its default, except the counters of lost frames. Stored values
 * then replace the defaults. */
static void power_up(fw_t *fw) {
  axis_init(&fw->axis);
  law_banks_init(&fw->banks);
  recorder_init(&fw->recorder, fw->config.recorder_buffer, fw->config.recorder_bytes);
  cia402_init(&fw->drive);
  lss_settings_begin(fw);
  value_store_defaults(&fw->device, AXIS_BLOCK_DEVICE_PARAMETER);
  fw->device_signals.object_table_hash = AXIS_OBJECTS_HASH32;
  curves_init(fw);
  fw->source_silence = 0;
  for (uint8_t i = 0; i < FW_HELD; i++) {
    fw->reported[i] = 0;
  }
  fw->ticks_alone = 0;
  fw->contact_seen = 0;
  fw->owner_on_can = 1;
  fw->device_signals.store_state = store_load(&fw->store, &fw->objects);
  programs_init(fw);
  results_loaded(fw);
  const bool has_id = lss_settings_load(fw);
  const bool has_law = law_loaded(fw);
  axis_output_loaded(&fw->axis, most_dac_bits(fw));
  if (!has_id || !has_law) {
    fw->device_signals.store_state = AXIS_STORE_STATE_FAILED;
  }
  if (fw->config.memory != NULL && !is_commissioned(fw->device_signals.store_state)) {
    fw->drive.params.first_motion_test = AXIS_FIRST_MOTION_TEST_ON;
  }
  fw->device_signals.store_change_count = fw->store.change_count;
  for (uint8_t i = 0; i < STORE_CHANGES; i++) {
    fw->device_signals.store_change[i] = fw->store.changes[i];
  }
  update_show(fw);
}

/* Starts the CANopen node. Sends the emergency message store_failed, unless the store is empty or
 * the parameter set was loaded without changes. */
static void boot(fw_t *fw) {
  canopen_start(&fw->canopen, &fw->objects);
  const uint8_t state = fw->device_signals.store_state;
  if (state != AXIS_STORE_STATE_EMPTY && state != AXIS_STORE_STATE_LOADED) {
    reports_store(fw);
  }
}

void fw_init(fw_t *fw, const fw_config_t *config) {
  fx_clear(fw, sizeof(*fw));
  fx_copy_words(&fw->config, config, sizeof(fw->config));
  dictionary_init(&fw->objects, &owner);
  value_store_defaults(&fw->device_signals, AXIS_BLOCK_DEVICE_SIGNAL);
  board_show_reset(fw);
  store_init(&fw->store, config->memory);
  results_init(fw);
  update_init(fw);
  power_up(fw);
  const uint16_t error = board_reset_error(config);
  /* After a brown-out reset the black box keeps no incident, because the low supply voltage may
   * have changed the contents of the memory. */
  incident_init(fw, (error != AXIS_ERROR_CODE_BROWNOUT_RESET) ? error : AXIS_ERROR_CODE_NONE);
  if (config->buses != 0) {
    wake(fw);
    boot(fw);
    if (error != AXIS_ERROR_CODE_NONE) {
      canopen_emergency_detailed(&fw->canopen, error, config->reset_cause,
                                 fw->device_signals.core_fault_pc);
    }
  }
}

/* Increases the counter *counter by `by`. The counter saturates at UINT16_MAX. */
static void count_up(uint16_t *counter, uint16_t by) {
  *counter = (by > UINT16_MAX - *counter) ? UINT16_MAX : (uint16_t)(*counter + by);
}

/* Executes the requests that the CANopen node has stored for the firmware: a fault, lost frames,
 * the loss of the owner, or a stop. */
static void take_requests(fw_t *fw) {
  if (!canopen_has_requests(&fw->canopen)) {
    return;
  }
  const canopen_requests_t requests = canopen_take_requests(&fw->canopen);
  if (requests.duplicate != 0) {
    axis_fault(&fw->axis, AXIS_FAULT_DUPLICATE_NODE);
  }
  if (requests.frames_lost != 0) {
    count_up(&fw->device_signals.can_lost, requests.frames_lost);
  }
  if (ownership_ends(fw, requests.sources_lost)) {
    ownership_lost(fw, requests.fault);
  } else if (requests.stop != 0) {
    ownership_stopped(fw, requests.fault);
  }
}

static void execute_reset(fw_t *fw) {
  if (fw->canopen.reset == CANOPEN_RESET_NONE) {
    return;
  }
  /* A reset waits until a save in progress has ended, because the reset must load the saved values.
   * It also waits until the result of a cycle is complete. */
  const bool is_saving =
      store_is_busy(&fw->store) || store_parts_state(&fw->store) == STORE_PARTS_WRITING;
  if ((is_saving && fw->store.memory != NULL &&
       fw->axis.signals.active_mode == AXIS_MODE_DISABLED) ||
      cycle_mode_is_busy(&fw->drive)) {
    return;
  }
  /* On a chip, the load of the parameters takes longer than a tick. So the axis is disabled before
   * a reset of the node. */
  if (fw->canopen.reset == CANOPEN_RESET_NODE &&
      fw->axis.signals.active_mode != AXIS_MODE_DISABLED) {
    cia402_native_mode(&fw->drive, &fw->axis, AXIS_MODE_DISABLED);
    return;
  }
  const uint8_t reset = canopen_take_reset(&fw->canopen);
  const uint8_t bus = fw->canopen.bus;
  if (reset == CANOPEN_RESET_NODE) {
    const uint32_t ticks = fw->axis.signals.tick_count;
    power_up(fw);
    fw->axis.signals.tick_count = ticks;
    cia402_wake(&fw->drive, &fw->axis);
    boot(fw);
  } else {
    const bool loaded = lss_settings_reset_communication(fw);
    update_show(fw);
    canopen_start(&fw->canopen, &fw->objects);
    if (!loaded) {
      fw->device_signals.store_state = AXIS_STORE_STATE_FAILED;
      canopen_emergency(&fw->canopen, AXIS_ERROR_CODE_STORE_FAILED, AXIS_STORE_STATE_FAILED);
    }
  }
  /* The code for the board reports only changes of the state of the CAN bus. So after a reset the
   * CANopen node gets the present bus state here. */
  canopen_bus(&fw->canopen, bus);
  take_requests(fw);
}

static void serve_save(fw_t *fw) {
  const uint8_t state = store_tick(&fw->store, &fw->objects);
  if (state != AXIS_STORE_STATE_COUNT) {
    if (state == AXIS_STORE_STATE_FAILED && fw->device_signals.store_state != state) {
      canopen_emergency(&fw->canopen, AXIS_ERROR_CODE_STORE_FAILED, state);
    }
    fw->device_signals.store_state = state;
    lss_settings_stored(fw, state);
  }
}

/* Serves the parameter store. Cycle programs and counts of pressed parts are written to the flash
 * only while the axis is disabled. An enabled axis does not wait for this work. */
static void serve_store(fw_t *fw) {
  if (store_is_busy(&fw->store)) {
    serve_save(fw);
  } else if (store_parts_state(&fw->store) == STORE_PARTS_WRITING) {
    if (fw->axis.signals.active_mode == AXIS_MODE_DISABLED &&
        !cia402_is_powered(fw->drive.signals.drive_state)) {
      store_parts_tick(&fw->store, &fw->objects);
    } else {
      store_abandon(&fw->store);
    }
  }
  results_show_store(fw);
}

static bool is_active(const fw_t *fw) { return fw->axis.signals.active_mode != AXIS_MODE_DISABLED; }

static void serve_node(fw_t *fw) {
  reports_contact(fw);
  while (canopen_is_behind(&fw->canopen)) {
    if (canopen_tick_timers(&fw->canopen, is_active(fw))) {
      take_requests(fw);
    }
    const canopen_axis_t axis = {
        .error_code = fw->drive.signals.error_code, .fault = fault_of(fw), .active = is_active(fw)};
    canopen_tick_end(&fw->canopen, &fw->objects, &axis);
    take_requests(fw);
  }
}

void fw_prepare(fw_t *fw) {
  if (fw->live == 0) {
    return;
  }
  ownership_tick(fw);
  cia402_before(&fw->drive, &fw->axis);
  fw->ticks_alone += 1;
  if (fw->ticks_alone > FW_BETWEEN_TICKS_MAX) {
    axis_fault(&fw->axis, AXIS_FAULT_MAIN_LOOP_LOST);
  }
}

/* Asserts that the outputs of an axis with a fault are off in the tick of the fault, whichever part
 * of the firmware detected the fault. */
static inline void assert_outputs(const fw_t *fw, const axis_outputs_t *outputs) {
  if (fw->axis.signals.fault != AXIS_FAULT_NONE) {
    fx_assert(outputs->dac_fine == 0 && outputs->dac_code == 0);
    fx_assert(outputs->amp_enable == 0 && outputs->brake_release == 0);
  }
}

void fw_control(fw_t *fw, const axis_inputs_t *inputs, axis_outputs_t *outputs) {
  cia402_with_inputs(&fw->drive, &fw->axis, inputs);
  axis_tick(&fw->axis, inputs, outputs);
  outputs->digital = fw->drive.signals.cycle_outputs;
  if (fw->live != 0) {
    cia402_control(&fw->drive, &fw->axis, outputs);
  }
  assert_outputs(fw, outputs);
}

bool fw_report(fw_t *fw) {
  if (fw->live == 0) {
    recorder_tick(&fw->recorder, &fw->objects);
    return true;
  }
  cia402_after(&fw->drive, &fw->axis);
  incident_tick(fw, fault_of(fw));
  if (fw->config.buses != 0) {
    /* A sample of the recorder and a TPDO in the same interrupt would take too long, so the TPDO is
     * deferred. */
    const bool defer = incident_samples(fw) || reports_contact_seen(fw) != fw->contact_seen ||
                       !canopen_has_reported(&fw->canopen, fw->drive.signals.error_code);
    canopen_tick_begin(&fw->canopen, &fw->objects, is_active(fw), defer);
  }
  return fw->ticks_alone <= FW_BETWEEN_TICKS_MAX;
}

void fw_between(fw_t *fw) {
  const uint32_t ticks = fw->ticks_alone;
  fw->ticks_alone = 0;
  if (fw->live == 0) {
    return;
  }
  if (fw->config.buses != 0) {
    serve_node(fw);
    if (lss_settings_pending(fw)) {
      lss_settings_serve(fw, ticks);
    }
    fw->on_serial = 1;
    modbus_tick(&fw->modbus, &fw->objects);
    fw->on_serial = 0;
    execute_reset(fw);
    incident_serve(fw);
  }
  sensing_serve(fw);
  serve_store(fw);
  serve_cycle(fw);
  update_serve(fw);
}

void fw_tick(fw_t *fw, const axis_inputs_t *inputs, axis_outputs_t *outputs) {
  fw_prepare(fw);
  fw_control(fw, inputs, outputs);
  (void)fw_report(fw);
  fw_between(fw);
}

void fw_can_receive(fw_t *fw, const can_frame_t *frame) {
  canopen_receive(&fw->canopen, &fw->objects, frame);
  take_requests(fw);
}

bool fw_can_transmit(fw_t *fw, can_frame_t *frame) { return canopen_transmit(&fw->canopen, frame); }

void fw_can_lost(fw_t *fw, uint16_t frames) {
  canopen_lost(&fw->canopen, frames);
  take_requests(fw);
}

void fw_can_bus(fw_t *fw, uint8_t state) {
  canopen_bus(&fw->canopen, state);
  fw->device_signals.can_state = fw->canopen.bus;
  take_requests(fw);
}

uint16_t fw_can_kbit_s(const fw_t *fw) { return lss_kbit_s(fw->canopen.lss.rate); }

void fw_modbus_receive(fw_t *fw, const uint8_t *bytes, uint16_t count) {
  fw->on_serial = 1;
  modbus_receive(&fw->modbus, &fw->objects, bytes, count);
  fw->on_serial = 0;
}

uint16_t fw_modbus_transmit(fw_t *fw, uint8_t *bytes, uint16_t room) {
  return modbus_transmit(&fw->modbus, bytes, room);
}

void fw_overrun(fw_t *fw, uint32_t missed) {
  const uint32_t count = (missed == 0) ? 1 : missed;
  count_up(&fw->device_signals.overruns, (count > UINT16_MAX) ? UINT16_MAX : (uint16_t)count);
  fw->axis.signals.tick_count += missed;
  fw->update.overrun_tick = fw->axis.signals.tick_count;
  if (fw->config.buses != 0) {
    if (missed != 0) {
      canopen_missed(&fw->canopen, missed);
    }
    reports_limited(fw, AXIS_ERROR_CODE_OVERRUN);
  }
}

int fw_object_read(const fw_t *fw, uint16_t object, int32_t *value) {
  return dictionary_read(&fw->objects, object, value);
}

int fw_object_write(fw_t *fw, uint8_t source, uint16_t object, int32_t value) {
  if (fw->live == 0 && object < AXIS_OBJ_COUNT && !recording_is_without_drive(object)) {
    wake(fw);
  }
  return dictionary_write(&fw->objects, source, object, value);
}

cycle_check_t fw_select_program(fw_t *fw, const void *record, uint32_t size) {
  const cycle_check_t check = cycle_program_check(record, size);
  if (check.reason != CYCLE_ACCEPTED) {
    return check;
  }
  return programs_select(fw, (const cycle_header_t *)record);
}

int fw_recorder_read(const fw_t *fw, uint32_t index, int32_t values[RECORDER_CHANNELS]) {
  const int count = recorder_read(&fw->recorder, index, values);
  return (count < 0) ? FW_ERROR_NO_DATA : count;
}
