#pragma once
// The stop-and-wait protocol of a link. The plant is the master: it sends the inputs of a tick, and
// repeats these inputs until it has received the outputs of the same tick. The firmware computes
// each tick once. If the inputs of the last tick arrive again, the firmware repeats the stored
// outputs. The firmware ignores the inputs of all other ticks. So plant and firmware compute the
// same ticks with the same values, even if the transport loses, duplicates or delays messages.
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

// Numbers of messages that one side of the link has counted. A message is a record of records.hpp.
struct LinkStatistics {
  // Number of messages passed to the transport, including repeated messages.
  std::uint64_t sent = 0;
  // Number of received messages that belong to this run and to an axis of this process.
  std::uint64_t received = 0;
  // Number of messages that were sent again. The plant repeats a message if the answer is late. The
  // firmware repeats its answer if the same inputs arrive again.
  std::uint64_t repeated = 0;
  std::uint64_t duplicates = 0;  // number of messages received for a tick that was already complete
  std::uint64_t foreign = 0;     // number of malformed messages and of messages of other runs
};

// Times without a message after which a process is regarded as silent, that is, as stopped or no
// longer connected.
struct LinkTimeouts {
  // Longest time to wait for the first message of the other process.
  std::chrono::milliseconds start{5000};
  std::chrono::milliseconds running{1000};
};

// Error: the other process has sent nothing for one of the times in LinkTimeouts.
struct LinkSilent : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class PlantExchange {
 public:
  PlantExchange(PlantTransport &transport, const LinkTimeouts &timeouts)
      : transport_(transport), timeouts_(timeouts) {}

  // Exchanges one tick of some axes. The answer to inputs[i] is written to outputs[i]. Throws
  // LinkSilent, which names the axes that did not answer in time, and TransportError.
  void exchange(std::span<const LinkInputs> inputs, std::span<LinkOutputs> outputs);

  // Function that is called at intervals while an answer is late. An exception from this function
  // ends exchange().
  std::function<void()> late;
  // Function that is called if axes that have answered before do not answer for longer than the
  // timeout, and again after each further timeout. Bit axis - 1 of `axes` is set for each axis that
  // does not answer. If this function returns true, the exchange continues to wait. If the function
  // returns false or is empty, the exchange throws LinkSilent.
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
  bool idle_ = false;      // true: the last wait ended without a message
  unsigned answered_ = 0;  // set of the axes that have answered: bit 0 for axis 1, bit 1 for axis 2
};

// The firmware's side of the link, for the axes of one process.
class AxisExchange {
 public:
  // `compute` is called once for each tick and axis, in the order of the ticks. `axes` has the
  // numbers of the axes of this process.
  using Compute = std::function<LinkOutputs(const LinkInputs &)>;
  // `last_ticks` has the last tick of each axis, in the order of `axes`.
  AxisExchange(AxisTransport &transport, const LinkTimeouts &timeouts,
               std::span<const std::uint8_t> axes, std::span<const std::int64_t> last_ticks,
               Compute compute);

  // Answers the messages that arrive within the time `wait`. Returns the axes whose plant has sent
  // nothing for the timeout, as a word with bit 0 for axis 1. These axes are then finished.
  unsigned serve(std::chrono::milliseconds wait);

  // Returns true if, for every axis, the last tick was computed or the plant has stopped sending.
  // Because the last answer may have been lost, the caller must continue to call serve() until
  // quiet(), the time since the last message, is long enough.
  bool finished() const { return running_ == 0; }
  // Continues to serve axes whose plant had sent nothing for the timeout. Bit axis - 1 of `axes` is
  // set for each of these axes.
  void resume(unsigned axes);
  std::chrono::milliseconds quiet() const;

  LinkStatistics statistics() const;

 private:
  using Clock = std::chrono::steady_clock;

  struct Axis {
    bool hosted = false;
    bool fresh = false;  // true: a message has arrived since the clock was last read
    std::int64_t last_tick = 0;
    Clock::time_point received{};
    // Outputs of the last computed tick. answer.tick is -1 before the first tick.
    LinkOutputs answer{};
  };

  unsigned supervise();

  AxisTransport &transport_;
  LinkTimeouts timeouts_;
  Compute compute_;
  std::array<Axis, kMostAxes> axes_{};
  unsigned running_ = 0;  // set of the axes whose run has not ended: bit 0 for axis 1, bit 1 for
                          // axis 2
  unsigned calls_ = 0;
  Clock::time_point received_;
  LinkStatistics statistics_;
};

// Returns a text such as "axis 1" or "axes 1, 3" for a word with bit 0 for axis 1.
std::string axes_text(unsigned axes);

}  // namespace forceaxis::host
