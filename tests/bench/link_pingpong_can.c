/* Raw SocketCAN: blocking read and write of single frames. */
#define _GNU_SOURCE
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "tests/bench/link_pingpong.h"

enum { PING = 0x100, PONG = 0x101 };

static int open_socket(const char *interface, canid_t hears) {
  const int s = socket(PF_CAN, SOCK_RAW, CAN_RAW);
  struct sockaddr_can address = {.can_family = AF_CAN,
                                 .can_ifindex = (int)if_nametoindex(interface)};
  const struct can_filter filter = {.can_id = hears, .can_mask = CAN_SFF_MASK};
  if (s < 0 || setsockopt(s, SOL_CAN_RAW, CAN_RAW_FILTER, &filter, sizeof(filter)) != 0 ||
      bind(s, (struct sockaddr *)&address, sizeof(address)) != 0) {
    fail(interface);
  }
  return s;
}

int main(int argc, char **argv) {
  if (argc < 3) return 2;
  const int ping = strcmp(argv[1], "ping") == 0;
  const int s = open_socket(argv[2], ping ? PONG : PING);
  struct can_frame frame = {.can_id = PING, .can_dlc = 8};
  if (!ping) {
    puts("ready");
    fflush(stdout);
    for (;;) {
      if (read(s, &frame, sizeof(frame)) != sizeof(frame)) fail("read");
      frame.can_id = PONG;
      if (write(s, &frame, sizeof(frame)) != sizeof(frame)) fail("write");
    }
  }
  const long count = atol(argv[3]);
  const double start = now_s();
  for (long i = 0; i < count; i++) {
    frame.can_id = PING;
    if (write(s, &frame, sizeof(frame)) != sizeof(frame)) fail("write");
    if (read(s, &frame, sizeof(frame)) != sizeof(frame)) fail("read");
  }
  printf("%.1f\n", (double)count / (now_s() - start));
  return 0;
}
