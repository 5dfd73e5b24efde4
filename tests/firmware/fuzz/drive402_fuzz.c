/* Any configuration, frames, commands and ticks: the master of a drive sends no more frames than it
 * may, no target and no command to enable but to a drive that was enabled or is to be, and its
 * numbers stay in their ranges. */

#include <stdlib.h>
#include <string.h>

#include "firmware/drive402/drive402.h"

enum { DRIVE = 9, MASTER = 1 };

static void require(int holds) {
  if (!holds) {
    abort();
  }
}

static uint32_t word(const uint8_t *data) {
  return (uint32_t)data[0] | (uint32_t)data[1] << 8 | (uint32_t)data[2] << 16 |
         (uint32_t)data[3] << 24;
}

/* The RPDO: controlwords of the standard only, and a target only with "enable operation". */
static void check_rpdo(const drive402_config_t *config, const can_frame_t *frame, int may_enable) {
  const uint16_t control = (uint16_t)(frame->data[0] | frame->data[1] << 8);
  require(frame->length == (config->mode == DRIVE402_CST ? 4 : 6));
  require(control == 0x00 || control == 0x02 || control == 0x06 || control == 0x07 ||
          control == 0x0F || control == 0x80);
  const uint32_t target = (config->mode == DRIVE402_CST)
                              ? (uint32_t)(frame->data[2] | frame->data[3] << 8)
                              : word(frame->data + 2);
  require(may_enable || (control != 0x0F && control != 0x06 && control != 0x07));
  require(config->mode == DRIVE402_CSP || control == 0x0F || target == 0);
}

/* A tick, and all that it may send. */
static void tick(drive402_t *master, const drive402_command_t *command) {
  const drive402_config_t *config = master->config;
  const drive402_feedback_t before = drive402_feedback(master);
  drive402_tick(master, command);
  const drive402_feedback_t after = drive402_feedback(master);
  int rpdos = 0, syncs = 0, count = 0;
  can_frame_t frame;
  while (drive402_transmit(master, &frame)) {
    count++;
    require(frame.remote == 0 && frame.length <= 8);
    syncs += frame.id == 0x80;
    if (frame.id == 0x200 + DRIVE) {
      rpdos++;
      /* A reset that is asked for in this tick may permit what was not before. */
      check_rpdo(config, &frame,
                 command->enable != 0 &&
                     (before.reason == 0 || after.reason == 0 ||
                      (command->reset != 0 && (before.reason <= DRIVE402_DRIVE_OFF ||
                                               before.reason >= DRIVE402_NOT_REMOTE))));
    } else {
      require(frame.id == 0x80 || frame.id == 0 || frame.id == 0x600 + DRIVE ||
              frame.id == 0x700 + MASTER);
    }
  }
  require(count <= DRIVE402_FRAMES && rpdos <= 1 && syncs <= 1);
  require(after.phase < DRIVE402_PHASE_COUNT && after.state < DRIVE402_STATE_COUNT &&
          after.reason < DRIVE402_REASON_COUNT);
  require(after.on == 0 || (after.fault == 0 && after.reason == 0));
  require(drive402_reason_text(after.reason) != NULL && drive402_state_text(after.state) != NULL);
}

static void hand(drive402_t *master, uint16_t id, const uint8_t *data, uint8_t length) {
  can_frame_t frame = {.id = id, .length = length};
  memcpy(frame.data, data, length);
  drive402_receive(master, &frame);
}

