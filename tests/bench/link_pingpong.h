/* What the two ping-pong programs share: `PROGRAM pong WHERE` answers until it is killed,
 * `PROGRAM ping WHERE COUNT` sends a message of a lock-step record's size, waits for the answer,
 * COUNT times, and prints round trips a second. Nothing is repeated and nothing is checked but
 * loss: this is the rate that the transport itself allows. */
#ifndef TESTS_BENCH_LINK_PINGPONG_H_
#define TESTS_BENCH_LINK_PINGPONG_H_

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static double now_s(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void fail(const char *what) {
  perror(what);
  exit(1);
}

#endif
