#include "firmware/canopen/sdo.h"

#include <stdbool.h>
#include <stddef.h>

#include "firmware/canopen/sdo_block.h"
#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

/* CLIENT_: command specifiers of SDO requests, bits 5 to 7 of the first byte. SERVER_: first byte
 * of SDO responses, with the command specifier in bits 5 to 7. */
enum {
  CLIENT_DOWNLOAD_SEGMENT = 0,
  CLIENT_DOWNLOAD = 1,
  CLIENT_UPLOAD = 2,
  CLIENT_UPLOAD_SEGMENT = 3,
  CLIENT_ABORT = 4,
  CLIENT_BLOCK_UPLOAD = 5,
  CLIENT_BLOCK_DOWNLOAD = 6
};
enum {
  SERVER_UPLOAD_SEGMENT = 0x00,
  SERVER_DOWNLOAD_SEGMENT = 0x20,
  SERVER_UPLOAD = 0x40,
  SERVER_DOWNLOAD = 0x60
};
enum { EXPEDITED = 0x02, SIZED = 0x01, TOGGLE = 0x10, LAST = 0x01 };

/* Largest number of data bytes in an expedited request. Such a request contains the value itself.
 */
enum { EXPEDITED_BYTES = 4 };

static void abort_segment(const sdo_request_t *request, uint32_t code) {
  sdo_abort_transfer(request->canopen, request->number, code);
}

static void initiate_download(const sdo_request_t *request) {
  const uint8_t *data = request->data;
  const bool expedited = (data[0] & EXPEDITED) != 0;
  const bool sized = (data[0] & SIZED) != 0;
  const uint32_t size = expedited ? 4 - fx_field(data[0], 2, 2) : fx_load_le(data + 4, 4);
  uint32_t code = sdo_open_download(request, sized, size);
  if (code == 0 && expedited) {
    const uint32_t limit = request->server->limit;
    code = sdo_take(request, data + 4, (limit < EXPEDITED_BYTES) ? limit : EXPEDITED_BYTES);
    if (code == 0) {
      code = sdo_close(request);
    }
  }
  if (code != 0) {
    sdo_abort_request(request, code);
    return;
  }
  if (!expedited) {
    request->server->state = SDO_DOWNLOAD;
    sdo_await(request->canopen, request->number);
  }
  (void)sdo_answer(request->canopen, request->number, SERVER_DOWNLOAD, sdo_index(data), data[3]);
}

/* Checks a request for an upload segment or with a download segment. Returns 0 or an abort code. */
static uint32_t refuse_segment(const sdo_request_t *request, uint8_t state) {
  if (request->server->state != state) {
    return SDO_ABORT_COMMAND;
  }
  const bool toggled = (request->data[0] & TOGGLE) != 0;
  return (toggled == (request->server->toggle != 0)) ? 0 : SDO_ABORT_TOGGLE;
}

static void download_segment(const sdo_request_t *request) {
  sdo_server_t *server = request->server;
  const uint8_t command = request->data[0];
  uint32_t code = refuse_segment(request, SDO_DOWNLOAD);
  if (code == 0) {
    code = sdo_take(request, request->data + 1, SDO_SEGMENT_BYTES - fx_field(command, 1, 3));
  }
  if (code == 0 && (command & LAST) != 0) {
    code = sdo_close(request);
  }
  if (code != 0) {
    abort_segment(request, code);
    return;
  }
  const uint8_t toggle = (server->toggle != 0) ? TOGGLE : 0;
  server->toggle = (server->toggle != 0) ? 0 : 1;
  if ((command & LAST) != 0) {
    sdo_end(request->canopen, request->number);
  } else {
    sdo_await(request->canopen, request->number);
  }
  (void)sdo_answer(request->canopen, request->number, (uint8_t)(SERVER_DOWNLOAD_SEGMENT | toggle),
                   0, 0);
}

/* Answers an upload request. A value is sent in the answer itself (expedited transfer). All other
 * data are sent in segments. */
static void answer_upload(const sdo_request_t *request) {
  sdo_server_t *server = request->server;
  const bool expedited = server->what != AXIS_ADDRESS_TEXT && server->what != AXIS_ADDRESS_DOMAIN;
  const uint32_t command = expedited ? SERVER_UPLOAD + EXPEDITED + SIZED + (4 - server->size) * 4
                                     : SERVER_UPLOAD + SIZED;
  if (!expedited) {
    server->state = SDO_UPLOAD;
    sdo_await(request->canopen, request->number);
  }
  can_frame_t *frame =
      sdo_answer(request->canopen, request->number, (uint8_t)command, server->index, server->sub);
  if (frame == NULL) {
    return;
  }
  if (expedited) {
    sdo_read(request->canopen, request->objects, request->number, frame->data + 4, server->size);
  } else {
    fx_store_le(frame->data + 4, server->size, 4);
  }
}

