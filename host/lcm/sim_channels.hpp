#pragma once
// The LCM channels of a simulator (host/lcm/axis.lcm). This class sets the fields seq, run_id and
// times.
#include <cstdint>
#include <forceaxis/sim_clock_t.hpp>
#include <forceaxis/sim_truth_t.hpp>
#include <lcm/lcm-cpp.hpp>
#include <string>

namespace forceaxis::lcm_bus {

class SimChannels {
 public:
  // Opens the URL. Throws std::runtime_error if the URL cannot be opened or the machine has no
  // route for multicast.
  explicit SimChannels(const std::string &url);

  // Publish a message. The caller must set the field `tick` or `first_tick`, from which utime is
  // computed.
  void publish(sim_clock_t &clock);
  void publish(sim_truth_t &truth);

 private:
  lcm::LCM lcm_;
  std::int64_t run_id_;
  std::int64_t clocks_ = 0, truths_ = 0;
};

}  // namespace forceaxis::lcm_bus
