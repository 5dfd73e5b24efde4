#include "firmware/canopen/sdo.h"

#include <stdbool.h>
#include <stddef.h>

#include "firmware/canopen/cob_id.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"
#include "firmware/objects/value.h"

/* Command specifiers: of a request (client), and of a response (server) in bits 5 to 7. */
enum {
  CLIENT_DOWNLOAD_SEGMENT = 0,
  CLIENT_DOWNLOAD = 1,
  CLIENT_UPLOAD = 2,
  CLIENT_UPLOAD_SEGMENT = 3,
  CLIENT_ABORT = 4
};
enum {
  SERVER_UPLOAD_SEGMENT = 0x00,
  SERVER_DOWNLOAD_SEGMENT = 0x20,
  SERVER_UPLOAD = 0x40,
  SERVER_DOWNLOAD = 0x60,
  SERVER_ABORT = 0x80
};
enum { EXPEDITED = 0x02, SIZED = 0x01, TOGGLE = 0x10, LAST = 0x01, SEGMENT_BYTES = 7 };

/* Context of one request. */
typedef struct {
  canopen_t *canopen;
  dictionary_t *objects;
  sdo_server_t *server;
  const uint8_t *data;
  uint8_t number;
} request_t;

/* COB-IDs of a server, both ways. */
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

/* A response with command specifier, index and sub-index. */
static can_frame_t *answer(canopen_t *canopen, uint8_t server, uint8_t command, uint16_t index,
                           uint8_t sub) {
  can_frame_t *frame =
      can_output_add(&canopen->output, canopen_can_id(channel_of(canopen, server).transmit), 8,
                     CAN_OUTPUT_KEEP_SDO);
  if (frame != NULL) {
    frame->data[0] = command;
    fx_store_le(frame->data + 1, index, 2);
    frame->data[3] = sub;
  }
  return frame;
}

static void end(canopen_t *canopen, uint8_t number) {
  canopen->sdo[number].state = SDO_IDLE;
  canopen_timer_stop(&canopen->timers, CANOPEN_TIMER_SDO + (uint32_t)number);
}

static void abort_transfer(canopen_t *canopen, uint8_t number, uint16_t index, uint8_t sub,
                           uint32_t code) {
  end(canopen, number);
  can_frame_t *frame = answer(canopen, number, SERVER_ABORT, index, sub);
  if (frame != NULL) {
    fx_store_le(frame->data + 4, code, 4);
  }
}

static void start_timer(const request_t *request) {
  canopen_timer_start(&request->canopen->timers, CANOPEN_TIMER_SDO + (uint32_t)request->number,
                      fx_ticks_from_ms(SDO_TIMEOUT_MS));
}

/* Index and sub-index of an initiate request. */
static uint16_t index_of(const uint8_t *data) { return (uint16_t)fx_load_le(data + 1, 2); }

static void abort_initiate(const request_t *request, uint32_t code) {
  abort_transfer(request->canopen, request->number, index_of(request->data), request->data[3],
                 code);
}

static void abort_segment(const request_t *request, uint32_t code) {
  const sdo_server_t *server = request->server;
  const bool pending = server->state != SDO_IDLE;
  abort_transfer(request->canopen, request->number, pending ? server->index : 0,
                 pending ? server->sub : 0, code);
}

/* Whether any object has this index. */
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