static void initiate_upload(const sdo_request_t *request) {
  const uint32_t code = sdo_open_upload(request);
  if (code != 0) {
    sdo_abort_request(request, code);
  } else {
    answer_upload(request);
  }
}

static void upload_segment(const sdo_request_t *request) {
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
  const uint32_t count = (remaining < SDO_SEGMENT_BYTES) ? remaining : SDO_SEGMENT_BYTES;
  const bool last = remaining <= SDO_SEGMENT_BYTES;
  const uint32_t command = SERVER_UPLOAD_SEGMENT + ((server->toggle != 0) ? TOGGLE : 0u) +
                           (SDO_SEGMENT_BYTES - count) * 2 + (last ? LAST : 0u);
  can_frame_t *frame = sdo_answer(request->canopen, request->number, (uint8_t)command, 0, 0);
  if (frame != NULL) {
    sdo_read(request->canopen, request->objects, request->number, frame->data + 1, count);
  }
  server->offset += count;
  server->toggle = (server->toggle != 0) ? 0 : 1;
  if (last) {
    sdo_end(request->canopen, request->number);
  } else {
    sdo_await(request->canopen, request->number);
  }
}

static void begin_block_upload(const sdo_request_t *request) {
  const uint32_t code = sdo_open_upload(request);
  if (code != 0) {
    sdo_abort_request(request, code);
  } else if (sdo_block_prefers_segments(request)) {
    answer_upload(request);
  } else {
    sdo_block_offer(request);
  }
}

void sdo_receive(canopen_t *canopen, dictionary_t *objects, uint8_t server,
                 const can_frame_t *frame) {
  if (frame->length != 8) {
    return;
  }
  const sdo_request_t request = {.canopen = canopen,
                                 .objects = objects,
                                 .server = &canopen->sdo[server],
                                 .data = frame->data,
                                 .number = server};
  if (sdo_block_segment(&request)) {
    return;
  }
  switch (fx_field(frame->data[0], 5, 3)) {
    case CLIENT_DOWNLOAD:
      sdo_end(canopen, server);
      initiate_download(&request);
      break;
    case CLIENT_DOWNLOAD_SEGMENT:
      download_segment(&request);
      break;
    case CLIENT_UPLOAD:
      sdo_end(canopen, server);
      initiate_upload(&request);
      break;
    case CLIENT_UPLOAD_SEGMENT:
      upload_segment(&request);
      break;
    case CLIENT_ABORT:
      sdo_end(canopen, server);
      break;
    case CLIENT_BLOCK_UPLOAD:
      if (sdo_block_begins_upload(frame->data[0])) {
        sdo_end(canopen, server);
        begin_block_upload(&request);
      } else {
        sdo_block_upload(&request);
      }
      break;
    case CLIENT_BLOCK_DOWNLOAD:
      sdo_block_download(&request);
      break;
    default:
      sdo_abort_request(&request, SDO_ABORT_COMMAND);
      break;
  }
}

bool sdo_downloads_bytes(const canopen_t *canopen, uint8_t server) {
  const sdo_server_t *transfer = &canopen->sdo[server];
  const bool receives = transfer->state == SDO_DOWNLOAD || transfer->state >= SDO_BLOCK_AWAITED;
  return receives && transfer->what == AXIS_ADDRESS_DOWNLOAD;
}

void sdo_timeout(canopen_t *canopen, uint8_t server) {
  sdo_abort_transfer(canopen, server, SDO_ABORT_TIMEOUT);
}

void sdo_drop(canopen_t *canopen) {
  for (uint8_t i = 0; i < CANOPEN_SDOS; i++) {
    sdo_end(canopen, i);
  }
}

void sdo_domain_replaced(canopen_t *canopen, uint16_t index) {
  for (uint8_t i = 0; i < CANOPEN_SDOS; i++) {
    if (canopen->sdo[i].what == AXIS_ADDRESS_DOMAIN && canopen->sdo[i].index == index) {
      canopen->sdo[i].replaced = 1;
    }
  }
}
