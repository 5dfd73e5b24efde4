// This program is a CiA 402 drive in real time: it runs the firmware as a node on a CAN interface,
// together with the plant of an experiment. Usage: axis_drive EXPERIMENT INTERFACE NODE_ID
// [OVERRIDE ...]. The program ends when its standard input is closed.
#include <poll.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include "firmware/port/host/axis_host.h"
#include "host/axis_node/buses.hpp"
#include "host/run/firmware_side.hpp"
#include "host/run/plant_side.hpp"

using namespace forceaxis;
using Clock = std::chrono::steady_clock;

namespace {

bool is_closed() {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  return poll(&input, 1, 0) == 1;
}

void run(const host::Experiment &experiment, nodes::CanPort &port, std::uint8_t node_id) {
  fw_config_t config{};
  config.node_id = node_id;
  config.buses = 1;
  host::PlantSide plant(experiment, {.trace = false, .audit = false});
  host::FirmwareSide firmware(experiment, {.config = &config});
  fw_t *axis = firmware.axis();
  const nodes::CanPort::Handlers handlers{
      .frame = [axis](const can_frame_t &frame) { fw_can_receive(axis, &frame); },
      .lost = [axis](std::uint16_t frames) { fw_can_lost(axis, frames); },
      .state = [axis](std::uint8_t state) { fw_can_bus(axis, state); }};
  const auto start = Clock::now();
  for (std::int64_t tick = 0; plant.running() && (tick % 150 != 0 || !is_closed()); ++tick) {
    // After a late tick the following ones come at once, so that the plant keeps its time.
    std::this_thread::sleep_until(start + std::chrono::nanoseconds(tick * 2000000 / 3));
    port.receive(handlers);
    plant.act(firmware.tick(plant.sense()));
    for (can_frame_t frame{}; fw_can_transmit(axis, &frame);) port.send(frame);
  }
}

}  // namespace

int main(int argc, char **argv) {
  const std::vector<std::string> overrides(argv + 4, argv + argc);
  host::Experiment experiment = host::load_experiment(argv[1], overrides);
  host::make_endless(experiment);
  nodes::CanPort port(argv[2]);
  std::puts("ready");
  std::fflush(stdout);
  run(experiment, port, static_cast<std::uint8_t>(std::atoi(argv[3])));
}
