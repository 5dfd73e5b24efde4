#pragma once
// Stop and wait. The plant is master: it sends the inputs of a tick and repeats them until it has
// received the outputs of that tick. The firmware computes a tick once, repeats its stored outputs
// when the inputs arrive again, and ignores inputs of any other tick. So whatever a transport
// loses, duplicates or delays, both sides compute the same ticks with the same values.
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

// Records, as one side sees them.
struct LinkStatistics {
  std::uint64_t sent = 0;      // handed to the transport, repeats included
  std::uint64_t received = 0;  // of this run, for a hosted axis
  std::uint64_t repeated = 0;  // sent again: no answer in time (plant), inputs repeated (firmware)
  std::uint64_t duplicates = 0;  // received for a tick that was done already
  std::uint64_t foreign = 0;     // not of this run, or malformed
};

// How long the partner may send nothing before it counts as silent.
struct LinkTimeouts {
  std::chrono::milliseconds start{5000};  // before its first record
  std::chrono::milliseconds running{1000};
};

// The partner sent nothing for longer than LinkTimeouts allow.
struct LinkSilent : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class PlantExchange {
 public:
  PlantExchange(PlantTransport &transport, const LinkTimeouts &timeouts)
      : transport_(transport), timeouts_(timeouts) {}

  // One tick of some axes. outputs[i] becomes the answer to inputs[i]. Throws LinkSilent naming the
  // axes that did not answer in time, TransportError.
  void exchange(std::span<const LinkInputs> inputs, std::span<LinkOutputs> outputs);

  // Called now and then while an answer is late; what it throws ends the exchange.
  std::function<void()> late;
  // Called when axes that answered before, bits axis - 1, are silent for longer than the timeout,
  // and each such time again: true waits on. Empty, or false: the exchange throws LinkSilent.
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
  bool idle_ = false;      // nothing at all came in the last wait
  unsigned answered_ = 0;  // bit axis - 1: it has answered before
};

// The firmware's end, for some axes in one process.
class AxisExchange {
 public:
  // `compute` is called once a tick and axis, in order; `axes` are the numbers hosted here.
  using Compute = std::function<LinkOutputs(const LinkInputs &)>;
  // Until which tick each axis runs, in the order of `axes`.
  AxisExchange(AxisTransport &transport, const LinkTimeouts &timeouts,
               std::span<const std::uint8_t> axes, std::span<const std::int64_t> last_ticks,
               Compute compute);

  // Answers the records received within `wait`. Returns the axes whose plant has fallen silent, as
  // bits axis - 1; those are then finished.
  unsigned serve(std::chrono::milliseconds wait);

  // Every axis has done its last tick, or its plant has fallen silent. The last answer may have
  // been lost: call serve() until quiet(), the time since the last record, is long enough.
  bool finished() const { return running_ == 0; }
  // These axes, bits axis - 1, are served on after their plant fell silent.
  void resume(unsigned axes);
  std::chrono::milliseconds quiet() const;

  LinkStatistics statistics() const;

 private:
  using Clock = std::chrono::steady_clock;

  struct Axis {
    bool hosted = false;
    bool fresh = false;  // a record was received since the clock was last read
    std::int64_t last_tick = 0;
    Clock::time_point received{};
    LinkOutputs answer{};  // to the tick done last; its tick is -1 before the first
  };

  unsigned supervise();

  AxisTransport &transport_;
  LinkTimeouts timeouts_;
  Compute compute_;
  std::array<Axis, kMostAxes> axes_{};
  unsigned running_ = 0;  // bits axis - 1
  unsigned calls_ = 0;
  Clock::time_point received_;
  LinkStatistics statistics_;
};

// "axis 1", "axes 1, 3": of bits axis - 1.
std::string axes_text(unsigned axes);

}  // namespace forceaxis::host
