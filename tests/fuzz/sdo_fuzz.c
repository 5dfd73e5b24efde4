/* Any frames to the SDO servers and to network management, any ticks between them: no answer is
 * malformed, and none comes unasked but what a time-out gives. */

#include "tests/fuzz/node.h"

static const uint16_t requests[] = {0x605, 0x645, 0x665};
static const uint16_t answers[] = {0x585, 0x5C5, 0x5E5};

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
    require(frame.length == 8);
    const uint8_t specifier = frame.data[0] >> 5;
    require(specifier <= 4);
    /* An abort has a code of CiA 301. */
    require(specifier != 4 || (frame.data[0] == 0x80 && frame.data[7] >= 5 && frame.data[7] <= 8));
    count += (from == server) ? 1 : 0;
  }
  return count;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Records: a byte that says what, then its bytes. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  static node_t node;
  node_init(&node);
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
    } else if ((what & 3) != 3 && length <= 8 && size >= length) {
      const int server = what & 3;
      const uint8_t state = node.fw.canopen.signals.nmt_state;
      node_send(&node, requests[server], data, (uint8_t)length);
      const int count = drain(&node, server);
      const int answered = (state == 5 || state == 127) && length == 8 && (data[0] >> 5) != 4;
      require(count == answered);
      data += length;
      size -= length;
    } else {
      return 0;
    }
  }
  return 0;
}
