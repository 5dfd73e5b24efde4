#include "firmware/canopen/sdo_transfer.h"

#include <stddef.h>

#include "firmware/canopen/cob_id.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/value.h"

/* Command specifier of an SDO abort message. */
enum { SERVER_ABORT = 0x80 };

/* The two COB-IDs of one SDO server: the COB-ID of its requests and the COB-ID of its answers. */
typedef struct {
  uint32_t receive;
  uint32_t transmit;
} channel_t;

static channel_t channel_of(const canopen_t *canopen, uint8_t server) {
  const canopen_signals_t *signals = &canopen->signals;
  const canopen_params_t *params = &canopen->params;
  switch (server) {
    case 0:
      return (channel_t){signals->sdo_server_receive, signals->sdo_server_transmit};
    case 1:
      return (channel_t){params->sdo_modbus_receive, params->sdo_modbus_transmit};
    default:
      return (channel_t){params->sdo_lcm_receive, params->sdo_lcm_transmit};
  }
}

static bool is_valid(channel_t channel) {
  return canopen_cob_valid(channel.receive) && canopen_cob_valid(channel.transmit);
}

uint8_t sdo_server_at(const canopen_t *canopen, uint16_t id) {
  for (uint8_t i = 0; i < CANOPEN_SDOS; i++) {
    const channel_t channel = channel_of(canopen, i);
    if (is_valid(channel) && canopen_can_id(channel.receive) == id) {
      return i;
    }
  }
  return CANOPEN_SDOS;
}

bool sdo_transmits(const canopen_t *canopen, uint16_t id) {
  for (uint8_t i = 0; i < CANOPEN_SDOS; i++) {
    const channel_t channel = channel_of(canopen, i);
    if (is_valid(channel) && canopen_can_id(channel.transmit) == id) {
      return true;
    }
  }
  return false;
}

/* The objects with COB-IDs of SDO servers that a client can write. They are the COB_IDS objects of
 * the object table that begin with COB_ID_FIRST. */
enum {
  COB_IDS = 4,
  COB_ID_FIRST = AXIS_OBJ_SDO_MODBUS_RECEIVE,
};
_Static_assert(AXIS_OBJ_SDO_LCM_TRANSMIT == COB_ID_FIRST + COB_IDS - 1,
               "two servers, both directions");

bool sdo_uses(const canopen_t *canopen, uint16_t object, uint16_t id) {
  const int place = canopen_element(object, COB_ID_FIRST, COB_IDS);
  bool found = false;
  for (int i = 0; i < CANOPEN_SDOS; i++) {
    const channel_t channel = channel_of(canopen, (uint8_t)i);
    /* index of the first COB-ID object of this server; negative for the default server, whose
     * COB-IDs cannot be written */
    const int first = 2 * (i - 1);
    found = found || (place != first && canopen_cob_is(channel.receive, id)) ||
            (place != first + 1 && canopen_cob_is(channel.transmit, id));
  }
  return found;
}

int sdo_check(const canopen_t *canopen, uint16_t object, uint32_t wanted) {
  const int place = canopen_element(object, COB_ID_FIRST, COB_IDS);
  if (place < 0) {
    return FW_OK;
  }
  const channel_t channel = channel_of(canopen, (place < 2) ? 1 : 2);
  const bool is_receive = (place & 1) == 0;
  return canopen_check_cob_id(is_receive ? channel.receive : channel.transmit, wanted);
}

void sdo_written(canopen_t *canopen, uint16_t object) {
  const int place = canopen_element(object, COB_ID_FIRST, COB_IDS);
  if (place >= 0) {
    sdo_end(canopen, (place < 2) ? 1 : 2);
  }
}

can_frame_t *sdo_answer(canopen_t *canopen, uint8_t server, uint8_t command, uint16_t index,
                        uint8_t sub) {
  const uint16_t id = canopen_can_id(channel_of(canopen, server).transmit);
  can_frame_t *frame = can_output_add(&canopen->output, id, 8, CAN_OUTPUT_KEEP_SDO);
  if (frame != NULL) {
    frame->data[0] = command;
    fx_store_le(frame->data + 1, index, 2);
    frame->data[3] = sub;
  }
  return frame;
}

