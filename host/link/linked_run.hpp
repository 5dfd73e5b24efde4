#pragma once
// The plant's end of a run whose firmware is another process, for one or several axes.
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
  std::string kind = "lcm";             // or "socketcan"
  std::string can_interface = "vcan1";  // of its own, no other traffic
  std::string lcm_url;                  // empty: lcm_url_of(run_id)
  std::int64_t run_id = 1;
  LinkTimeouts timeouts;
  Injection injection;
};

// The link as messages name it: its kind and interface or URL.
std::string link_text(const LinkOptions &options);

struct LinkReport {
  LinkStatistics statistics;
  InjectionCounts injected;
  std::int64_t ticks = 0;     // of the longest axis
  double seconds = 0;         // from the first answer to the last
  std::int64_t overruns = 0;  // paced ticks that began more than a tick late
  // Of a session:
  Interruptions interruptions;
  bool axis_ended = false;  // axis_node ended before it was ended here
};

// How the plants of a session are ended, and what they report. Runs in the thread of run().
struct LinkSession {
  std::function<bool()> ended;  // asked every tick, and while an answer is late
  // One line for each change: `paused` while the plants wait for a silent axis_node.
  std::function<void(std::int64_t tick, bool paused, const std::string &text)> report;
};

// The progress of a run, passed to a LinkWatch.
struct LinkMoment {
  struct Axis {
    int number;
    const sim::Plant *plant;
  };
  std::int64_t tick = 0;
  std::optional<std::int64_t> late_us;  // delay against the wall clock; none: the run is not paced
  std::vector<Axis> axes;               // those that still run, at this tick
};
constexpr std::int64_t kTicksBetweenMoments = 150;  // a tenth of a second
using LinkWatch = std::function<void(const LinkMoment &)>;

// The plants of a run. The constructor acquires the link, so that it fails before the run is
// reported as ready.
class LinkedPlants {
 public:
  // experiments[i] is that of axis first_axis + i; they must outlive this. Throws TransportError.
  LinkedPlants(std::span<const Experiment> experiments, std::uint8_t first_axis,
               const RunOptions &run_options, const LinkOptions &options);
  ~LinkedPlants();

  // All ticks. `real_time`: a tick begins at its time on the wall clock and not earlier. The
  // results' `refused` are empty: the other process reports refusals. `watch` is called every
  // kTicksBetweenMoments, from tick 0 on, when the firmware has answered. A session ends when it is
  // ended or axis_node has ended; while axis_node is silent the plants stand still, and the clock's
  // ticks that they or axis_node missed are not caught up. Throws what run() throws, LinkSilent (in
  // a session only before the first answer), TransportError. report() is valid in either case.
  std::vector<RunResult> run(bool real_time, const LinkWatch &watch = {},
                             const LinkSession *session = nullptr);

  LinkReport report() const;

 private:
  struct Ends;
  class Session;
  std::unique_ptr<Ends> ends_;
};

// While it exists no other process of this machine can be this axis on the link. Throws
// TransportError. `axis` from 1.
std::unique_ptr<LinkClaim> claim_axis(const LinkOptions &options, int axis);

// Whether a process of this machine and network namespace has the plant, or the firmware, of this
// axis; also while that process is stopped.
bool plant_held(const LinkOptions &options, int axis);
bool axis_held(const LinkOptions &options, int axis);

// The firmware's end of the link; `counts` must outlive it. Throws TransportError.
std::unique_ptr<AxisTransport> open_axis_transport(const LinkOptions &options,
                                                   InjectionCounts &counts);

}  // namespace forceaxis::host
