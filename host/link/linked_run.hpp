#pragma once
// The process of the plants, in a run whose firmware runs in another process, for all axes.
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
  // Transport of the link: "lcm" or "socketcan".
  std::string kind = "lcm";
  // Name of the CAN interface. This interface must carry no other frames.
  std::string can_interface = "vcan1";
  std::string lcm_url;  // URL for LCM. If the URL is empty, lcm_url_of(run_id) is used.
  std::int64_t run_id = 1;
  LinkTimeouts timeouts;
  Injection injection;
};

// Returns the kind of the link and its interface or URL as text for messages.
std::string link_text(const LinkOptions &options);

struct LinkReport {
  LinkStatistics statistics;
  InjectionCounts injected;
  // Number of ticks of the axis whose run is the longest.
  std::int64_t ticks = 0;
  // Time in s from the first to the last answer of the firmware.
  double seconds = 0;
  // Number of ticks of a paced run that began more than one tick period late.
  std::int64_t overruns = 0;
  // Interruptions of a session, in which no tick was computed.
  Interruptions interruptions;
  bool axis_ended = false;  // true: the run has ended because axis_node has ended
};

// Functions by which a session is ended and reports its state. run() calls these functions in its
// own thread.
struct LinkSession {
  // Function that returns true if the session must end. It is called in every tick, and while an
  // answer is late.
  std::function<bool()> ended;
  // Function that is called with one line of text when the session is interrupted or continues.
  // `paused` is true while the plants wait for an axis_node that sends nothing.
  std::function<void(std::int64_t tick, bool paused, const std::string &text)> report;
};

// The progress of a run at one tick. It is the argument of the function LinkWatch.
struct LinkMoment {
  struct Axis {
    int number;
    const sim::Plant *plant;
  };
  std::int64_t tick = 0;
  // Delay of this tick in us relative to the wall clock; empty if the run is not paced.
  std::optional<std::int64_t> late_us;
  std::vector<Axis> axes;  // the axes whose run has not ended at this tick
};
constexpr std::int64_t kTicksBetweenMoments = 150;  // a time of 0.1 s
using LinkWatch = std::function<void(const LinkMoment &)>;

// The plants of a run. The constructor opens the link, so that an error is found before plant_node
// prints the line "ready".
class LinkedPlants {
 public:
  // experiments[i] is the experiment of axis first_axis + i. The experiments must exist as long as
  // this object. Throws TransportError.
  LinkedPlants(std::span<const Experiment> experiments, std::uint8_t first_axis,
               const RunOptions &run_options, const LinkOptions &options);
  ~LinkedPlants();

  // Simulates all ticks. With `real_time`, a tick does not begin before its time on the wall clock.
  // RunResult::refused is empty, because the other process reports refused writes. `watch` is
  // called every kTicksBetweenMoments ticks, beginning at tick 0, after the firmware has answered.
  // A session ends when LinkSession::ended returns true or axis_node has ended. While axis_node
  // sends nothing, the plants of a session wait, and the time of this wait is not simulated later.
  // Throws TransportError, LinkSilent (in a session only before the first answer) and the
  // exceptions of host::run(). report() is valid after an exception too.
  std::vector<RunResult> run(bool real_time, const LinkWatch &watch = {},
                             const LinkSession *session = nullptr);

  LinkReport report() const;

 private:
  struct Ends;
  class Session;
  std::unique_ptr<Ends> ends_;
};

// Locks an axis of the link. While the LinkClaim exists, no other process of this machine can be
// this axis. `axis` is counted from 1. Throws TransportError.
std::unique_ptr<LinkClaim> claim_axis(const LinkOptions &options, int axis);

// Return true if a process of this machine and network namespace has locked the plant, or the
// firmware, of this axis. A suspended process keeps its locks.
bool plant_held(const LinkOptions &options, int axis);
bool axis_held(const LinkOptions &options, int axis);

// Opens the firmware's end of the link. `counts` must exist as long as the transport. Throws
// TransportError.
std::unique_ptr<AxisTransport> open_axis_transport(const LinkOptions &options,
                                                   InjectionCounts &counts);

}  // namespace forceaxis::host
