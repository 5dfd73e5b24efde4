/* LCM: bytes of a record's size, published and handled. */
#define _GNU_SOURCE
#include <lcm/lcm.h>
#include <string.h>

#include "tests/bench/link_pingpong.h"

enum { BYTES = 57 }; /* of link_inputs_t as encoded */

static int pings;
static volatile long came;
static unsigned char bytes[BYTES];

static void hear(const lcm_recv_buf_t *buffer, const char *channel, void *user) {
  (void)channel;
  if (buffer->data_size == BYTES) {
    memcpy(bytes, buffer->data, BYTES);
  }
  came++;
  if (!pings && lcm_publish((lcm_t *)user, "PONG", bytes, BYTES) != 0) fail("publish");
}

int main(int argc, char **argv) {
  if (argc < 3) return 2;
  pings = strcmp(argv[1], "ping") == 0;
  lcm_t *lcm = lcm_create(argv[2]);
  if (lcm == NULL) fail(argv[2]);
  lcm_subscribe(lcm, pings ? "PONG" : "PING", hear, lcm);
  if (!pings) {
    puts("ready");
    fflush(stdout);
    for (;;) lcm_handle(lcm);
  }
  const long count = atol(argv[3]);
  const double start = now_s();
  for (long i = 0; i < count; i++) {
    if (lcm_publish(lcm, "PING", bytes, BYTES) != 0) fail("publish");
    const long before = came;
    while (came == before) {
      if (lcm_handle_timeout(lcm, 1000) == 0) {
        fputs("lost\n", stderr);
        return 1;
      }
    }
  }
  printf("%.1f\n", (double)count / (now_s() - start));
  lcm_destroy(lcm);
  return 0;
}
