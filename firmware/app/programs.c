#include "firmware/app/programs.h"

#include <stddef.h>

#include "firmware/app/ownership.h"
#include "firmware/app/update.h"
#include "firmware/canopen/sdo.h"
#include "firmware/drive/cycle_mode.h"
#include "firmware/drive/modes.h"
#include "firmware/fx/bytes.h"

_Static_assert(AXIS_CYCLE_PROGRAM_REFUSAL_COUNT == (int)CYCLE_REASONS, "reasons for a refusal");

enum { DATA_WORDS = AXIS_OBJ_CYCLE_DATA_16 - AXIS_OBJ_CYCLE_DATA_1 + 1 };

/* Shows the state of the library and of the selected cycle program in the signals. */
static void show_programs(fw_t *fw) {
  const cycle_header_t *program = fw->drive.program;
  fw->device_signals.cycle_program_crc = (program == NULL) ? 0 : cycle_program_crc(program);
  fw->device_signals.cycle_program_count = fw->library.count;
}

static void show_check(fw_t *fw, cycle_check_t check) {
  fw->device_signals.cycle_program_refusal = check.reason;
  fw->device_signals.cycle_program_refused_part = check.number;
}

/* Passes the bytes of the library of cycle programs to the parameter store. */
static void give_programs(fw_t *fw, bool changed) {
  store_part_set(&fw->store, STORE_PROGRAMS, (store_part_t){fw->library.records, fw->library.used},
                 changed);
}

/* Loads the stored cycle programs into the library. The library has room for all bytes that the
 * parameter store can contain. */
static void load_programs(fw_t *fw) {
  cycle_library_t *library = &fw->library;
  const uint32_t most = store_programs_max(&fw->store);
  const uint32_t bytes = store_part_bytes(&fw->store, STORE_PROGRAMS);
  library->bytes = (library->bytes < most) ? library->bytes : most;
  if (bytes <= library->bytes && bytes != 0) {
    store_part_read(&fw->store, STORE_PROGRAMS, library->records);
    (void)cycle_library_restore(library, bytes);
  }
  give_programs(fw, false);
}

void programs_init(fw_t *fw) {
  cycle_library_t *library = &fw->library;
  cycle_library_init(library, fw->config.program_memory, fw->config.program_bytes);
  if (fw->store.memory != NULL) {
    load_programs(fw);
  }
  fw->parts_tick = 0;
  fw->has_parts = 0;
  show_check(fw, (cycle_check_t){CYCLE_ACCEPTED, 0});
  show_programs(fw);
}

/* Selects a cycle program; NULL selects no program. While a cycle runs, changes nothing and returns
 * false. */
static bool select(fw_t *fw, const cycle_header_t *program) {
  if (!cycle_mode_select(&fw->drive, program)) {
    return false;
  }
  cia402_show_cycle(&fw->drive);
  show_programs(fw);
  return true;
}

/* After a change of the library, selects the cycle program with the same number again. The result
 * of the last cycle is lost only if this program itself has changed. */
static void follow_library(fw_t *fw, uint32_t changed) {
  const uint32_t number = fw->device.cycle_program;
  if (number != 0) {
    const cycle_header_t *program = cycle_library_find(&fw->library, number);
    if (number != changed) {
      cycle_mode_moved(&fw->drive, program);
    } else {
      (void)select(fw, program);
      fw->device.cycle_program = (program == NULL) ? 0 : number;
    }
  }
  show_programs(fw);
}

static bool has_parts(const fw_t *fw) {
  return fw->has_parts != 0 &&
         fw->axis.signals.tick_count - fw->parts_tick < PROGRAMS_SILENCE_TICKS;
}

/* Returns true if an SDO server other than `server` is receiving a download. */
static bool is_downloading(const fw_t *fw, uint8_t server) {
  bool found = false;
  for (uint8_t i = 0; i < CANOPEN_SDOS; i++) {
    found = found || (i != server && sdo_downloads_bytes(&fw->canopen, i));
  }
  return found;
}

