#pragma once
// The LCM side of a simulator: what host/lcm/axis.lcm says, with seq, run_id and times filled in.
#include <cstdint>
#include <forceaxis/sim_clock_t.hpp>
#include <forceaxis/sim_truth_t.hpp>
#include <lcm/lcm-cpp.hpp>
#include <string>

namespace forceaxis::lcm_bus {

class SimChannels {
 public:
  // Throws std::runtime_error: no such bus, or no route for multicast.
  explicit SimChannels(const std::string &url);

  // The message holds `tick` or `first_tick`; utime follows from it.
  void publish(sim_clock_t &clock);
  void publish(sim_truth_t &truth);

 private:
  lcm::LCM lcm_;
  std::int64_t run_id_;
  std::int64_t clocks_ = 0, truths_ = 0;
};

}  // namespace forceaxis::lcm_bus
