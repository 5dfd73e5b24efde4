/* Any frames to the SDO servers and to network management, any ticks between them: no answer is
 * malformed, and none comes unasked but what a time-out gives and the segments of a block. An
 * upload by blocks gives every byte and the right CRC, and a download by blocks puts every byte
 * into the library, whichever segments are lost. */

#include "firmware/canopen/sdo.h"
#include "tests/firmware/fuzz/node.h"

enum { SAMPLES = 200, BYTES = 4 * SAMPLES };

static const uint16_t requests[] = {0x605, 0x680, 0x682};
static const uint16_t answers[] = {0x585, 0x681, 0x683};

static int server_of(uint16_t id) {
  for (int i = 0; i < 3; i++) {
    if (answers[i] == id) {
      return i;
    }
  }
  return -1;
}

/* Takes what the node sends; returns how many answers the server gave. */
static int drain(node_t *node, int server) {
  can_frame_t frame;
  int count = 0;
  while (fw_can_transmit(&node->fw, &frame)) {
    require(frame.length <= 8 && frame.remote == 0 && frame.id <= 0x7FF);
    const int from = server_of(frame.id);
    if (from < 0) {
      continue;
    }
    /* A TPDO may have been given the identifier, but for the default server's. */
    require(from != 0 || frame.length == 8);
    /* An abort has a code of CiA 301; no segment has the number 0. */
    require(from != 0 || frame.data[0] != 0x80 || (frame.data[7] >= 5 && frame.data[7] <= 8));
    count += (from == server) ? 1 : 0;
  }
  return count;
}

/* The two servers of a gateway, which the input may switch off again. */
static void enable_servers(node_t *node) {
  for (uint16_t i = 0; i < 4; i++) {
    (void)fw_object_write(&node->fw, FW_SOURCE_LOCAL, (uint16_t)(AXIS_OBJ_SDO_MODBUS_RECEIVE + i),
                          0x680 + i);
  }
}

/* CRC-16 bit by bit. */
static uint16_t crc_of(const uint8_t *bytes, uint32_t count) {
  uint32_t crc = 0;
  for (uint32_t bit = 0; bit < 8 * count; bit++) {
    const uint32_t one = (crc >> 15 ^ (uint32_t)bytes[bit / 8] >> (7 - bit % 8)) & 1;
    crc = (crc << 1 ^ (one != 0 ? 0x1021u : 0)) & 0xFFFF;
  }
  return (uint16_t)crc;
}

static void ask(node_t *node, uint8_t a, uint8_t b, uint8_t c, uint8_t d, uint8_t block) {
  const uint8_t data[8] = {a, b, c, d, block, 0, 0, 0};
  node_send(node, requests[0], data, 8);
}

/* The answer of the default server, or none (length 0). */
static can_frame_t next_answer(node_t *node) {
  can_frame_t frame;
  while (fw_can_transmit(&node->fw, &frame)) {
    if (frame.id == answers[0]) {
      return frame;
    }
  }
  return (can_frame_t){0};
}

