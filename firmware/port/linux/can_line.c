/* This file uses SocketCAN of Linux. */
#define _GNU_SOURCE

#include "firmware/port/linux/can_line.h"

#include <errno.h>
#include <linux/can/error.h>
#include <string.h>

enum {
  /* Size of the receive buffer in bytes. The default size of the kernel is too small for bursts of
   * frames. */
  BUFFER_BYTES = 4 << 20,
  /* number of calls between two checks of a bus that is off; with one call in each tick this is 0.1
   * s */
  CALLS_PER_LOOK = 150
};

can_raw_result_t can_line_open(can_line_t *line, const char *interface) {
  /* Remote frames are received too, because the firmware processes them. */
  const can_raw_settings_t settings = {
      .filter = {.can_id = 0, .can_mask = CAN_EFF_FLAG},
      .errors = CAN_ERR_CRTL | CAN_ERR_BUSOFF | CAN_ERR_RESTARTED,
      .buffer_bytes = BUFFER_BYTES,
  };
  *line = (can_line_t){.controller = CAN_BUS_ACTIVE};
  return can_raw_open(&line->raw, interface, &settings);
}

const char *can_line_error(can_raw_result_t result) {
  switch (result) {
    case CAN_RAW_NO_CAN:
      return "expected a kernel with SocketCAN, but this kernel has none";
    case CAN_RAW_BAD_NAME:
      return "expected the name of a CAN interface such as can0";
    case CAN_RAW_NO_INTERFACE:
      return "expected a CAN interface, but no interface has this name";
    case CAN_RAW_OPEN:
    case CAN_RAW_REFUSED:
    default:
      return strerror(errno);
  }
}

static bool is_off(const can_line_t *line) {
  return line->is_down || line->controller == CAN_BUS_OFF;
}

/* Reads the state of the CAN controller from an error frame. */
static void take_error(can_line_t *line, const struct can_frame *frame) {
  const uint8_t controller = ((frame->can_id & CAN_ERR_CRTL) != 0) ? frame->data[1] : 0;
  if ((frame->can_id & CAN_ERR_BUSOFF) != 0) {
    line->controller = CAN_BUS_OFF;
    line->has_no_carrier = false;
    line->was_off = true;
  } else if ((frame->can_id & CAN_ERR_RESTARTED) != 0 || (controller & CAN_ERR_CRTL_ACTIVE) != 0) {
    line->controller = CAN_BUS_ACTIVE;
  } else if ((controller & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0) {
    line->controller = CAN_BUS_PASSIVE;
  }
  if ((controller & CAN_ERR_CRTL_RX_OVERFLOW) != 0) {
    /* A received frame was lost. Lost frames are counted from last_lost on, so a decrease counts
     * one more. */
    line->last_lost--;
  }
}

/* Checks whether a bus that was off works again. This check is needed, because the error frame that
 * reports it may have been dropped. */
static void look(can_line_t *line) {
  if (line->was_removed) {
    line->was_removed = !can_raw_bind(&line->raw);
  }
  const can_raw_link_t link = can_raw_link(&line->raw);
  if (line->was_removed || !link.is_up) {
    line->is_down = true;
  } else if (line->is_down) {
    line->is_down = false;
    /* When an interface comes up, its CAN controller is error active. */
    line->controller = CAN_BUS_ACTIVE;
  } else if (!link.has_carrier) {
    line->has_no_carrier = true;
  } else if (line->has_no_carrier) {
    line->controller = CAN_BUS_ACTIVE;
  }
}

/* Acts on a call of can_raw_receive() that has returned no frame. */
static void take_nothing(can_line_t *line, int error) {
  if (error == -ENETDOWN || error == -ENODEV) {
    line->is_down = true;
    line->was_off = true;
    line->was_removed = line->was_removed || error == -ENODEV;
  }
}

bool can_line_receive(can_line_t *line, can_frame_t *frame) {
  struct can_frame raw;
  if (is_off(line)) {
    line->calls++;
    if (line->calls >= CALLS_PER_LOOK) {
      line->calls = 0;
      look(line);
    }
  }
  for (;;) {
    const int received = can_raw_receive(&line->raw, &raw, 1);
    if (received < 0) {
      take_nothing(line, received);
      return false;
    }
    if ((raw.can_id & CAN_ERR_FLAG) == 0) {
      break;
    }
    take_error(line, &raw);
  }
  *frame = (can_frame_t){.id = (uint16_t)(raw.can_id & CAN_SFF_MASK),
                         .remote = (uint8_t)((raw.can_id & CAN_RTR_FLAG) != 0)};
  if (frame->remote == 0) {
    frame->length = (raw.can_dlc < sizeof(frame->data)) ? raw.can_dlc : sizeof(frame->data);
    memcpy(frame->data, raw.data, frame->length);
  }
  return true;
}

uint8_t can_line_state(can_line_t *line) {
  if (line->was_off) {
    line->was_off = false;
    return CAN_BUS_OFF;
  }
  return is_off(line) ? CAN_BUS_OFF : line->controller;
}

const char *can_line_trouble(const can_line_t *line) {
  if (line->was_removed) {
    return "the interface was removed";
  }
  if (line->is_down) {
    return "the interface is down";
  }
  return is_off(line) ? "the CAN controller is bus off" : NULL;
}

bool can_line_send(can_line_t *line, const can_frame_t *frame) {
  struct can_frame raw = {.can_id = frame->id, .can_dlc = frame->length};
  if (is_off(line)) {
    return false;
  }
  if (frame->remote != 0) {
    raw.can_id |= CAN_RTR_FLAG;
  }
  memcpy(raw.data, frame->data, sizeof(raw.data));
  return can_raw_send(&line->raw, &raw, 1) == 1;
}

uint16_t can_line_lost(can_line_t *line) {
  const uint32_t lost = line->raw.dropped - line->last_lost;
  line->last_lost = line->raw.dropped;
  return (uint16_t)((lost < UINT16_MAX) ? lost : UINT16_MAX);
}
