#pragma once
// The protocol of a link: stop and wait. The plant is the master. It sends the inputs of a tick and
// repeats them until it has received the outputs of that tick. The firmware computes each tick
// once. If the same inputs arrive again, it repeats the stored outputs; it ignores inputs of any
// other tick. So both sides compute the same ticks with the same values, even if the transport
// loses, duplicates or delays records.
#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "host/link/transport.hpp"

namespace forceaxis::host {

// Numbers of records, as one side of the link counts them.
struct LinkStatistics {
  std::uint64_t sent = 0;      // records passed to the transport, with repeated ones
  std::uint64_t received = 0;  // received records of this run for axes of this process
  // Records that were sent again: by the plant because an answer was late, by the firmware because
  // inputs arrived again.
  std::uint64_t repeated = 0;
  std::uint64_t duplicates = 0;  // records received for a tick that was already complete
  std::uint64_t foreign = 0;     // records of another run, and malformed records
};

// Time after which a partner that sends nothing counts as silent.
struct LinkTimeouts {
  // Longest silence before the first record of the partner.
  std::chrono::milliseconds start{5000};
  std::chrono::milliseconds running{1000};
};

// The partner has sent nothing for longer than LinkTimeouts allow.
struct LinkSilent : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class PlantExchange {
 public:
  PlantExchange(PlantTransport &transport, const LinkTimeouts &timeouts)
      : transport_(transport), timeouts_(timeouts) {}

  // Exchanges one tick of some axes. outputs[i] becomes the answer to inputs[i]. Throws LinkSilent,
  // which names the axes that did not answer in time, and TransportError.
  void exchange(std::span<const LinkInputs> inputs, std::span<LinkOutputs> outputs);

  // Called at intervals while an answer is late. An exception from this function ends the exchange.
  std::function<void()> late;
  // Called if axes that have answered before are silent for longer than the timeout, and again
  // after each further timeout. Bit axis - 1 of `axes` is set for each silent axis. If it returns
  // true, the exchange continues to wait. If it returns false, or is empty, the exchange throws
  // LinkSilent.
  std::function<bool(unsigned axes)> silent;

  LinkStatistics statistics() const;

 private:
  void wait_on(std::span<const LinkInputs> inputs, std::span<LinkOutputs> outputs,
               unsigned missing);
  unsigned take(std::span<const LinkInputs> inputs, std::span<LinkOutputs> outputs,
                std::chrono::milliseconds wait);

  PlantTransport &transport_;
  LinkTimeouts timeouts_;
  LinkStatistics statistics_;
  bool idle_ = false;      // No record arrived during the last wait.
  unsigned answered_ = 0;  // axes that have answered before; bit axis - 1 for each
};

// The end of the link at the firmware, for the axes of one process.
class AxisExchange {
 public:
  // `compute` is called once for each tick and axis, in order. `axes` are the numbers of the axes
  // of this process.
  using Compute = std::function<LinkOutputs(const LinkInputs &)>;
  // `ticks` are the last ticks of the axes, in the order of `axes`.
  AxisExchange(AxisTransport &transport, const LinkTimeouts &timeouts,
               std::span<const std::uint8_t> axes, std::span<const std::int64_t> last_ticks,
               Compute compute);

  // Answers the records that arrive within `wait`. Returns the axes whose plant has become silent,
  // with bit axis - 1 for each. These axes are then finished.
  unsigned serve(std::chrono::milliseconds wait);

  // Returns whether every axis has computed its last tick or has lost its plant. The last answer
  // may have been lost: the caller must continue to call serve() until quiet(), the time since the
  // last record, is long enough.
  bool finished() const { return running_ == 0; }
  // Continues to serve axes after their plant became silent. `axes` has bit axis - 1 for each.
  void resume(unsigned axes);
  std::chrono::milliseconds quiet() const;

  LinkStatistics statistics() const;

 private:
  using Clock = std::chrono::steady_clock;

  struct Axis {
    bool hosted = false;
    bool fresh = false;  // A record has arrived since the clock was last read.
    std::int64_t last_tick = 0;
    Clock::time_point received{};
    // Answer to the last computed tick. Its tick is -1 before the first tick.
    LinkOutputs answer{};
  };

  unsigned supervise();

  AxisTransport &transport_;
  LinkTimeouts timeouts_;
  Compute compute_;
  std::array<Axis, kMostAxes> axes_{};
  unsigned running_ = 0;  // axes that have not finished; bit axis - 1 for each
  unsigned calls_ = 0;
  Clock::time_point received_;
  LinkStatistics statistics_;
};

// Returns "axis 1" or "axes 1, 3" for the axes with bit axis - 1 set.
std::string axes_text(unsigned axes);

}  // namespace forceaxis::host
