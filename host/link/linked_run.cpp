#include "host/link/linked_run.hpp"

#include <time.h>

#include <array>
#include <utility>

#include "host/link/can_transport.hpp"
#include "host/link/lcm_transport.hpp"
#include "host/run/plant_side.hpp"

namespace forceaxis::host {
namespace {

using Clock = std::chrono::steady_clock;

std::string url_of(const LinkOptions &options) {
  return options.lcm_url.empty() ? lcm_url_of(options.run_id) : options.lcm_url;
}

bool injects(const Injection &injection) {
  return injection.drop > 0 || injection.duplicate > 0 || injection.flip_tick.has_value();
}

std::unique_ptr<PlantTransport> open_plant_transport(const LinkOptions &options,
                                                     InjectionCounts &counts) {
  auto transport = options.kind == "lcm" ? lcm_plant_transport(url_of(options), options.run_id)
                                         : can_plant_transport(options.can_interface);
  if (!injects(options.injection)) return transport;
  return injecting(std::move(transport), options.injection, counts);
}

// Returns the text `where` for a LinkClaim: the CAN interface, or the run and its URL.
std::string claimed(const LinkOptions &options) {
  return options.kind == "lcm" ? "run " + std::to_string(options.run_id) + " on " + url_of(options)
                               : options.can_interface;
}

std::string plant_role(const LinkOptions &options, int axis) {
  return options.kind == "lcm" ? "plant of axis " + std::to_string(axis) : "plant";
}
std::string axis_role(int axis) { return "axis " + std::to_string(axis); }

// Waits for the due time of each tick. The due time of tick k is k / 1500 s after the first tick.
class Pacer {
 public:
  // If a tick is late by more than `most_late_ns`, its due time becomes the present time, and the
  // due times of the next ticks are counted from this time.
  explicit Pacer(std::int64_t most_late_ns) : most_late_ns_(most_late_ns) {}

  void wait_for(std::int64_t tick) {
    const std::int64_t now = now_ns();
    std::int64_t due_ns = start_ns_ + tick * 2000000 / 3;
    if (!started_ || now - due_ns > most_late_ns_) {
      start_ns_ += now - due_ns;
      due_ns = now;
      started_ = true;
    }
    due_ns_ = due_ns;
    if (now > due_ns + 2000000 / 3) ++overruns;
    const timespec due{due_ns / 1000000000, due_ns % 1000000000};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, nullptr) != 0) {
    }
  }
  // Returns the time in us since the due time of the last tick.
  std::int64_t late_us() const { return started_ ? (now_ns() - due_ns_) / 1000 : 0; }
  std::int64_t overruns = 0;

 private:
  static std::int64_t now_ns() {
    timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return std::int64_t{now.tv_sec} * 1000000000 + now.tv_nsec;
  }
  std::int64_t most_late_ns_;
  bool started_ = false;
  std::int64_t start_ns_ = 0, due_ns_ = 0;
};

}  // namespace

std::string link_text(const LinkOptions &options) {
  if (options.kind == "lcm") {
    return "lcm " + url_of(options) + " run " + std::to_string(options.run_id);
  }
  return "socketcan " + options.can_interface;
}

struct LinkedPlants::Ends {
  Ends(std::span<const Experiment> experiments, std::uint8_t first, const RunOptions &run_options,
       const LinkOptions &link_options)
      : first_axis(first), options(link_options) {
    for (std::size_t i = 0; i < experiments.size(); ++i) {
      const int axis = first + static_cast<int>(i);
      claims.push_back(std::make_unique<LinkClaim>(claimed(options), plant_role(options, axis)));
      // All axes on CAN use one interface, so one lock of this interface is enough.
      if (options.kind != "lcm") break;
    }
    transport = open_plant_transport(options, report.injected);
    exchange = std::make_unique<PlantExchange>(*transport, options.timeouts);
    exchange->late = [stop = run_options.stop] {
      if (stop && stop()) throw RunStopped();
    };
    plants.reserve(experiments.size());
    for (const Experiment &experiment : experiments) plants.emplace_back(experiment, run_options);
  }

  std::uint8_t first_axis;
  LinkOptions options;
  LinkReport report;
  std::vector<std::unique_ptr<LinkClaim>> claims;
  std::unique_ptr<PlantTransport> transport;
  std::unique_ptr<PlantExchange> exchange;
  std::vector<PlantSide> plants;
};

LinkedPlants::LinkedPlants(std::span<const Experiment> experiments, std::uint8_t first_axis,
                           const RunOptions &run_options, const LinkOptions &options)
    : ends_(std::make_unique<Ends>(experiments, first_axis, run_options, options)) {}

LinkedPlants::~LinkedPlants() = default;

// The plants' side of a session. The session continues after a suspension of this process, and
// after axis_node has sent nothing for some time.
class LinkedPlants::Session {
 public:
  Session(Ends &ends, const LinkSession &session)
      : ends_(ends), session_(session), stall_(ends.options.timeouts.running) {
    ends.exchange->late = [this] {
      check_self();
      if (session_.ended()) throw RunStopped();
    };
    ends.exchange->silent = [this](unsigned axes) {
      if (!check_self()) wait_for(axes);
      return true;
    };
  }
  ~Session() { ends_.exchange->late = {}, ends_.exchange->silent = {}; }
  Session(const Session &) = delete;
  Session &operator=(const Session &) = delete;