/* The drive answers the request that the master waits for, so that inputs come far. */
static void answer(drive402_t *master) {
  const drive402_sdo_t *sdo = &master->sdo;
  uint8_t data[8] = {
      0x60, (uint8_t)sdo->entry.index, (uint8_t)(sdo->entry.index >> 8), sdo->entry.sub, 0, 0, 0,
      0};
  if (sdo->writes == 0) {
    const uint32_t value = (sdo->entry.index == 0x6061) ? master->config->mode : sdo->entry.value;
    int at = 4;
    data[0] = (uint8_t)(((value & 0x40) != 0) ? 0x41 : 0x43 | (4 - sdo->entry.bytes) << 2);
    if (sdo->is_segmented != 0) { /* the first segment, which is whole */
      data[0] = 0x01;
      at = 1;
    }
    for (int i = 0; i < sdo->entry.bytes; i++) {
      data[at + i] = (uint8_t)(value >> (8 * i));
    }
  }
  hand(master, 0x580 + DRIVE, data, 8);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* 6 bytes of configuration, then records of 6 bytes: what, how often or how long, and a word. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  static const uint16_t ids[8] = {0x000,         0x080 + DRIVE, 0x180 + DRIVE, 0x580 + DRIVE,
                                  0x700 + DRIVE, 0x180 + DRIVE, 0x700 + DRIVE, 0x200 + DRIVE};
  static const uint8_t status[8] = {0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08, 0x00};
  static const uint8_t high[4] = {0x12, 0x12, 0x02, 0x10}; /* bits 9 and 12 */
  drive402_t master = {0};
  drive402_command_t command = {0, 0, 0};
  if (size < 6) {
    return 0;
  }
  const drive402_config_t config = {
      .scale_num = 1 + word(data) % 100000,
      .scale_den = 1 + data[4],
      .target_max = 32767,
      .heartbeat_ms = (uint16_t)(data[2] % 50),
      .heartbeat_timeout_ms = 100,
      .sdo_timeout_ms = 20,
      .wait_ms = 50,
      .quick_stop_ms = data[3],
      .cycle_ms = (uint8_t)(data[4] % 7),
      .mode = (uint8_t)(7 + data[5] % 5),
      .rpdo_type = 255,
      .node_id = DRIVE,
      .own_node_id = MASTER,
      .without = (uint16_t)((data[5] >> 4) | (data[1] & 0x70) << 8),
      .differs = (uint16_t)(data[1] & 7),
  };
  const uint8_t refused = drive402_init(&master, &config);
  require((refused == DRIVE402_NONE) ==
          (config.heartbeat_ms != 0 && config.cycle_ms != 0 && config.cycle_ms % 2 == 0 &&
           config.mode >= 8 && config.mode <= 10));
  for (data += 6, size -= 6; size >= 6; data += 6, size -= 6) {
    switch (data[0] & 7) {
      case 0:
        command.target = (int32_t)word(data + 2);
        command.enable = data[1] & 1;
        command.reset = data[1] >> 1 & 1;
        break;
      case 1: { /* a frame of any content and length */
        const uint8_t any[8] = {data[2], data[3], data[4], data[5],
                                data[5], data[4], data[3], data[2]};
        hand(&master, ids[data[1] & 7], any, (uint8_t)((data[1] >> 4) % 9));
        break;
      }
      case 2: { /* a TPDO of a state */
        const uint8_t tpdo[8] = {status[data[1] & 7], data[2], data[2], data[3], data[4], data[5]};
        hand(&master, 0x180 + DRIVE, tpdo, 8);
        break;
      }
      case 3:
        answer(&master);
        break;
      case 4: { /* a heartbeat, or a boot-up message */
        const uint8_t state = (data[1] & 7) == 0 ? 0 : (data[1] & 7) == 1 ? 127 : 5;
        hand(&master, 0x700 + DRIVE, &state, 1);
        break;
      }
      case 5: /* a drive that answers as it should */
        for (int i = 0; i < (data[1] & 127); i++) {
          static const uint8_t operational = 5;
          const uint8_t tpdo[8] = {
              status[data[2] & 7], high[data[5] & 3], data[3], data[4], 0, 0, 0, 0};
          answer(&master);
          hand(&master, 0x700 + DRIVE, &operational, 1);
          hand(&master, 0x180 + DRIVE, tpdo, 8);
          tick(&master, &command);
        }
        break;
      case 6:
        drive402_bus(&master, data[1] & 3, data[2] & 1);
        break;
      default:
        for (int i = 0; i < (data[1] & 63); i++) {
          tick(&master, &command);
        }
        break;
    }
  }
  return 0;
}
