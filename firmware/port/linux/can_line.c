/* This file uses SocketCAN of Linux. */
#define _GNU_SOURCE

#include "firmware/port/linux/can_line.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

/* Size of the receive buffer in bytes: a bus of 1 Mbit/s fills it in about a second. */
enum { BUFFER_BYTES = 1 << 20 };

const char *can_line_open(can_line_t *line, const char *interface) {
  *line = (can_line_t){.socket = -1, .state = CAN_BUS_ACTIVE};
  line->socket = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
  if (line->socket < 0) {
    return "expected a kernel with SocketCAN, but this kernel has none";
  }
  struct sockaddr_can address = {.can_family = AF_CAN};
  address.can_ifindex = (int)if_nametoindex(interface);
  if (address.can_ifindex == 0) {
    return "expected a CAN interface, but no interface has this name";
  }
  const struct can_filter filter = {.can_id = 0, .can_mask = CAN_EFF_FLAG};
  const can_err_mask_t errors = CAN_ERR_CRTL | CAN_ERR_BUSOFF | CAN_ERR_RESTARTED;
  const int on = 1;
  const int bytes = BUFFER_BYTES;
  (void)setsockopt(line->socket, SOL_CAN_RAW, CAN_RAW_FILTER, &filter, sizeof(filter));
  (void)setsockopt(line->socket, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof(errors));
  (void)setsockopt(line->socket, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof(on));
  (void)setsockopt(line->socket, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof(bytes));
  if (bind(line->socket, (const struct sockaddr *)&address, sizeof(address)) != 0) {
    return strerror(errno);
  }
  return NULL;
}

/* Takes the state of the bus from an error frame. */
static void take_error(can_line_t *line, const struct can_frame *frame) {
  const uint8_t controller = ((frame->can_id & CAN_ERR_CRTL) != 0) ? frame->data[1] : 0;
  if ((frame->can_id & CAN_ERR_BUSOFF) != 0) {
    line->state = CAN_BUS_OFF;
  } else if ((frame->can_id & CAN_ERR_RESTARTED) != 0 || (controller & CAN_ERR_CRTL_ACTIVE) != 0) {
    line->state = CAN_BUS_ACTIVE;
  } else if ((controller & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0) {
    line->state = CAN_BUS_PASSIVE;
  }
  if ((controller & CAN_ERR_CRTL_RX_OVERFLOW) != 0) {
    line->dropped++;
  }
}

/* Takes the number of frames that the kernel has dropped, which comes with a frame. */
static void take_dropped(can_line_t *line, struct msghdr *message) {
  for (struct cmsghdr *part = CMSG_FIRSTHDR(message); part != NULL;
       part = CMSG_NXTHDR(message, part)) {
    if (part->cmsg_level == SOL_SOCKET && part->cmsg_type == SO_RXQ_OVFL) {
      memcpy(&line->dropped, CMSG_DATA(part), sizeof(line->dropped));
    }
  }
}

bool can_line_receive(can_line_t *line, can_frame_t *frame) {
  for (;;) {
    struct can_frame raw;
    char control[CMSG_SPACE(sizeof(uint32_t))];
    struct iovec data = {.iov_base = &raw, .iov_len = sizeof(raw)};
    struct msghdr message = {.msg_iov = &data,
                             .msg_iovlen = 1,
                             .msg_control = control,
                             .msg_controllen = sizeof(control)};
    const ssize_t count = recvmsg(line->socket, &message, 0);
    if (count < 0 && (errno == ENETDOWN || errno == ENODEV)) {
      line->state = CAN_BUS_OFF;
      return false;
    }
    if (count != (ssize_t)sizeof(raw)) {
      return false;
    }
    take_dropped(line, &message);
    if ((raw.can_id & CAN_ERR_FLAG) != 0) {
      take_error(line, &raw);
      continue;
    }
    *frame = (can_frame_t){.id = (uint16_t)(raw.can_id & CAN_SFF_MASK),
                           .length = raw.can_dlc,
                           .remote = (uint8_t)((raw.can_id & CAN_RTR_FLAG) != 0)};
    memcpy(frame->data, raw.data, sizeof(frame->data));
    return true;
  }
}

bool can_line_send(can_line_t *line, const can_frame_t *frame) {
  struct can_frame raw = {.can_id = frame->id, .can_dlc = frame->length};
  if (frame->remote != 0) {
    raw.can_id |= CAN_RTR_FLAG;
  }
  memcpy(raw.data, frame->data, sizeof(raw.data));
  return write(line->socket, &raw, sizeof(raw)) == (ssize_t)sizeof(raw);
}

uint16_t can_line_lost(can_line_t *line) {
  const uint32_t lost = line->dropped - line->last_lost;
  line->last_lost = line->dropped;
  return (uint16_t)((lost < UINT16_MAX) ? lost : UINT16_MAX);
}