void sdo_end(canopen_t *canopen, uint8_t server) {
  canopen->sdo[server].state = SDO_IDLE;
  canopen_drop(&canopen->sdos_sending, server);
  canopen_timer_stop(&canopen->timers, CANOPEN_TIMER_SDO + (uint32_t)server);
}

static void send_abort(canopen_t *canopen, uint8_t server, uint16_t index, uint8_t sub,
                       uint32_t code) {
  sdo_end(canopen, server);
  can_frame_t *frame = sdo_answer(canopen, server, SERVER_ABORT, index, sub);
  if (frame != NULL) {
    fx_store_le(frame->data + 4, code, 4);
  }
}

void sdo_abort_request(const sdo_request_t *request, uint32_t code) {
  send_abort(request->canopen, request->number, sdo_index(request->data), request->data[3], code);
}

void sdo_abort_transfer(canopen_t *canopen, uint8_t server, uint32_t code) {
  const sdo_server_t *transfer = &canopen->sdo[server];
  const bool pending = transfer->state != SDO_IDLE;
  send_abort(canopen, server, pending ? transfer->index : 0, pending ? transfer->sub : 0, code);
}

void sdo_await(canopen_t *canopen, uint8_t server) {
  canopen_timer_start(&canopen->timers, CANOPEN_TIMER_SDO + (uint32_t)server,
                      fx_ticks_from_ms(SDO_TIMEOUT_MS));
}

uint16_t sdo_index(const uint8_t *data) { return (uint16_t)fx_load_le(data + 1, 2); }

/* Returns true if any object has the index `index`. */
static bool has_index(uint16_t index) {
  return dictionary_address(index, 0) != NULL || dictionary_address(index, 1) != NULL;
}

static const uint32_t abort_of_refusal[] = {
    [-FW_ERROR_NO_OBJECT] = SDO_ABORT_NO_OBJECT,   [-FW_ERROR_READ_ONLY] = SDO_ABORT_READ_ONLY,
    [-FW_ERROR_WRITE_ONLY] = SDO_ABORT_WRITE_ONLY, [-FW_ERROR_RANGE] = SDO_ABORT_VALUE,
    [-FW_ERROR_STATE] = SDO_ABORT_STATE,           [-FW_ERROR_NO_DATA] = SDO_ABORT_NO_DATA,
    [-FW_ERROR_LOCKED] = SDO_ABORT_LOCKED,         [-FW_ERROR_BUSY] = SDO_ABORT_STATE,
    [-FW_ERROR_MAPPING] = SDO_ABORT_MAPPING,       [-FW_ERROR_NO_MEMORY] = SDO_ABORT_HARDWARE,
};

static bool is_above(const axis_object_t *entry, int32_t value, int32_t limit) {
  return (entry->type == AXIS_TYPE_U32) ? (uint32_t)value > (uint32_t)limit : value > limit;
}

/* Returns the abort code of CiA 301 that describes a refused write most exactly. */
static uint32_t abort_of(uint16_t object, int32_t value, int refusal) {
  const axis_object_t *entry = &axis_objects[object];
  if (refusal == FW_ERROR_RANGE) {
    if (object == AXIS_OBJ_STORE_ALL || object == AXIS_OBJ_RESTORE_ALL) {
      return SDO_ABORT_SIGNATURE;
    }
    if (object == AXIS_OBJ_ERROR_HISTORY_COUNT) {
      /* CiA 301 requires this abort code if a value other than 0 is written to 1003h:00 */
      return SDO_ABORT_VALUE;
    }
    if (is_above(entry, value, entry->max)) {
      return SDO_ABORT_TOO_HIGH;
    }
    if (is_above(entry, entry->min, value)) {
      return SDO_ABORT_TOO_LOW;
    }
  }
  if (refusal == FW_ERROR_MAPPING) {
    if (canopen_element(object, AXIS_OBJ_CONSUMER_HEARTBEAT_1, CANOPEN_HEARTBEATS) >= 0) {
      return SDO_ABORT_PARAMETER;
    }
    if (canopen_element(object, AXIS_OBJ_RPDO_MAPPED_1, CANOPEN_PDOS) >= 0 ||
        canopen_element(object, AXIS_OBJ_TPDO_MAPPED_1, CANOPEN_PDOS) >= 0) {
      return SDO_ABORT_PDO_LENGTH;
    }
  }
  return abort_of_refusal[-refusal];
}

