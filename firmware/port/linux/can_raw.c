/* This file uses SocketCAN of Linux. */
#define _GNU_SOURCE

#include "firmware/port/linux/can_raw.h"

#include <errno.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

_Static_assert(CAN_RAW_NAME == IF_NAMESIZE, "length of the name of an interface");

static bool is_deep(const can_raw_t *raw) { return raw->settings.buffer_bytes > 0; }

static void set_options(const can_raw_t *raw) {
  const can_raw_settings_t *settings = &raw->settings;
  const int on = 1;
  const int bytes = settings->buffer_bytes;
  (void)setsockopt(raw->fd, SOL_CAN_RAW, CAN_RAW_FILTER, &settings->filter,
                   sizeof(settings->filter));
  (void)setsockopt(raw->fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &settings->errors,
                   sizeof(settings->errors));
  if (!is_deep(raw)) {
    return;
  }
  (void)setsockopt(raw->fd, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof(on));
  /* Only root may set a buffer size above the limit of the system. */
  if (setsockopt(raw->fd, SOL_SOCKET, SO_RCVBUFFORCE, &bytes, sizeof(bytes)) != 0) {
    (void)setsockopt(raw->fd, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof(bytes));
  }
}

static can_raw_result_t connect_to(const can_raw_t *raw) {
  struct sockaddr_can address = {.can_family = AF_CAN};
  address.can_ifindex = (int)if_nametoindex(raw->interface);
  if (address.can_ifindex == 0) {
    return CAN_RAW_NO_INTERFACE;
  }
  return (bind(raw->fd, (const struct sockaddr *)&address, sizeof(address)) == 0) ? CAN_RAW_OPEN
                                                                                  : CAN_RAW_REFUSED;
}

can_raw_result_t can_raw_open(can_raw_t *raw, const char *interface,
                              const can_raw_settings_t *settings) {
  const int blocks = settings->blocks ? 0 : SOCK_NONBLOCK;
  const size_t length = strlen(interface);
  *raw = (can_raw_t){.settings = *settings};
  raw->fd = socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | blocks, CAN_RAW);
  if (raw->fd < 0) {
    return CAN_RAW_NO_CAN;
  }
  can_raw_result_t result = CAN_RAW_BAD_NAME;
  if (length > 0 && length < sizeof(raw->interface)) {
    memcpy(raw->interface, interface, length);
    set_options(raw);
    result = connect_to(raw);
  }
  if (result != CAN_RAW_OPEN) {
    const int error = errno;
    (void)close(raw->fd);
    raw->fd = -1;
    errno = error;
  }
  return result;
}

bool can_raw_bind(const can_raw_t *raw) {
  /* When the interface was removed, the kernel has also removed the filters of the socket. */
  set_options(raw);
  return connect_to(raw) == CAN_RAW_OPEN;
}

can_raw_link_t can_raw_link(const can_raw_t *raw) {
  struct ifreq request = {.ifr_flags = 0};
  memcpy(request.ifr_name, raw->interface, sizeof(raw->interface));
  if (ioctl(raw->fd, SIOCGIFFLAGS, &request) != 0) {
    return (can_raw_link_t){.is_up = false};
  }
  return (can_raw_link_t){.is_up = (request.ifr_flags & IFF_UP) != 0,
                          .has_carrier = (request.ifr_flags & IFF_RUNNING) != 0};
}

int can_raw_send(const can_raw_t *raw, const struct can_frame *frames, unsigned count) {
  struct iovec parts[CAN_RAW_BATCH];
  struct mmsghdr messages[CAN_RAW_BATCH];
  if (count == 1) { /* the call write() takes less time for a single frame than sendmmsg() */
    return (write(raw->fd, frames, sizeof(*frames)) < 0) ? -errno : 1;
  }
  const unsigned most = (count < CAN_RAW_BATCH) ? count : CAN_RAW_BATCH;
  for (unsigned i = 0; i < most; i++) {
    /* sendmmsg() only reads the frames, so they may be const. */
    parts[i] =
        (struct iovec){.iov_base = (void *)(uintptr_t)&frames[i], .iov_len = sizeof(frames[i])};
    messages[i] = (struct mmsghdr){.msg_hdr = {.msg_iov = &parts[i], .msg_iovlen = 1}};
  }
  const int sent = sendmmsg(raw->fd, messages, most, 0);
  return (sent < 0) ? -errno : sent;
}

/* Reads the number of dropped frames. The kernel passes this number together with a frame. */
static void take_dropped(can_raw_t *raw, struct msghdr *message) {
  for (struct cmsghdr *part = CMSG_FIRSTHDR(message); part != NULL;
       part = CMSG_NXTHDR(message, part)) {
    if (part->cmsg_level == SOL_SOCKET && part->cmsg_type == SO_RXQ_OVFL) {
      memcpy(&raw->dropped, CMSG_DATA(part), sizeof(raw->dropped));
    }
  }
}

int can_raw_receive(can_raw_t *raw, struct can_frame *frames, unsigned count) {
  struct {
    _Alignas(struct cmsghdr) char bytes[CMSG_SPACE(sizeof(uint32_t))];
  } controls[CAN_RAW_BATCH];
  struct iovec parts[CAN_RAW_BATCH];
  struct mmsghdr messages[CAN_RAW_BATCH];
  const unsigned most = (count < CAN_RAW_BATCH) ? count : CAN_RAW_BATCH;
  for (unsigned i = 0; i < most; i++) {
    parts[i] = (struct iovec){.iov_base = &frames[i], .iov_len = sizeof(frames[i])};
    messages[i] = (struct mmsghdr){.msg_hdr = {.msg_iov = &parts[i], .msg_iovlen = 1}};
    if (is_deep(raw)) {
      messages[i].msg_hdr.msg_control = controls[i].bytes;
      messages[i].msg_hdr.msg_controllen = sizeof(controls[i].bytes);
    }
  }
  const int received = recvmmsg(raw->fd, messages, most, MSG_WAITFORONE, NULL);
  if (received < 0) {
    return -errno;
  }
  for (int i = 0; is_deep(raw) && i < received; i++) {
    take_dropped(raw, &messages[i].msg_hdr);
  }
  return received;
}