/* Uploads the recording by blocks whose sizes and losses are given by `seed`. */
static void upload_blocks(node_t *node, uint32_t seed) {
  static uint8_t expected[FW_RECORDER_BYTES];
  static uint8_t got[FW_RECORDER_BYTES + 8];
  const uint8_t state = node->fw.canopen.signals.nmt_state;
  const int found = dictionary_domain_size(&node->fw.objects, DICTIONARY_RECORDING);
  const uint32_t size = (found < 0) ? 0 : (uint32_t)found;
  if (size == 0 || size > BYTES || (state != 5 && state != 127) ||
      node->fw.canopen.sdo[0].state == SDO_BLOCK_AWAITED) {
    return;
  }
  require(dictionary_domain_read(&node->fw.objects, DICTIONARY_RECORDING, 0, expected, size) ==
          size);
  (void)drain(node, 0);
  uint8_t block = (uint8_t)(1 + seed % 127);
  ask(node, 0xA4, 0x20, 0x21, 0, block);
  can_frame_t answer = next_answer(node);
  require(answer.length == 8 && answer.data[0] == 0xC6);
  ask(node, 0xA3, 0, 0, 0, 0);
  uint32_t received = 0;
  for (int rounds = 0; rounds < 20000; rounds++) {
    uint8_t good = 0;
    int last = 0;
    /* Fewer than the four of a tick may come, if others wait. */
    for (int ticks = 0; ticks < block + 2 && last == 0 && good < block; ticks++) {
      node_tick(node, 1);
      for (answer = next_answer(node); answer.length != 0; answer = next_answer(node)) {
        seed = seed * 1664525u + 1013904223u;
        require((answer.data[0] & 0x7F) <= block && answer.data[0] != 0x80);
        if ((answer.data[0] & 0x7F) != good + 1 || (seed >> 28) == 0) {
          continue;
        }
        good++;
        last = (answer.data[0] & 0x80) != 0;
        require(received + 7 <= sizeof(got));
        memcpy(&got[received], &answer.data[1], 7);
        received += 7;
      }
    }
    block = (uint8_t)(1 + (seed >> 8) % 127);
    ask(node, 0xA2, good, block, 0, 0);
    if (last != 0) {
      answer = next_answer(node);
      require(answer.length == 8 && (answer.data[0] & 0xE3) == 0xC1);
      require(received - (answer.data[0] >> 2 & 7) == size && memcmp(got, expected, size) == 0);
      require((answer.data[1] | answer.data[2] << 8) == crc_of(expected, size));
      ask(node, 0xA1, 0, 0, 0, 0);
      require(next_answer(node).length == 0);
      return;
    }
  }
  require(0);
}

/* A record of one phase that waits, and of `points` that no element uses. */
static uint32_t write_record(uint32_t *words, uint32_t number, uint16_t points) {
  const uint16_t size = (uint16_t)(112 + 8 * points);
  const cycle_header_t header = {.magic = CYCLE_MAGIC,
                                 .version = CYCLE_VERSION,
                                 .size = size,
                                 .phases = 1,
                                 .points = points,
                                 .number = number};
  const cycle_phase_t phase = {.action = CYCLE_WAIT,
                               .reaction = CYCLE_END,
                               .force_max_q8 = 1,
                               .travel_max = 1,
                               .time_max = 1};
  memset(words, 0, size);
  memcpy(words, &header, sizeof(header));
  memcpy(words + sizeof(header) / 4, &phase, sizeof(phase));
  uint32_t crc = UINT32_MAX;
  for (uint32_t bit = 0; bit < 8u * (size - 4u); bit++) {
    crc ^= (((const uint8_t *)words)[bit / 8] >> (bit % 8)) & 1;
    crc = (crc >> 1) ^ ((crc & 1) != 0 ? 0xEDB88320u : 0);
  }
  words[size / 4 - 1] = ~crc;
  return size;
}

