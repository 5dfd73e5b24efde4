#include "host/plant_node/live_plants.hpp"

namespace forceaxis::nodes {

void LivePlants::show(const host::LinkMoment &moment) {
  const auto now = std::chrono::steady_clock::now();
  sim_clock_t clock{};
  clock.tick = moment.tick;
  clock.clock_state = sim_clock_t::CLOCK_RUNNING;
  clock.late_us = moment.late_us ? *moment.late_us : sim_clock_t::NOT_AVAILABLE;
  clock.speed_permille = sim_clock_t::NOT_AVAILABLE;
  if (before_ && now > before_->at) {
    const double simulated_s = static_cast<double>(moment.tick - before_->tick) / sim::kTickRateHz;
    const std::chrono::duration<double> wall = now - before_->at;
    clock.speed_permille = static_cast<std::int64_t>(1000 * simulated_s / wall.count() + 0.5);
  }
  before_ = {moment.tick, now};
  lcm_.publish(clock);
  for (const host::LinkMoment::Axis &axis : moment.axes) {
    sim_truth_t truth{};
    truth.axis = axis.number;
    truth.first_tick = moment.tick;
    truth.decimation = host::kTicksBetweenMoments;
    for (const sim::SignalInfo &signal : axis.plant->model().signal_list()) {
      truth.signal.push_back(signal.name);
      truth.unit.emplace_back(sim::unit_of(signal.dimension));
    }
    truth.num_signals = static_cast<std::int32_t>(truth.signal.size());
    truth.num_samples = 1;
    truth.value.emplace_back(truth.signal.size());
    axis.plant->signals(truth.value.front());
    lcm_.publish(truth);
  }
}

void LivePlants::report(std::int64_t tick, bool paused, const std::string &text) {
  sim_clock_t clock{};
  clock.tick = tick;
  clock.clock_state = paused ? sim_clock_t::CLOCK_PAUSED : sim_clock_t::CLOCK_RUNNING;
  clock.speed_permille = clock.late_us = sim_clock_t::NOT_AVAILABLE;
  clock.text = text;
  before_.reset();
  lcm_.publish(clock);
}

void LivePlants::end(std::int64_t tick, const std::string &why) {
  sim_clock_t clock{};
  clock.tick = tick;
  clock.clock_state = sim_clock_t::CLOCK_ENDED;
  clock.speed_permille = clock.late_us = sim_clock_t::NOT_AVAILABLE;
  clock.text = why;
  lcm_.publish(clock);
}

}  // namespace forceaxis::nodes
