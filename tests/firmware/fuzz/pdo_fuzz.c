/* Any order of mapping, PDOs, SYNCs, states and ticks: a valid PDO never maps what it must not,
 * and a TPDO is always as long as what it maps. */

#include "tests/firmware/fuzz/node.h"

static int is_restricted(uint32_t id) {
  return id <= 0x7F || (id >= 0x101 && id <= 0x180) || (id >= 0x581 && id <= 0x5FF) ||
         (id >= 0x601 && id <= 0x67F) || (id >= 0x6E0 && id <= 0x6FF) || id >= 0x701;
}

static uint32_t bits_of(const uint32_t *entries, uint8_t count) {
  uint32_t bits = 0;
  for (uint8_t i = 0; i < count; i++) {
    bits += entries[i] & 0xFF;
  }
  return bits;
}

/* Every mapped entry names an object of its width that this direction may reach. */
static void check_entries(const uint32_t *entries, uint8_t count, int transmit) {
  require(count <= 8 && bits_of(entries, count) <= 64);
  for (uint8_t i = 0; i < count; i++) {
    const uint16_t index = (uint16_t)(entries[i] >> 16);
    if (!transmit && index >= 1 && index <= 7) {
      continue;
    }
    const axis_address_t *at = dictionary_address(index, (uint8_t)(entries[i] >> 8));
    require(at != NULL && at->what == AXIS_ADDRESS_OBJECT);
    const axis_object_t *object = &axis_objects[at->value];
    static const uint8_t bits[] = {8, 8, 16, 16, 32, 32};
    require((entries[i] & 0xFF) == bits[object->type]);
    require(object->access != (transmit ? AXIS_ACCESS_WO : AXIS_ACCESS_RO));
    require(object->mappable != 0);
  }
}

static void check(node_t *node) {
  const canopen_params_t *params = &node->fw.canopen.params;
  for (int i = 0; i < 4; i++) {
    check_entries(&params->rpdo_mapping[8 * i], params->rpdo_mapped[i], 0);
    check_entries(&params->tpdo_mapping[8 * i], params->tpdo_mapped[i], 1);
    require((params->rpdo_cob_id[i] & 0x80000000u) != 0 ||
            !is_restricted(params->rpdo_cob_id[i] & 0x3FFFFFFF));
    require((params->tpdo_cob_id[i] & 0x80000000u) != 0 ||
            !is_restricted(params->tpdo_cob_id[i] & 0x3FFFFFFF));
    require((params->tpdo_cob_id[i] & 0x40000000u) != 0);
  }
  can_frame_t frame;
  while (fw_can_transmit(&node->fw, &frame)) {
    require(frame.length <= 8 && frame.id <= 0x7FF);
  }
}

/* A SYNC at which no other event happens: each TPDO it sends has its mapped length. */
static void check_sync(node_t *node) {
  const canopen_params_t *params = &node->fw.canopen.params;
  const uint16_t id = (uint16_t)(params->sync_cob_id & 0x7FF);
  node_send(node, id, (const uint8_t *)"", 0);
  can_frame_t frame;
  while (fw_can_transmit(&node->fw, &frame)) {
    int found = 0;
    for (int i = 0; i < 4; i++) {
      const uint32_t bits = bits_of(&params->tpdo_mapping[8 * i], params->tpdo_mapped[i]);
      found |= params->tpdo_cob_id[i] <= 0x7FFFFFFF &&
               (params->tpdo_cob_id[i] & 0x7FF) == frame.id && frame.length == (bits + 7) / 8;
    }
    require(found);
  }
}

static uint32_t word(const uint8_t *data) {
  return (uint32_t)data[0] | (uint32_t)data[1] << 8 | (uint32_t)data[2] << 16 |
         (uint32_t)data[3] << 24;
}

/* An entry that often exists: any address of the table with its own width, one bit changed now and
 * then by the input's high bits. */
static uint32_t entry_of(uint32_t bits) {
  const axis_address_t *at = &axis_addresses[(bits & 0xFFFF) % AXIS_ADDRESSES_COUNT];
  static const uint8_t widths[] = {8, 8, 16, 16, 32, 32};
  const uint32_t width =
      (at->what == AXIS_ADDRESS_OBJECT) ? widths[axis_objects[at->value].type] : 8;
  const uint32_t entry = (uint32_t)at->index << 16 | (uint32_t)at->sub << 8 | width;
  return (bits >> 24 == 0xFF) ? entry ^ (1u << (bits >> 16 & 31)) : entry;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Records of 6 bytes: what, which PDO, and a word. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  static node_t node;
  node_init(&node);
  check(&node);
  for (; size >= 6; data += 6, size -= 6) {
    const uint16_t pdo = (uint16_t)((data[1] & 3) + ((data[1] & 4) != 0 ? 0x400 : 0));
    const uint32_t value = word(data + 2);
    const uint16_t communication = (uint16_t)(0x1400 + pdo);
    const uint16_t mapping = (uint16_t)(0x1600 + pdo);
    switch (data[0] & 15) {
      case 0:
        (void)node_write(&node, communication, 1, value, 4);
        break;
      case 1:
        (void)node_write(&node, communication, 1, 0x80000000u | (value & 0x7FF), 4);
        break;
      case 2:
        (void)node_write(&node, communication, 1, 0x40000000u | (value & 0x7FF), 4);
        break;
      case 3:
        (void)node_write(&node, communication, 2, value & 0xFF, 1);
        break;
      case 4:
        (void)node_write(&node, communication, 3, value & 0xFF, 2);
        break;
      case 5:
        (void)node_write(&node, communication, 5, value & 0xFF, 2);
        break;
      case 6:
        (void)node_write(&node, mapping, 0, 0, 1);
        break;
      case 7:
        (void)node_write(&node, mapping, 0, value & 15, 1);
        break;
      case 8:
        (void)node_write(&node, mapping, (uint8_t)(1 + (data[1] >> 5)), value, 4);
        break;
      case 9:
      case 10:
        (void)node_write(&node, mapping, (uint8_t)(1 + (data[1] >> 5)), entry_of(value), 4);
        break;
      case 11:
        node_send(&node, 0, (const uint8_t[]){(uint8_t)(value & 1 ? 1 : value >> 8), 0}, 2);
        break;
      case 12:
        node_tick(&node, 1 + (value & 63));
        break;
      case 13:
        check_sync(&node);
        break;
      case 14: {
        /* To whatever identifier this RPDO has. */
        const uint16_t id = (uint16_t)(node.fw.canopen.params.rpdo_cob_id[data[1] & 3] & 0x7FF);
        uint8_t bytes[8] = {data[2], data[3], data[4], data[5], data[5], data[4], data[3], data[2]};
        node_send(&node, id, bytes, (uint8_t)((data[1] >> 4) % 9));
        break;
      }
      default:
        node_send(&node, (uint16_t)(value & 0x7FF), data + 2, 4);
        break;
    }
    check(&node);
  }
  return 0;
}
