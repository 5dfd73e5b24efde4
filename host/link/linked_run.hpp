#pragma once
// The plant's end of a run whose firmware is in another process, for one or several axes.
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "host/link/claim.hpp"
#include "host/link/exchange.hpp"
#include "host/link/inject.hpp"
#include "host/link/session.hpp"
#include "host/run/result.hpp"
#include "sim/hybrid/plant.hpp"

namespace forceaxis::host {

struct LinkOptions {
  std::string kind = "lcm";  // "lcm" or "socketcan"
  // Name of the CAN interface; it must carry no other frames.
  std::string can_interface = "vcan1";
  std::string lcm_url;  // URL for LCM; if empty, lcm_url_of(run_id) is used
  std::int64_t run_id = 1;
  LinkTimeouts timeouts;
  Injection injection;
};

// Returns the text of the link for messages: its kind and its interface or URL.
std::string link_text(const LinkOptions &options);

struct LinkReport {
  LinkStatistics statistics;
  InjectionCounts injected;
  std::int64_t ticks = 0;     // number of ticks of the axis with the longest run
  double seconds = 0;         // time from the first answer to the last answer of the firmware
  std::int64_t overruns = 0;  // ticks that began more than one tick period late in a paced run
  // In a session: times without ticks.
  Interruptions interruptions;
  bool axis_ended = false;  // The run has ended because axis_node has ended.
};

// Functions that end the plants of a session and report their state. They are called in the thread
// of run().
struct LinkSession {
  // Returns whether the session must end. Called in every tick, and while an answer is late.
  std::function<bool()> ended;
  // Called with one line for each change. `paused` is true while the plants wait for a silent
  // axis_node.
  std::function<void(std::int64_t tick, bool paused, const std::string &text)> report;
};

// The progress of a run, for the function LinkWatch.
struct LinkMoment {
  struct Axis {
    int number;
    const sim::Plant *plant;
  };
  std::int64_t tick = 0;
  // Delay of this tick relative to the wall clock, in us; empty if the run is not paced.
  std::optional<std::int64_t> late_us;
  std::vector<Axis> axes;  // axes that are still running at this tick
};
constexpr std::int64_t kTicksBetweenMoments = 150;  // 0.1 s
using LinkWatch = std::function<void(const LinkMoment &)>;

// The plants of a run. The constructor opens the link, so that an error occurs before the run is
// reported as ready.
class LinkedPlants {
 public:
  // experiments[i] is the experiment of axis first_axis + i. The experiments must exist as long as
  // this object. Throws TransportError.
  LinkedPlants(std::span<const Experiment> experiments, std::uint8_t first_axis,
               const RunOptions &run_options, const LinkOptions &options);
  ~LinkedPlants();

  // Simulates all ticks. With `real_time`, a tick does not begin before its time on the wall clock.
  // In the results, `refused` is empty, because the other process reports refused writes. `watch`
  // is called every kTicksBetweenMoments ticks, beginning at tick 0, after the firmware has
  // answered. A session ends when the function `ended` returns true or axis_node has ended. While
  // axis_node is silent, the plants wait; ticks that were missed are not made up. Throws the
  // exceptions of run(), LinkSilent (in a session only before the first answer) and TransportError.
  // report() is valid after an exception too.
  std::vector<RunResult> run(bool real_time, const LinkWatch &watch = {},
                             const LinkSession *session = nullptr);

  LinkReport report() const;

 private:
  struct Ends;
  class Session;
  std::unique_ptr<Ends> ends_;
};

// Claims an axis of the link. While the claim exists, no other process of this machine can be this
// axis. `axis` is counted from 1. Throws TransportError.
std::unique_ptr<LinkClaim> claim_axis(const LinkOptions &options, int axis);

// Return whether a process of this machine and network namespace has claimed the plant, or the
// firmware, of this axis. A suspended process still has its claim.
bool plant_held(const LinkOptions &options, int axis);
bool axis_held(const LinkOptions &options, int axis);

// Opens the firmware's end of the link. `counts` must exist as long as the transport. Throws
// TransportError.
std::unique_ptr<AxisTransport> open_axis_transport(const LinkOptions &options,
                                                   InjectionCounts &counts);

}  // namespace forceaxis::host
