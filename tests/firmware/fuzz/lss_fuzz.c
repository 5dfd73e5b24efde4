/* Any requests of an LSS master, other frames and ticks between them, to a node that has an id or
 * none: it answers as its state allows, once at most; without an id nothing else leaves it; its id
 * and bit rate are always ones that exist, and while the rate changes it is silent. */

#include "firmware/canopen/lss.h"
#include "tests/firmware/fuzz/node.h"

enum { REQUEST = 0x7E5, ANSWER = 0x7E4 };

/* The state as the requests so far have it. */
static int configures;

static const uint16_t rates[] = {1000, 800, 500, 250, 125, 50, 20, 10};

static void check(const node_t *node) {
  const uint8_t id = node->fw.canopen.node_id;
  const uint8_t next = node->fw.canopen.lss.node_id;
  const uint16_t rate = fw_can_kbit_s(&node->fw);
  int known = 0;
  for (size_t i = 0; i < sizeof(rates) / sizeof(rates[0]); i++) {
    known |= rates[i] == rate;
  }
  require(known);
  require((id >= 1 && id <= 127) || id == 255);
  require((next >= 1 && next <= 127) || next == 255);
  require(node->fw.device_signals.node_id == id);
}

/* Takes what the node sends; returns how many answers of LSS there were, the last in `answer`. */
static int drain(node_t *node, can_frame_t *answer) {
  const int has_id = node->fw.canopen.node_id != 255;
  const int silent = lss_is_silent(&node->fw.canopen);
  can_frame_t frame;
  int count = 0;
  while (fw_can_transmit(&node->fw, &frame)) {
    require(!silent && frame.remote == 0);
    require(frame.id == ANSWER || has_id);
    if (frame.id == ANSWER) {
      require(frame.length == 8);
      *answer = frame;
      count++;
    }
  }
  check(node);
  return count;
}

/* Whether a request may be answered at once, and with which command. */
static int expected_answer(uint8_t command) {
  if (command >= 0x40 && command <= 0x43) {
    return configures ? -1 : 0x44;
  }
  if ((command >= 0x46 && command <= 0x4B) || (command == 0x51 && !configures)) {
    return 0x4F;
  }
  if (command == 0x4C) {
    return 0x50;
  }
  const int configured = command == 0x11 || command == 0x13 || (command >= 0x5A && command <= 0x5E);
  return (configures && configured) ? command : -1;
}

static void ask(node_t *node, const uint8_t *data, uint8_t length) {
  can_frame_t answer = {0};
  (void)drain(node, &answer);
  const int served = length == 8 && !lss_is_silent(&node->fw.canopen) &&
                     node->fw.canopen.reset == CANOPEN_RESET_NONE;
  const uint8_t id = node->fw.canopen.node_id;
  node_send(node, REQUEST, data, length);
  const int count = drain(node, &answer);
  require(count <= 1);
  require(node->fw.canopen.node_id == id); /* not before a reset */
  if (!served) {
    require(count == 0);
    return;
  }
  const int expected = expected_answer(data[0]);
  require(count == 0 || answer.data[0] == expected);
  /* What the state alone decides is answered. */
  require(count == 1 || expected < 0 || expected == 0x44 || expected == 0x4F || expected == 0x50);
  if (data[0] == 4 && data[1] < 2) {
    configures = data[1];
  } else if (count == 1 && data[0] == 0x43) {
    configures = 1;
  } else if (count == 1 && data[0] == 0x51 && data[5] == 0 && data[7] < data[6]) {
    configures = 1;
  }
  require(node->fw.canopen.lss.state == configures);
}

static void pass(node_t *node, uint32_t ticks) {
  for (uint32_t i = 0; i < ticks; i++) {
    const uint8_t reset = node->fw.canopen.reset;
    can_frame_t answer = {0};
    node_tick(node, 1);
    if (reset != CANOPEN_RESET_NONE && node->fw.canopen.reset == CANOPEN_RESET_NONE) {
      configures = 0;
    }
    const int count = drain(node, &answer);
    require(count == 0 || (count == 1 && answer.data[0] == 0x17 && answer.data[1] == 1));
  }
}

/* The identity, so that an input need not find 128 bits. */
static void select_node(node_t *node) {
  const canopen_signals_t *own = &node->fw.canopen.signals;
  const uint32_t parts[] = {own->vendor_id, own->product_code, own->revision_number,
                            own->serial_number};
  for (uint8_t i = 0; i < 4; i++) {
    const uint32_t v = parts[i];
    const uint8_t data[8] = {(uint8_t)(0x40 + i), (uint8_t)v, (uint8_t)(v >> 8), (uint8_t)(v >> 16),
                             (uint8_t)(v >> 24)};
    ask(node, data, 8);
  }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* The node id of the port, then records: a byte that says what, then its bytes. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  static node_t node;
  if (size == 0) {
    return 0;
  }
  node_init_as(&node, (data[0] < 128) ? data[0] : FW_NODE_ID_BY_LSS);
  data++;
  size--;
  configures = 0;
  can_frame_t answer;
  require(drain(&node, &answer) == 0);
  while (size > 0) {
    const uint8_t what = *data;
    const size_t length = what & 0xF;
    data++;
    size--;
    if (what >= 0xF0) {
      pass(&node, UINT32_C(1) << (what & 0xF) % 9);
    } else if (what == 0xE0) {
      select_node(&node);
    } else if (length > 8 || size < length) {
      return 0;
    } else if (what >= 0xD0 && length == 2) {
      node_send(&node, 0, data, 2);
      data += 2;
      size -= 2;
    } else if (what >= 0x80 && length >= 2) {
      const uint16_t id = (uint16_t)((data[0] | data[1] << 8) & 0x7FF);
      if (id != REQUEST) {
        node_send(&node, id, data + 2, (uint8_t)(length - 2));
      }
      data += length;
      size -= length;
    } else {
      ask(&node, data, (uint8_t)length);
      data += length;
      size -= length;
    }
  }
  return 0;
}
