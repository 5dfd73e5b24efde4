#pragma once
// Publishes the plants of a linked run on the LCM channels SIM_CLOCK and SIM_TRUTH, for monitor
// programs.
#include <chrono>
#include <optional>

#include "host/lcm/sim_channels.hpp"
#include "host/link/linked_run.hpp"

namespace forceaxis::nodes {

class LivePlants {
 public:
  // Throws the same exceptions as the constructor of lcm_bus::SimChannels.
  explicit LivePlants(const std::string &url) : lcm_(url) {}

  // Publishes the simulated time and the true signals of every axis at this tick.
  void show(const host::LinkMoment &moment);
  // Publishes a text that a session is interrupted or continues. `paused` is true while the plants
  // wait for axis_node.
  void report(std::int64_t tick, bool paused, const std::string &text);
  // Publishes that the run ended at `tick`. `why` is empty unless the run failed.
  void end(std::int64_t tick, const std::string &why);

 private:
  struct Before {
    std::int64_t tick;
    std::chrono::steady_clock::time_point at;
  };

  lcm_bus::SimChannels lcm_;
  std::optional<Before> before_;
};

}  // namespace forceaxis::nodes
