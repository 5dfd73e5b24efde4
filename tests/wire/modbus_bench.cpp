// The firmware on a serial line in real time, and nothing else: for tests of its Modbus server.
//
// usage: modbus_bench DEVICE UNIT BAUD [STORE]
//
// The encoder moves one count a tick, so position and tick_count show whether the values read are
// one snapshot. Prints "ready", then serves until it is terminated.

#include <fcntl.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "firmware/port/host/firmware.hpp"
#include "firmware/port/host/store_file.h"

namespace {

constexpr long kTickNs = 666'667;
constexpr long kSecondNs = 1'000'000'000;

int Fail(const char *what, const char *why) {
  std::fprintf(stderr, "modbus_bench: %s: %s\n", what, why);
  return 1;
}

int OpenLine(const char *device) {
  const int line = open(device, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  termios settings{};
  if (line < 0 || tcgetattr(line, &settings) != 0) return -1;
  cfmakeraw(&settings);
  return tcsetattr(line, TCSANOW, &settings) == 0 ? line : -1;
}

void Serve(int line, fw_t *axis) {
  std::array<uint8_t, 512> bytes{};
  const ssize_t got = read(line, bytes.data(), bytes.size());
  if (got > 0) fw_modbus_receive(axis, bytes.data(), static_cast<uint16_t>(got));
  for (uint16_t n; (n = fw_modbus_transmit(axis, bytes.data(), bytes.size())) > 0;) {
    for (ssize_t sent = 0; sent < n;) {
      const ssize_t more = write(line, bytes.data() + sent, static_cast<size_t>(n - sent));
      if (more < 0 && errno != EAGAIN && errno != EINTR) return;
      if (more > 0) sent += more;
    }
  }
}

}  // namespace

int main(int argc, char **argv) {
  if (argc < 4) return Fail("usage", "modbus_bench DEVICE UNIT BAUD [STORE]");
  const int line = OpenLine(argv[1]);
  if (line < 0) return Fail(argv[1], std::strerror(errno));
  store_file_t store{};
  fw_config_t config{};
  config.node_id = static_cast<uint8_t>(std::atoi(argv[2]));
  config.modbus_baud = static_cast<uint32_t>(std::atoi(argv[3]));
  config.buses = 1;
  if (argc > 4) {
    const char *wrong = store_file_open(&store, argv[4]);
    if (wrong != nullptr) return Fail(argv[4], wrong);
    config.memory = &store.memory;
  }
  fw_t *axis = axis_host_create_with(&config);
  axis_inputs_t inputs{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
  axis_outputs_t outputs;
  std::puts("ready");
  std::fflush(stdout);
  timespec next{};
  clock_gettime(CLOCK_MONOTONIC, &next);
  for (;;) {
    Serve(line, axis);
    can_frame_t unheard;
    while (fw_can_transmit(axis, &unheard)) {
    }
    inputs.encoder_cnt = static_cast<int32_t>(static_cast<uint32_t>(inputs.encoder_cnt) + 1);
    fw_tick(axis, &inputs, &outputs);
    next.tv_nsec += kTickNs;
    if (next.tv_nsec >= kSecondNs) {
      next.tv_nsec -= kSecondNs;
      ++next.tv_sec;
    }
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, nullptr);
  }
}