  // Must be called at the start of each tick. Returns false if the session has ended.
  bool begin(std::int64_t tick) {
    tick_ = tick;
    check_self();
    return !session_.ended();
  }

  // Must be called in each tick after all axes have answered.
  void answered() {
    if (tick_ == 0) {
      for (std::size_t i = 0; i < ends_.plants.size(); ++i) {
        const int axis = ends_.first_axis + static_cast<int>(i);
        if (axis_held(ends_.options, axis)) visible_ |= 1U << (axis - 1);
      }
    }
    if (!silent_since_) return;
    const auto time =
        std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - *silent_since_);
    silent_since_.reset();
    session_.report(tick_, false,
                    "axis_node was silent for " + ends_.report.interruptions.add(time) +
                        "; continues at tick " + std::to_string(tick_));
  }

 private:
  // Returns true if this process was suspended since the last call.
  bool check_self() {
    const auto stalled = stall_.poll();
    if (!stalled) return false;
    session_.report(tick_, false,
                    "suspended for " + ends_.report.interruptions.add(*stalled) +
                        "; continues at tick " + std::to_string(tick_));
    return true;
  }

  void wait_for(unsigned axes) {
    for (int axis = 1; axis <= kMostAxes; ++axis) {
      if ((axes & visible_ & 1U << (axis - 1)) == 0 || axis_held(ends_.options, axis)) continue;
      ends_.report.axis_ended = true;
      throw RunStopped();
    }
    if (silent_since_) return;
    silent_since_ = Clock::now() - ends_.options.timeouts.running;
    session_.report(tick_, true,
                    "axis_node (" + axes_text(axes) + ") silent at tick " + std::to_string(tick_) +
                        ": the plant waits for axis_node");
  }

  Ends &ends_;
  const LinkSession &session_;
  StallWatch stall_;
  std::int64_t tick_ = 0;
  // Bit axis - 1 is set if the axis_node of this axis runs on this machine, so that its end can be
  // detected.
  unsigned visible_ = 0;
  std::optional<Clock::time_point> silent_since_;
};

std::vector<RunResult> LinkedPlants::run(bool real_time, const LinkWatch &watch,
                                         const LinkSession *of_session) {
  Ends &ends = *ends_;
  std::optional<Session> session;
  std::int64_t most_late_ns = INT64_MAX / 2;
  if (of_session != nullptr) {
    session.emplace(ends, *of_session);
    most_late_ns = std::chrono::nanoseconds(ends.options.timeouts.running).count();
  }
  Pacer pacer(most_late_ns);
  Clock::time_point first_answer{};
  std::array<LinkInputs, kMostAxes> inputs;
  std::array<LinkOutputs, kMostAxes> outputs;
  std::array<PlantSide *, kMostAxes> running;
  for (std::int64_t tick = 0;; ++tick) {
    std::size_t n = 0;
    if (real_time && tick > 0) pacer.wait_for(tick - 1);
    if (session && !session->begin(tick)) break;
    for (std::size_t i = 0; i < ends.plants.size(); ++i) {
      if (!ends.plants[i].running()) continue;
      running[n] = &ends.plants[i];
      inputs[n] = ends.plants[i].sense();
      inputs[n].axis = static_cast<std::uint8_t>(ends.first_axis + i);
      ++n;
    }
    if (n == 0) break;
    try {
      ends.exchange->exchange({inputs.data(), n}, {outputs.data(), n});
    } catch (const RunStopped &) {
      if (!session) throw;
      break;
    }
    if (session) session->answered();
    if (watch && tick % kTicksBetweenMoments == 0) {
      LinkMoment moment{tick, std::nullopt, {}};
      if (real_time) moment.late_us = pacer.late_us();
      for (std::size_t i = 0; i < n; ++i) {
        moment.axes.push_back({inputs[i].axis, &running[i]->plant()});
      }
      watch(moment);
    }
    for (std::size_t i = 0; i < n; ++i) running[i]->act(outputs[i]);
    ends.report.ticks = tick + 1;
    ends.report.overruns = pacer.overruns;
    const Clock::time_point now = Clock::now();
    if (tick == 0) first_answer = now;
    ends.report.seconds = std::chrono::duration<double>(now - first_answer).count();
  }
  std::vector<RunResult> results;
  for (PlantSide &plant : ends.plants) results.push_back(plant.finish());
  return results;
}

LinkReport LinkedPlants::report() const {
  LinkReport report = ends_->report;
  report.statistics = ends_->exchange->statistics();
  return report;
}

std::unique_ptr<LinkClaim> claim_axis(const LinkOptions &options, int axis) {
  return std::make_unique<LinkClaim>(claimed(options), axis_role(axis));
}

bool plant_held(const LinkOptions &options, int axis) {
  return LinkClaim::held(claimed(options), plant_role(options, axis));
}

bool axis_held(const LinkOptions &options, int axis) {
  return LinkClaim::held(claimed(options), axis_role(axis));
}

std::unique_ptr<AxisTransport> open_axis_transport(const LinkOptions &options,
                                                   InjectionCounts &counts) {
  auto transport = options.kind == "lcm" ? lcm_axis_transport(url_of(options), options.run_id)
                                         : can_axis_transport(options.can_interface);
  if (!injects(options.injection)) return transport;
  return injecting(std::move(transport), options.injection, counts);
}

}  // namespace forceaxis::host
