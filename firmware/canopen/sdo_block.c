#include "firmware/canopen/sdo_block.h"

#include <stddef.h>

#include "firmware/fx/bytes.h"
#include "firmware/fx/fx.h"

/* SERVER_: command specifiers in the answers of block transfers. WITH_CRC, SIZED, UNUSED_UNIT: bits
 * in these answers and in the requests. */
enum {
  SERVER_DOWNLOAD = 0xA0,
  SERVER_DOWNLOAD_END = 0xA1,
  SERVER_DOWNLOAD_SEGMENT = 0xA2,
  SERVER_UPLOAD = 0xC0,
  SERVER_UPLOAD_END = 0xC1
};
enum { WITH_CRC = 0x04, SIZED = 0x02, UNUSED_UNIT = 4 };

/* UPLOAD_: subcommand in the two lowest bits of a block upload request. DOWNLOAD_END: subcommand in
 * the lowest bit of a block download request. */
enum { UPLOAD_BEGIN = 0, UPLOAD_END = 1, UPLOAD_ACKNOWLEDGE = 2, UPLOAD_START = 3 };
enum { DOWNLOAD_END = 1 };

/* Bits in the first byte of a segment. SEQUENCE: the number of the segment. LAST: bit 7, which is 1
 * in the last segment. */
enum { SEQUENCE = 0x7F, LAST = 0x80 };

/* Number of segments in a block of a download to an object with a value. One segment has room for
 * every value. */
enum { VALUE_BLOCK = 1 };

/* Number of segments in a block of a download to the flash. A segment is processed when the next
 * segment arrives. With this number, the first block contains the complete head of an update (64
 * bytes). So the client waits while the flash is erased, and no segment is lost. */
enum { FLASH_BLOCK = 11 };

static uint8_t block_of_download(const sdo_server_t *server) {
  if (server->what == AXIS_ADDRESS_OBJECT) {
    return VALUE_BLOCK;
  }
  return (server->index == DICTIONARY_UPDATE) ? FLASH_BLOCK : SDO_BLOCK_MOST;
}

static uint8_t command_of(uint8_t command) { return (uint8_t)fx_field(command, 0, 2); }

static bool is_block_size(uint8_t size) { return size >= 1 && size <= SDO_BLOCK_MOST; }

static uint16_t crc_of(uint16_t crc, const uint8_t *bytes, uint32_t count) {
  for (uint32_t i = 0; i < count; i++) {
    crc = fx_crc16_ccitt(crc, bytes[i]);
  }
  return crc;
}

/* Stores whether the client requests a CRC, and returns the bit that confirms the CRC in the
 * answer. A client checks the CRC only if the server offers one, so the server confirms only a
 * requested CRC. */
static uint8_t agree_crc(const sdo_request_t *request) {
  const uint8_t wanted = request->data[0] & WITH_CRC;
  request->server->with_crc = (wanted != 0) ? 1 : 0;
  return wanted;
}

static void abort_transfer(const sdo_request_t *request, uint32_t code) {
  sdo_abort_transfer(request->canopen, request->number, code);
}

/* Functions for SDO block uploads. */

bool sdo_block_begins_upload(uint8_t command) { return command_of(command) == UPLOAD_BEGIN; }

bool sdo_block_prefers_segments(const sdo_request_t *request) {
  return request->server->size <= request->data[5];
}

void sdo_block_offer(const sdo_request_t *request) {
  sdo_server_t *server = request->server;
  if (!is_block_size(request->data[4])) {
    sdo_abort_request(request, SDO_ABORT_BLOCK_SIZE);
    return;
  }
  server->state = SDO_BLOCK_OFFERED;
  server->block_size = request->data[4];
  server->block_begin = 0;
  server->sequence = 0;
  server->crc = 0;
  server->crc_end = 0;
  sdo_await(request->canopen, request->number);
  can_frame_t *frame =
      sdo_answer(request->canopen, request->number,
                 (uint8_t)(SERVER_UPLOAD | SIZED | agree_crc(request)), server->index, server->sub);
  if (frame != NULL) {
    fx_store_le(frame->data + 4, server->size, 4);
  }
}

/* Begins the next block of an upload. `offset` is the number of bytes that the client has
 * acknowledged. */
static void begin_block(const sdo_request_t *request, uint32_t offset) {
  sdo_server_t *server = request->server;
  server->state = SDO_BLOCK_SENDING;
  server->offset = offset;
  server->block_begin = offset;
  server->sequence = 0;
  canopen_put(&request->canopen->sdos_sending, request->number);
  sdo_await(request->canopen, request->number);
}