static int check_selection(const fw_t *fw, uint32_t number) {
  if (cycle_mode_is_busy(&fw->drive)) {
    return FW_ERROR_STATE;
  }
  const bool exists = number == 0 || cycle_library_find(&fw->library, number) != NULL;
  return exists ? FW_OK : FW_ERROR_RANGE;
}

static bool is_part(uint16_t object) {
  return object == AXIS_OBJ_CYCLE_DATA_OFFSET ||
         (object >= AXIS_OBJ_CYCLE_DATA_1 && object < AXIS_OBJ_CYCLE_DATA_1 + DATA_WORDS);
}

int programs_check(const fw_t *fw, uint16_t object, int32_t value) {
  if (object == AXIS_OBJ_CYCLE_PROGRAM) {
    return check_selection(fw, (uint32_t)value);
  }
  return (is_part(object) && is_downloading(fw, CANOPEN_SDOS)) ? FW_ERROR_BUSY : FW_OK;
}

/* Handles the word at offset 0, with which a cycle program or an update of the firmware begins. In
 * an update longer than 65535 bytes offset 0 occurs again, because the objects have the offset
 * modulo 65536. The update then continues. */
static void begin_parts(fw_t *fw, uint32_t first) {
  const bool continues = update_is_receiving(&fw->update, fw->axis.signals.tick_count) &&
                         fw->update.received != 0 && (fw->update.received & 0xFFFFu) == 0;
  if (first == UPDATE_MAGIC) {
    (void)update_begin(fw, 0);
  } else if (!continues) {
    update_abandon(fw);
  }
}

/* Stages one piece of a cycle program, or stores the offset of the next piece. A piece that follows
 * missing bytes is dropped. The command that ends the program is then refused, because bytes are
 * missing. */
static void take_part(fw_t *fw, uint16_t object, uint32_t value) {
  fw->has_parts = 1;
  fw->parts_tick = fw->axis.signals.tick_count;
  if (object != AXIS_OBJ_CYCLE_DATA_OFFSET) {
    uint8_t bytes[4];
    fx_store_le(bytes, value, 4);
    const uint32_t place = fw->device.cycle_data_offset + 4u * (object - AXIS_OBJ_CYCLE_DATA_1);
    if (place == 0) {
      begin_parts(fw, value);
    }
    if (update_is_receiving(&fw->update, fw->axis.signals.tick_count)) {
      update_part(fw, (uint16_t)place, bytes);
    } else {
      (void)cycle_library_append(&fw->library, place, bytes, sizeof(bytes));
    }
  } else if (value == 0) {
    cycle_library_begin(&fw->library);
  }
}

void programs_written(fw_t *fw, uint16_t object, int32_t previous, int32_t value) {
  if (is_part(object)) {
    take_part(fw, object, (uint32_t)value);
  } else if (object == AXIS_OBJ_CYCLE_PROGRAM && value != previous) {
    (void)select(fw, cycle_library_find(&fw->library, (uint32_t)value));
  }
}

cycle_check_t programs_select(fw_t *fw, const cycle_header_t *program) {
  if (!select(fw, program)) {
    return (cycle_check_t){CYCLE_BUSY, 0};
  }
  fw->device.cycle_program = 0;
  return (cycle_check_t){CYCLE_ACCEPTED, 0};
}

/* Returns FW_OK if the library of cycle programs may change now, otherwise the error code of the
 * refusal. */
static int refusal_of_change(const fw_t *fw) {
  if (fw->library.staging == NULL) {
    return FW_ERROR_NO_MEMORY;
  }
  if (cycle_mode_is_busy(&fw->drive) || fw->device.cycle_program_lock != 0) {
    return FW_ERROR_STATE;
  }
  return store_is_busy(&fw->store) ? FW_ERROR_BUSY : FW_OK;
}