static uint32_t write_value(const sdo_request_t *request) {
  const sdo_server_t *server = request->server;
  const uint16_t object = server->object;
  const uint8_t type = axis_objects[object].type;
  const int32_t value = value_from_bits(fx_load_le(server->data, value_bytes(type)), type);
  const int result = dictionary_write(request->objects, request->number, object, value);
  return (result == FW_OK) ? 0 : abort_of(object, value, result);
}

/* Returns the abort code for the result of a download that is a stream of bytes and no value; 0: no
 * error. */
static uint32_t abort_of_download(int result) {
  if (result == FW_OK) {
    return 0;
  }
  return (result == FW_ERROR_NO_MEMORY) ? SDO_ABORT_MEMORY : abort_of_refusal[-result];
}

uint32_t sdo_take(const sdo_request_t *request, const uint8_t *bytes, uint32_t count) {
  sdo_server_t *server = request->server;
  int result = FW_OK;
  if (count > server->limit - server->offset) {
    return SDO_ABORT_TOO_LONG;
  }
  if (server->what == AXIS_ADDRESS_DOWNLOAD) {
    result =
        dictionary_download_append(request->objects, request->number, server->offset, bytes, count);
  } else {
    for (uint32_t i = 0; i < count; i++) {
      server->data[server->offset + i] = bytes[i];
    }
  }
  server->offset += count;
  return abort_of_download(result);
}

uint32_t sdo_refuse_size(const sdo_server_t *server, uint32_t size) {
  if (server->sized != 0 && size != server->size) {
    return SDO_ABORT_LENGTH;
  }
  if (size > server->limit) {
    return SDO_ABORT_TOO_LONG;
  }
  return (server->what == AXIS_ADDRESS_OBJECT && size < server->limit) ? SDO_ABORT_TOO_SHORT : 0;
}

uint32_t sdo_close(const sdo_request_t *request) {
  const sdo_server_t *server = request->server;
  const uint32_t code = sdo_refuse_size(server, server->offset);
  if (code != 0) {
    return code;
  }
  return (server->what == AXIS_ADDRESS_DOWNLOAD)
             ? abort_of_download(dictionary_download_end(request->objects, request->number,
                                                         server->index, server->offset))
             : write_value(request);
}

/* Begins a download of `size` bytes that is a stream of bytes and no value. Returns 0, or an abort
 * code if the download is refused. */
static uint32_t refuse_bytes(const sdo_request_t *request, uint16_t index, bool sized,
                             uint32_t size) {
  const uint32_t most = dictionary_download_most(request->objects, index);
  if (most == 0) {
    return SDO_ABORT_MEMORY;
  }
  if (sized && size > most) {
    return SDO_ABORT_TOO_LONG;
  }
  return abort_of_download(
      dictionary_download_begin(request->objects, request->number, index, sized ? size : 0));
}

/* Returns 0, or an abort code if a download of `size` bytes to `address` is not permitted. */
static uint32_t refuse_download(const sdo_request_t *request, const axis_address_t *address,
                                bool sized, uint32_t size) {
  if (address == NULL) {
    return has_index(sdo_index(request->data)) ? SDO_ABORT_NO_SUB : SDO_ABORT_NO_OBJECT;
  }
  if (address->what == AXIS_ADDRESS_DOWNLOAD) {
    return refuse_bytes(request, address->index, sized, size);
  }
  /* The access is checked before the length, so that a write to a read-only object has the same
   * abort code for every length. */
  if (address->what != AXIS_ADDRESS_OBJECT ||
      axis_objects[address->value].access == AXIS_ACCESS_RO) {
    return SDO_ABORT_READ_ONLY;
  }
  const uint32_t bytes = value_bytes(axis_objects[address->value].type);
  if (sized && size != bytes) {
    return (size > bytes) ? SDO_ABORT_TOO_LONG : SDO_ABORT_TOO_SHORT;
  }
  return 0;
}