/* Downloads a record by blocks whose losses are given by `seed`, over the default server. */
static void download_blocks(node_t *node, uint32_t seed) {
  static uint32_t words[CYCLE_PROGRAM_BYTES_MAX / 4];
  const uint8_t *record = (const uint8_t *)words;
  const uint32_t number = 1 + seed % 3;
  const uint32_t size = write_record(words, number, (uint16_t)((seed >> 2) % 494));
  const uint8_t state = node->fw.canopen.signals.nmt_state;
  if ((state != 5 && state != 127) || node->fw.canopen.sdo[0].state == SDO_BLOCK_AWAITED) {
    return;
  }
  (void)drain(node, 0);
  const uint8_t begin[8] = {0xC4, 0x35, 0x24, 1};
  node_send(node, requests[0], begin, 8);
  can_frame_t answer = next_answer(node);
  require(answer.length == 8);
  if (answer.data[0] != 0xA4) {
    return; /* another owner, an enabled axis, another transfer */
  }
  uint8_t offered = answer.data[4];
  for (uint32_t sent = 0; sent < size;) {
    const uint32_t left = (size - sent + 6) / 7;
    const uint8_t block = (left < offered) ? (uint8_t)left : offered;
    uint8_t good = 0;
    for (uint8_t i = 1; i <= block; i++) {
      const uint32_t at = sent + 7u * (i - 1u);
      const uint32_t count = (size - at < 7) ? size - at : 7;
      uint8_t segment[8] = {(uint8_t)(i | (at + 7 >= size ? 0x80 : 0))};
      memcpy(segment + 1, record + at, count);
      seed = seed * 1664525u + 1013904223u;
      if (i == block || (seed >> 28) != 0) {
        good = (good == i - 1) ? i : good;
        node_send(node, requests[0], segment, 8);
      }
    }
    answer = next_answer(node);
    require(answer.length == 8 && answer.data[0] == 0xA2 && answer.data[1] == good);
    sent += 7u * good;
    offered = answer.data[2];
  }
  const uint16_t crc = crc_of(record, size);
  const uint8_t end[8] = {(uint8_t)(0xC1 | (7 - size % 7) % 7 << 2), (uint8_t)crc,
                          (uint8_t)(crc >> 8)};
  node_send(node, requests[0], end, 8);
  answer = next_answer(node);
  require(answer.length == 8 && answer.data[0] == 0xA1);
  const cycle_header_t *kept = cycle_library_find(&node->fw.library, number);
  require(kept != NULL && memcmp(kept, record, size) == 0);
}

/* A request, or anything else, to a server. */
static void send(node_t *node, int server, const uint8_t *data, uint8_t length) {
  const uint8_t state = node->fw.canopen.signals.nmt_state;
  const int served = (state == 5 || state == 127) && length == 8 &&
                     sdo_server_at(&node->fw.canopen, requests[server]) == server &&
                     node->fw.canopen.sdo[server].state != SDO_BLOCK_AWAITED;
  (void)drain(node, server);
  node_send(node, requests[server], data, length);
  const int count = drain(node, server);
  require(count <= 1);
  /* Transfers without blocks, and what is unknown, are answered; a segment of a block is not. */
  const uint8_t specifier = (length == 0) ? 0 : data[0] >> 5;
  require(server != 0 || !served || (specifier >= 4 && specifier != 7) || count == 1);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Records: a byte that says what, then its bytes. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  static node_t node;
  node_init(&node);
  enable_servers(&node);
  (void)fw_object_write(&node.fw, FW_SOURCE_LOCAL, AXIS_OBJ_RECORDER_SIGNAL_1, 0x201F00);
  (void)fw_object_write(&node.fw, FW_SOURCE_LOCAL, AXIS_OBJ_RECORDER_LENGTH, SAMPLES);
  (void)fw_object_write(&node.fw, FW_SOURCE_LOCAL, AXIS_OBJ_RECORDER_ARM, 1);
  node_tick(&node, SAMPLES);
  (void)drain(&node, 0);
  int waits = 0;
  while (size > 0) {
    const uint8_t what = *data;
    data++;
    size--;
    const size_t length = (what & 0x40) != 0 ? (what >> 2) & 0xF : 8;
    if (what >= 0xF0) {
      /* Twice longer than a transfer may wait. */
      node_wait(&node, what == 0xFF && waits++ < 2 ? 8000 : 1u << (what & 3));
      (void)drain(&node, 0);
    } else if (what >= 0xE0 && size >= 2) {
      node_send(&node, 0, data, 2);
      data += 2;
      size -= 2;
    } else if (what >= 0xDE && size >= 2) {
      upload_blocks(&node, (uint32_t)data[0] << 16 | data[1]);
      data += 2;
      size -= 2;
    } else if (what == 0xDC && size >= 2) {
      download_blocks(&node, (uint32_t)data[0] << 16 | data[1]);
      data += 2;
      size -= 2;
    } else if (what == 0xDD) {
      enable_servers(&node);
    } else if ((what & 3) != 3 && length <= 8 && size >= length) {
      send(&node, what & 3, data, (uint8_t)length);
      data += length;
      size -= length;
    } else {
      return 0;
    }
  }
  return 0;
}