/* The abort code of a refusal, the most specific one that CiA 301 defines. */
static uint32_t abort_of(uint16_t object, int32_t value, int refusal) {
  const axis_object_t *entry = &axis_objects[object];
  if (refusal == FW_ERROR_RANGE) {
    if (object == AXIS_OBJ_STORE_ALL || object == AXIS_OBJ_RESTORE_ALL) {
      return SDO_ABORT_SIGNATURE;
    }
    if (object == AXIS_OBJ_ERROR_HISTORY_COUNT) {
      return SDO_ABORT_VALUE; /* CiA 301 asks for this one: only 0 may be written */
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

/* Writes the bytes of a complete download; returns 0 or an abort code. */
static uint32_t write_value(const request_t *request, uint16_t object, const uint8_t *bytes) {
  const uint8_t type = axis_objects[object].type;
  const int32_t value = value_from_bits(fx_load_le(bytes, value_bytes(type)), type);
  const int result = dictionary_write(request->objects, request->number, object, value);
  return (result == FW_OK) ? 0 : abort_of(object, value, result);
}

/* 0, or the abort code of a download of this length to this address. */
static uint32_t refuse_download(const request_t *request, const axis_address_t *address, bool sized,
                                uint32_t size) {
  if (address == NULL) {
    return has_index(index_of(request->data)) ? SDO_ABORT_NO_SUB : SDO_ABORT_NO_OBJECT;
  }
  /* Checked first: a read-only object aborts as such at every length. */
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

static void initiate_download(const request_t *request) {
  const uint8_t *data = request->data;
  const bool expedited = (data[0] & EXPEDITED) != 0;
  const bool sized = (data[0] & SIZED) != 0;
  const uint32_t size = expedited ? 4 - fx_field(data[0], 2, 2) : fx_load_le(data + 4, 4);
  const uint16_t index = index_of(data);
  const axis_address_t *address = dictionary_address(index, data[3]);
  uint32_t code = refuse_download(request, address, sized, size);
  if (code == 0 && expedited) {
    code = write_value(request, address->value, data + 4);
  }
  if (code != 0) {
    abort_initiate(request, code);
    return;
  }
  if (!expedited) {
    sdo_server_t *server = request->server;
    server->state = SDO_DOWNLOAD;
    server->index = index;
    server->sub = data[3];
    server->object = address->value;
    server->size = size;
    server->sized = sized ? 1 : 0;
    server->offset = 0;
    server->toggle = 0;
    start_timer(request);
  }
  (void)answer(request->canopen, request->number, SERVER_DOWNLOAD, index, data[3]);
}

/* Checks common to upload and download segments: 0 or an abort code. */
static uint32_t refuse_segment(const request_t *request, uint8_t state) {
  if (request->server->state != state) {
    return SDO_ABORT_COMMAND;
  }
  const bool toggled = (request->data[0] & TOGGLE) != 0;
  return (toggled == (request->server->toggle != 0)) ? 0 : SDO_ABORT_TOGGLE;
}

static void download_segment(const request_t *request) {
  sdo_server_t *server = request->server;
  const uint8_t command = request->data[0];
  uint32_t code = refuse_segment(request, SDO_DOWNLOAD);
  if (code == 0) {
    const uint32_t count = SEGMENT_BYTES - fx_field(command, 1, 3);
    const uint32_t bytes = value_bytes(axis_objects[server->object].type);
    if (server->offset + count > bytes) {
      code = SDO_ABORT_TOO_LONG;
    } else {
      for (uint32_t i = 0; i < count; i++) {
        server->data[server->offset + i] = request->data[1 + i];
      }
      server->offset += count;
      if ((command & LAST) != 0) {
        code = (server->offset == bytes) ? write_value(request, server->object, server->data)
               : (server->sized != 0)    ? SDO_ABORT_LENGTH
                                         : SDO_ABORT_TOO_SHORT;
      }
    }
  }
  if (code != 0) {
    abort_segment(request, code);
    return;
  }
  const uint8_t toggle = (server->toggle != 0) ? TOGGLE : 0;
  server->toggle = (server->toggle != 0) ? 0 : 1;
  if ((command & LAST) != 0) {
    end(request->canopen, request->number);
  } else {
    start_timer(request);
  }
  (void)answer(request->canopen, request->number, (uint8_t)(SERVER_DOWNLOAD_SEGMENT | toggle), 0,
               0);
}

/* Up to 4 bytes are uploaded expedited. */
static void upload_value(const request_t *request, uint32_t value, uint32_t bytes) {
  can_frame_t *frame = answer(request->canopen, request->number,
                              (uint8_t)(SERVER_UPLOAD | EXPEDITED | SIZED | ((4 - bytes) * 4)),
                              index_of(request->data), request->data[3]);
  if (frame != NULL) {
    fx_store_le(frame->data + 4, value, (uint8_t)bytes);
  }
}

static void begin_upload(const request_t *request, uint8_t what, uint32_t size) {
  sdo_server_t *server = request->server;
  server->state = SDO_UPLOAD;
  server->index = index_of(request->data);
  server->sub = request->data[3];
  server->what = what;
  server->size = size;
  server->offset = 0;
  server->toggle = 0;
  server->replaced = 0;
  start_timer(request);
  can_frame_t *frame =
      answer(request->canopen, request->number, SERVER_UPLOAD | SIZED, server->index, server->sub);
  if (frame != NULL) {
    fx_store_le(frame->data + 4, size, 4);
  }
}

static void upload_text(const request_t *request) {
  const char *text = dictionary_text(request->objects, index_of(request->data));
  uint32_t size = 0;
  while (text[size] != 0) {
    size++;
  }
  begin_upload(request, AXIS_ADDRESS_TEXT, size);
}

/* Whether the object is an entry of the error history that holds no error. */
static bool is_empty(const canopen_t *canopen, uint16_t object) {
  return canopen_element(object, AXIS_OBJ_ERROR_HISTORY_1, EMCY_HISTORY) >=
         canopen->params.error_history_count;
}

static void initiate_upload(const request_t *request) {
  const uint16_t index = index_of(request->data);
  const axis_address_t *address = dictionary_address(index, request->data[3]);
  if (address == NULL) {
    abort_initiate(request, has_index(index) ? SDO_ABORT_NO_SUB : SDO_ABORT_NO_OBJECT);
    return;
  }
  if (address->what == AXIS_ADDRESS_COUNT) {
    upload_value(request, address->value, 1);
    return;
  }
  if (address->what == AXIS_ADDRESS_TEXT) {
    upload_text(request);
    return;
  }
  if (address->what == AXIS_ADDRESS_DOMAIN) {
    const uint32_t size = dictionary_domain_size(request->objects);
    if (size == 0) {
      abort_initiate(request, SDO_ABORT_NO_DATA);
    } else {
      begin_upload(request, AXIS_ADDRESS_DOMAIN, size);
    }
    return;
  }
  int32_t value = 0;
  const int result = is_empty(request->canopen, address->value)
                         ? FW_ERROR_NO_DATA
                         : dictionary_read(request->objects, address->value, &value);
  if (result != FW_OK) {
    abort_initiate(request, abort_of_refusal[-result]);
  } else {
    upload_value(request, (uint32_t)value, value_bytes(axis_objects[address->value].type));
  }
}

static void upload_segment(const request_t *request) {
  sdo_server_t *server = request->server;
  uint32_t code = refuse_segment(request, SDO_UPLOAD);
  if (code == 0 && server->replaced != 0) {
    code = SDO_ABORT_NO_DATA;
  }
  if (code != 0) {
    abort_segment(request, code);
    return;
  }
  const uint32_t remaining = server->size - server->offset;
  const uint32_t count = (remaining < SEGMENT_BYTES) ? remaining : SEGMENT_BYTES;
  const bool last = remaining <= SEGMENT_BYTES;
  const uint32_t command = SERVER_UPLOAD_SEGMENT + ((server->toggle != 0) ? TOGGLE : 0u) +
                           (SEGMENT_BYTES - count) * 2 + (last ? LAST : 0u);
  can_frame_t *frame = answer(request->canopen, request->number, (uint8_t)command, 0, 0);
  if (frame != NULL && server->what == AXIS_ADDRESS_DOMAIN) {
    (void)dictionary_domain_read(request->objects, server->offset, frame->data + 1, count);
  } else if (frame != NULL) {
    const char *text = dictionary_text(request->objects, server->index);
    for (uint32_t i = 0; i < count; i++) {
      frame->data[1 + i] = (uint8_t)text[server->offset + i];
    }
  }
  server->offset += count;
  server->toggle = (server->toggle != 0) ? 0 : 1;
  if (last) {
    end(request->canopen, request->number);
  } else {
    start_timer(request);
  }
}

void sdo_receive(canopen_t *canopen, dictionary_t *objects, uint8_t server,
                 const can_frame_t *frame) {
  if (frame->length != 8) {
    return;
  }
  const request_t request = {.canopen = canopen,
                             .objects = objects,
                             .server = &canopen->sdo[server],
                             .data = frame->data,
                             .number = server};
  switch (fx_field(frame->data[0], 5, 3)) {
    case CLIENT_DOWNLOAD:
      end(canopen, server);
      initiate_download(&request);
      break;
    case CLIENT_DOWNLOAD_SEGMENT:
      download_segment(&request);
      break;
    case CLIENT_UPLOAD:
      end(canopen, server);
      initiate_upload(&request);
      break;
    case CLIENT_UPLOAD_SEGMENT:
      upload_segment(&request);
      break;
    case CLIENT_ABORT:
      end(canopen, server);
      break;
    default:
      abort_initiate(&request, SDO_ABORT_COMMAND);
      break;
  }
}

void sdo_timeout(canopen_t *canopen, uint8_t server) {
  const sdo_server_t *transfer = &canopen->sdo[server];
  abort_transfer(canopen, server, transfer->index, transfer->sub, SDO_ABORT_TIMEOUT);
}

/* Objects of the servers that can be written, in the order of the table. */
enum {
  COB_IDS = 4,
  COB_ID_FIRST = AXIS_OBJ_SDO_MODBUS_RECEIVE,
};
_Static_assert(AXIS_OBJ_SDO_LCM_TRANSMIT == COB_ID_FIRST + COB_IDS - 1, "two servers, both ways");

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
    end(canopen, (place < 2) ? 1 : 2);
  }
}

void sdo_drop(canopen_t *canopen) {
  for (uint8_t i = 0; i < CANOPEN_SDOS; i++) {
    end(canopen, i);
  }
}

void sdo_recording_replaced(canopen_t *canopen) {
  for (uint8_t i = 0; i < CANOPEN_SDOS; i++) {
    if (canopen->sdo[i].what == AXIS_ADDRESS_DOMAIN) {
      canopen->sdo[i].replaced = 1;
    }
  }
}