uint32_t sdo_open_download(const sdo_request_t *request, bool sized, uint32_t size) {
  sdo_server_t *server = request->server;
  const axis_address_t *address = dictionary_address(sdo_index(request->data), request->data[3]);
  const uint32_t code = refuse_download(request, address, sized, size);
  if (code == 0) {
    const bool is_value = address->what == AXIS_ADDRESS_OBJECT;
    server->limit = is_value ? value_bytes(axis_objects[address->value].type)
                    : sized  ? size
                             : dictionary_download_most(request->objects, address->index);
    server->what = address->what;
    server->index = address->index;
    server->sub = address->sub;
    server->object = address->value;
    server->size = size;
    server->sized = sized ? 1 : 0;
    server->offset = 0;
    server->toggle = 0;
  }
  return code;
}

/* Returns true if `object` is an entry of the error history, and this entry contains no error. */
static bool is_empty(const canopen_t *canopen, uint16_t object) {
  return canopen_element(object, AXIS_OBJ_ERROR_HISTORY_1, EMCY_HISTORY) >=
         canopen->params.error_history_count;
}

/* Reads the value of an object. Returns FW_OK or the reason for the refusal. */
static int read_value(const sdo_request_t *request, uint16_t object, int32_t *value) {
  return is_empty(request->canopen, object) ? FW_ERROR_NO_DATA
                                            : dictionary_read(request->objects, object, value);
}

/* Returns the length of a text in bytes, without its final zero. */
static uint32_t length_of(const char *text) {
  uint32_t length = 0;
  while (text[length] != 0) {
    length++;
  }
  return length;
}

/* Finds the data that an upload of `address` sends. If the data are a value, copies the bytes of
 * the value. Returns 0 or an abort code. */
static uint32_t open_address(const sdo_request_t *request, const axis_address_t *address) {
  sdo_server_t *server = request->server;
  if (address->what == AXIS_ADDRESS_TEXT) {
    server->size = length_of(dictionary_text(request->objects, address->index));
    return 0;
  }
  if (address->what == AXIS_ADDRESS_DOWNLOAD) {
    return SDO_ABORT_WRITE_ONLY;
  }
  if (address->what == AXIS_ADDRESS_DOMAIN) {
    const int32_t size = dictionary_domain_size(request->objects, address->index);
    server->size = (uint32_t)size;
    return (size < 0) ? abort_of_refusal[-size] : 0;
  }
  int32_t value = address->value;
  server->size = 1;
  if (address->what == AXIS_ADDRESS_OBJECT) {
    server->size = value_bytes(axis_objects[address->value].type);
    const int result = read_value(request, address->value, &value);
    if (result != FW_OK) {
      return abort_of_refusal[-result];
    }
  }
  fx_store_le(server->data, (uint32_t)value, 4);
  return 0;
}

uint32_t sdo_open_upload(const sdo_request_t *request) {
  const uint16_t index = sdo_index(request->data);
  const axis_address_t *address = dictionary_address(index, request->data[3]);
  if (address == NULL) {
    return has_index(index) ? SDO_ABORT_NO_SUB : SDO_ABORT_NO_OBJECT;
  }
  sdo_server_t *server = request->server;
  server->index = index;
  server->sub = request->data[3];
  server->what = address->what;
  server->offset = 0;
  server->toggle = 0;
  server->replaced = 0;
  return open_address(request, address);
}

void sdo_read(const canopen_t *canopen, const dictionary_t *objects, uint8_t server, uint8_t *bytes,
              uint32_t count) {
  const sdo_server_t *transfer = &canopen->sdo[server];
  if (transfer->what == AXIS_ADDRESS_DOMAIN) {
    (void)dictionary_domain_read(objects, transfer->index, transfer->offset, bytes, count);
    return;
  }
  const bool is_text = transfer->what == AXIS_ADDRESS_TEXT;
  const char *text = is_text ? dictionary_text(objects, transfer->index) : NULL;
  for (uint32_t i = 0; i < count; i++) {
    bytes[i] = is_text ? (uint8_t)text[transfer->offset + i] : transfer->data[transfer->offset + i];
  }
}
