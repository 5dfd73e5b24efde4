#include "firmware/app/lss_settings.h"

/* The only value that store_all accepts: the text "save" as a 32-bit number. */
#define SAVE fx_s32_from_u32(UINT32_C(0x65766173))

_Static_assert(AXIS_OBJ_STORED_BIT_RATE == AXIS_OBJ_STORED_NODE_ID + 1, "saved together");
_Static_assert((int)FW_NODE_ID_BY_LSS == (int)LSS_NO_NODE_ID, "no id");

int lss_settings_check(const fw_t *fw, uint16_t object, int32_t value) {
  bool fits = true;
  if (object == AXIS_OBJ_STORED_NODE_ID) {
    fits = value <= 127 || value == LSS_NO_NODE_ID;
  } else if (object == AXIS_OBJ_STORED_BIT_RATE || object == AXIS_OBJ_DRIVE_BIT_RATE) {
    fits = lss_has_rate(&fw->canopen, lss_rate_of((uint32_t)value));
  }
  return fits ? FW_OK : FW_ERROR_RANGE;
}

static void assume_node_id(fw_t *fw, uint8_t node_id) {
  canopen_init(&fw->canopen, node_id);
  fw->canopen.signals.serial_number = fw->config.serial_number;
  if (node_id != fw->device_signals.node_id) {
    modbus_init(&fw->modbus, node_id, fw->config.modbus_baud);
    fw->device_signals.node_id = node_id;
  }
}

static bool is_fixed(const fw_t *fw) {
  return fw->config.node_id != 0 && fw->config.node_id != FW_NODE_ID_BY_LSS;
}

void lss_settings_begin(fw_t *fw) {
  const uint8_t node_id = is_fixed(fw) ? fw->config.node_id : 1;
  fw->device_signals.node_id = 0;
  assume_node_id(fw, node_id);
}

static bool load_node(fw_t *fw) {
  return store_load_block(&fw->store, &fw->objects, AXIS_BLOCK_CANOPEN_PARAMETER);
}

bool lss_settings_load(fw_t *fw) {
  /* The stored parameter set may come from a firmware image that permitted other node ids. */
  const bool fits =
      lss_settings_check(fw, AXIS_OBJ_STORED_NODE_ID, fw->device.stored_node_id) == FW_OK;
  const uint8_t stored = fits ? fw->device.stored_node_id : 0;
  uint8_t node_id = fw->device_signals.node_id;
  if (!is_fixed(fw) && (stored != 0 || fw->config.node_id == FW_NODE_ID_BY_LSS)) {
    node_id = (stored != 0) ? stored : LSS_NO_NODE_ID;
  }
  lss_init(&fw->canopen, node_id, is_fixed(fw), lss_rate_of(fw->device.stored_bit_rate),
           fw->config.bit_rates);
  fw->device_signals.bit_rate = lss_kbit_s(fw->canopen.lss.rate);
  if (node_id == fw->device_signals.node_id) {
    return true;
  }
  assume_node_id(fw, node_id);
  return load_node(fw);
}

bool lss_settings_reset_communication(fw_t *fw) {
  assume_node_id(fw, fw->canopen.lss.node_id);
  return load_node(fw);
}

/* Starts to save only the node id and the bit rate; other changed parameters are not saved. */
static uint8_t begin_store(fw_t *fw) {
  if (fw->store.memory == NULL) {
    return LSS_STORE_MISSING;
  }
  if (dictionary_check(&fw->objects, FW_SOURCE_LOCAL, AXIS_OBJ_STORE_ALL, SAVE) != FW_OK ||
      store_save_only(&fw->store, AXIS_OBJ_STORED_NODE_ID, AXIS_OBJ_STORED_BIT_RATE) != FW_OK) {
    return LSS_STORE_FAILED;
  }
  const lss_t *lss = &fw->canopen.lss;
  if (!is_fixed(fw)) {
    fw->device.stored_node_id = lss->node_id;
  }
  fw->device.stored_bit_rate = lss_kbit_s(lss->next_rate);
  fw->device_signals.store_state = AXIS_STORE_STATE_SAVING;
  return LSS_STORED;
}

void lss_settings_serve(fw_t *fw, uint32_t ticks) {
  canopen_lss_tick(&fw->canopen, ticks);
  fw->device_signals.bit_rate = lss_kbit_s(fw->canopen.lss.rate);
  if (fw->canopen.lss.store == LSS_STORE_REQUESTED) {
    const uint8_t result = begin_store(fw);
    if (result == LSS_STORED) {
      fw->canopen.lss.store = LSS_STORE_RUNNING;
    } else {
      lss_stored(&fw->canopen, result);
    }
  }
}

void lss_settings_stored(fw_t *fw, uint8_t state) {
  if (fw->canopen.lss.store == LSS_STORE_RUNNING && state != AXIS_STORE_STATE_SAVING) {
    lss_stored(&fw->canopen, (state == AXIS_STORE_STATE_SAVED) ? LSS_STORED : LSS_STORE_FAILED);
  }
}
