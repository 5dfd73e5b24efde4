#include "host/lcm/sim_channels.hpp"

#include <random>
#include <stdexcept>

#include "host/lcm/lcm_ends.hpp"
#include "host/lcm/url.hpp"

namespace forceaxis::lcm_bus {
namespace {

std::int64_t utime_of(std::int64_t tick) { return tick * 2000 / 3; }

}  // namespace

SimChannels::SimChannels(const std::string &url) : lcm_(usable<std::runtime_error>(url)) {
  if (!lcm_.good()) throw std::runtime_error(url + ": expected a URL that LCM can open");
  std::random_device device;
  run_id_ = std::uniform_int_distribution<std::int64_t>(1, INT64_MAX)(device);
}

void SimChannels::publish(sim_clock_t &clock) {
  clock.utime = utime_of(clock.tick);
  clock.wall_utime = wall_us();
  clock.seq = clocks_++;
  clock.run_id = run_id_;
  lcm_.publish("SIM_CLOCK", &clock);
}

void SimChannels::publish(sim_truth_t &truth) {
  truth.utime = utime_of(truth.first_tick);
  truth.wall_utime = wall_us();
  truth.seq = truths_++;
  truth.run_id = run_id_;
  lcm_.publish("SIM_TRUTH", &truth);
}

}  // namespace forceaxis::lcm_bus