static int remove_program(fw_t *fw, uint32_t number) {
  const int refusal = refusal_of_change(fw);
  if (refusal != FW_OK) {
    return refusal;
  }
  store_abandon(&fw->store);
  if (!cycle_library_remove(&fw->library, number)) {
    return FW_ERROR_RANGE;
  }
  give_programs(fw, true);
  follow_library(fw, number);
  return FW_OK;
}

/* Adds the cycle program that was received in the staging area to the library of cycle programs. */
static int accept(fw_t *fw, uint32_t size) {
  const int refusal = refusal_of_change(fw);
  if (refusal != FW_OK) {
    const bool is_locked = fw->device.cycle_program_lock != 0;
    show_check(fw, (cycle_check_t){is_locked ? CYCLE_LOCKED : CYCLE_BUSY, 0});
    return refusal;
  }
  store_abandon(&fw->store);
  const cycle_check_t check = cycle_library_accept(&fw->library, size);
  show_check(fw, check);
  if (check.reason != CYCLE_ACCEPTED) {
    return (check.reason == CYCLE_NO_ROOM) ? FW_ERROR_NO_MEMORY : FW_ERROR_RANGE;
  }
  give_programs(fw, true);
  follow_library(fw, cycle_library_at(&fw->library, (uint8_t)(fw->library.count - 1))->number);
  return FW_OK;
}

static int end_parts(fw_t *fw, uint32_t size) {
  if (fw->library.staging == NULL) {
    return FW_ERROR_NO_MEMORY;
  }
  if (is_downloading(fw, CANOPEN_SDOS)) {
    return FW_ERROR_BUSY;
  }
  fw->has_parts = 0;
  return accept(fw, size);
}

int programs_command(fw_t *fw, uint16_t object, uint32_t value) {
  return (object == AXIS_OBJ_CYCLE_PROGRAM_REMOVE) ? remove_program(fw, value)
                                                   : end_parts(fw, value);
}

uint32_t programs_download_most(const dictionary_t *objects, uint16_t index) {
  const fw_t *fw = fw_of_const(objects);
  if (index == DICTIONARY_UPDATE) {
    return (fw->config.slots == NULL) ? 0 : UPDATE_BYTES_MAX;
  }
  return (fw->library.staging == NULL) ? 0 : CYCLE_PROGRAM_BYTES_MAX;
}

/* Returns FW_OK if `source` may download now, otherwise the error code. A download needs the same
 * permission as the removal of a cycle program. */
static int refusal_of(const dictionary_t *objects, uint8_t source) {
  return ownership_permit(objects, source, AXIS_OBJ_CYCLE_PROGRAM_REMOVE, 1);
}

int programs_download_begin(dictionary_t *objects, uint8_t source, uint16_t index, uint32_t size) {
  fw_t *fw = fw_of(objects);
  const int refusal = refusal_of(objects, source);
  if (refusal != FW_OK) {
    return refusal;
  }
  if (has_parts(fw) || is_downloading(fw, source)) {
    return FW_ERROR_BUSY;
  }
  fw->has_parts = 0;
  if (index == DICTIONARY_UPDATE) {
    return update_begin(fw, size);
  }
  update_abandon(fw);
  cycle_library_begin(&fw->library);
  return FW_OK;
}

int programs_download_append(dictionary_t *objects, uint32_t offset, const uint8_t *bytes,
                             uint32_t count) {
  fw_t *fw = fw_of(objects);
  if (fw->update.is_receiving != 0) {
    return update_append(fw, bytes, count);
  }
  const bool is_staged = cycle_library_append(&fw->library, offset, bytes, count);
  return is_staged ? FW_OK : FW_ERROR_RANGE;
}

int programs_download_end(dictionary_t *objects, uint8_t source, uint16_t index, uint32_t size) {
  const int refusal = refusal_of(objects, source);
  if (refusal != FW_OK) {
    return refusal;
  }
  return (index == DICTIONARY_UPDATE) ? update_end(fw_of(objects)) : accept(fw_of(objects), size);
}