/* Ends an SDO upload after the client has acknowledged all segments. */
static void end_upload(const sdo_request_t *request) {
  sdo_server_t *server = request->server;
  const uint32_t last =
      server->size - (server->block_begin + (server->sequence - 1u) * SDO_SEGMENT_BYTES);
  server->state = SDO_BLOCK_ENDED;
  sdo_await(request->canopen, request->number);
  can_frame_t *frame =
      sdo_answer(request->canopen, request->number,
                 (uint8_t)(SERVER_UPLOAD_END + (SDO_SEGMENT_BYTES - last) * UNUSED_UNIT), 0, 0);
  if (frame != NULL && server->with_crc != 0) {
    fx_store_le(frame->data + 1, server->crc, 2);
  }
}

static void acknowledge(const sdo_request_t *request) {
  sdo_server_t *server = request->server;
  const uint8_t sequence = request->data[1];
  canopen_drop(&request->canopen->sdos_sending, request->number);
  if (sequence > server->sequence) {
    abort_transfer(request, SDO_ABORT_SEQUENCE);
    return;
  }
  const uint32_t offset = server->block_begin + (uint32_t)sequence * SDO_SEGMENT_BYTES;
  if (offset >= server->size) {
    end_upload(request);
  } else if (!is_block_size(request->data[2])) {
    abort_transfer(request, SDO_ABORT_BLOCK_SIZE);
  } else {
    server->block_size = request->data[2];
    begin_block(request, offset);
  }
}

void sdo_block_upload(const sdo_request_t *request) {
  const sdo_server_t *server = request->server;
  const uint8_t command = command_of(request->data[0]);
  const uint8_t state = server->state;
  if (command == UPLOAD_START && state == SDO_BLOCK_OFFERED) {
    begin_block(request, 0);
  } else if (command == UPLOAD_ACKNOWLEDGE &&
             (state == SDO_BLOCK_SENDING || state == SDO_BLOCK_SENT)) {
    acknowledge(request);
  } else if (command == UPLOAD_END && state == SDO_BLOCK_ENDED) {
    sdo_end(request->canopen, request->number);
  } else {
    abort_transfer(request, SDO_ABORT_COMMAND);
  }
}

static void send_segment(canopen_t *canopen, const dictionary_t *objects, uint8_t number) {
  sdo_server_t *server = &canopen->sdo[number];
  if (server->replaced != 0) {
    sdo_abort_transfer(canopen, number, SDO_ABORT_NO_DATA);
    return;
  }
  fx_assert(server->state == SDO_BLOCK_SENDING && server->offset < server->size);
  fx_assert(is_block_size(server->block_size) && server->sequence < server->block_size);
  const uint32_t remaining = server->size - server->offset;
  const bool last = remaining <= SDO_SEGMENT_BYTES;
  const uint32_t count = last ? remaining : SDO_SEGMENT_BYTES;
  server->sequence = (uint8_t)(server->sequence + 1);
  can_frame_t *frame =
      sdo_answer(canopen, number, (uint8_t)(server->sequence | (last ? LAST : 0)), 0, 0);
  if (frame != NULL) {
    sdo_read(canopen, objects, number, frame->data + 1, count);
    /* A segment that is sent a second time is added to the CRC only once. */
    if (server->crc_end == server->offset) {
      server->crc = crc_of(server->crc, frame->data + 1, count);
      server->crc_end += count;
    }
  }
  server->offset += count;
  if (last || server->sequence == server->block_size) {
    server->state = SDO_BLOCK_SENT;
    canopen_drop(&canopen->sdos_sending, number);
  }
  sdo_await(canopen, number);
}

static bool has_room(const can_output_t *output) {
  return output->closed == 0 && output->count < SDO_BLOCK_FRAMES;
}

void sdo_block_tick(canopen_t *canopen, const dictionary_t *objects) {
  while (canopen->sdos_sending != 0 && has_room(&canopen->output)) {
    for (uint8_t i = 0; i < CANOPEN_SDOS; i++) {
      if (canopen_has(canopen->sdos_sending, i) && has_room(&canopen->output)) {
        send_segment(canopen, objects, i);
      }
    }
  }
}

/* Functions for SDO block downloads. */

static void begin_download(const sdo_request_t *request) {
  const uint8_t *data = request->data;
  sdo_server_t *server = request->server;
  const bool sized = (data[0] & SIZED) != 0;
  const uint32_t code = sdo_open_download(request, sized, fx_load_le(data + 4, 4));
  if (code != 0) {
    sdo_abort_request(request, code);
    return;
  }
  server->state = SDO_BLOCK_AWAITED;
  server->block_size = block_of_download(server);
  server->sequence = 0;
  server->held = 0;
  server->crc = 0;
  sdo_await(request->canopen, request->number);
  can_frame_t *frame =
      sdo_answer(request->canopen, request->number, (uint8_t)(SERVER_DOWNLOAD | agree_crc(request)),
                 server->index, server->sub);
  if (frame != NULL) {
    frame->data[4] = server->block_size;
  }
}

/* The server holds the last received segment. Appends the first `count` bytes of this segment to
 * the download. Returns 0 or an abort code. */
static uint32_t take_held(const sdo_request_t *request, uint32_t count) {
  sdo_server_t *server = request->server;
  server->held = 0;
  server->crc = crc_of(server->crc, server->data, count);
  return sdo_take(request, server->data, count);
}

/* Processes the last segment of a download and ends the download. Returns 0 or an abort code. */
static uint32_t take_end(const sdo_request_t *request) {
  sdo_server_t *server = request->server;
  const uint32_t count = SDO_SEGMENT_BYTES - fx_field(request->data[0], 2, 3);
  uint32_t code = sdo_refuse_size(server, server->offset + count);
  if (code == 0) {
    code = take_held(request, count);
  }
  if (code == 0 && server->with_crc != 0 && fx_load_le(request->data + 1, 2) != server->crc) {
    code = SDO_ABORT_CRC;
  }
  return (code == 0) ? sdo_close(request) : code;
}

static void end_download(const sdo_request_t *request) {
  const uint32_t code =
      (request->server->state == SDO_BLOCK_RECEIVED) ? take_end(request) : SDO_ABORT_COMMAND;
  if (code != 0) {
    abort_transfer(request, code);
    return;
  }
  sdo_end(request->canopen, request->number);
  (void)sdo_answer(request->canopen, request->number, SERVER_DOWNLOAD_END, 0, 0);
}

void sdo_block_download(const sdo_request_t *request) {
  if ((request->data[0] & DOWNLOAD_END) != 0) {
    end_download(request);
  } else {
    sdo_end(request->canopen, request->number);
    begin_download(request);
  }
}

/* Acknowledges the segments of a block up to the first missing segment. The client sends the
 * missing segment and all later ones again, at the start of the next block. */
static void answer_block(const sdo_request_t *request, bool is_complete) {
  sdo_server_t *server = request->server;
  can_frame_t *frame = sdo_answer(request->canopen, request->number, SERVER_DOWNLOAD_SEGMENT, 0, 0);
  if (frame != NULL) {
    frame->data[1] = server->sequence;
    frame->data[2] = server->block_size;
  }
  server->state = is_complete ? SDO_BLOCK_RECEIVED : SDO_BLOCK_AWAITED;
  server->sequence = 0;
}

/* Holds a received segment. The next segment, or the end of the download, shows how many bytes of
 * the held segment are valid. Returns 0 or an abort code. */
static uint32_t hold_segment(const sdo_request_t *request, bool last) {
  sdo_server_t *server = request->server;
  const uint32_t code = (server->held != 0) ? take_held(request, SDO_SEGMENT_BYTES) : 0;
  if (code != 0) {
    return code;
  }
  if (!last && server->limit - server->offset <= SDO_SEGMENT_BYTES) {
    return SDO_ABORT_TOO_LONG;
  }
  for (uint8_t i = 0; i < SDO_SEGMENT_BYTES; i++) {
    server->data[i] = request->data[1 + i];
  }
  server->held = 1;
  server->sequence = (uint8_t)(server->sequence + 1);
  return 0;
}

static void receive_segment(const sdo_request_t *request) {
  const sdo_server_t *server = request->server;
  const uint8_t number = request->data[0] & SEQUENCE;
  const bool last = (request->data[0] & LAST) != 0;
  const bool follows = number == server->sequence + 1;
  uint32_t code = 0;
  if (number == 0 || number > server->block_size) {
    code = SDO_ABORT_SEQUENCE;
  } else if (follows) {
    code = hold_segment(request, last);
  }
  if (code != 0) {
    abort_transfer(request, code);
    return;
  }
  sdo_await(request->canopen, request->number);
  if (last || number == server->block_size) {
    answer_block(request, last && follows);
  }
}

bool sdo_block_segment(const sdo_request_t *request) {
  sdo_server_t *server = request->server;
  const uint8_t head = request->data[0];
  const bool is_repeated = server->state == SDO_BLOCK_RECEIVED &&
                           server->block_size == VALUE_BLOCK && head == (LAST | VALUE_BLOCK);
  /* No segment of an SDO block has the number 0, so a frame with this number is an abort. */
  if ((server->state != SDO_BLOCK_AWAITED && !is_repeated) || head == LAST) {
    return false;
  }
  if (is_repeated) {
    server->held = 0;
  }
  receive_segment(request);
  return true;
}
