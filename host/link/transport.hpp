#pragma once
// Carries records as datagrams that may be lost, duplicated or late. exchange.hpp makes a run of
// them, in which each tick is computed exactly once.
#include <chrono>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>

#include "host/run/records.hpp"

namespace forceaxis::host {

// The transport cannot be opened, or the system refuses a call. what() is one line with the remedy.
struct TransportError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// One end of a link; `Out` is what it sends, `In` what it receives. Belongs to one thread.
template <class Out, class In>
class Transport {
 public:
  virtual ~Transport() = default;

  // Sends each record once. Throws TransportError if the system refuses.
  virtual void send(std::span<const Out> records) = 0;

  // Waits for a record, at most `wait`, then receives what is pending without further waiting.
  // Returns how many records; 0 after the time, or when only foreign data came.
  virtual std::size_t receive(std::span<In> records, std::chrono::milliseconds wait) = 0;

  // How many arrived that were no records of this run: another run's, or malformed.
  virtual std::uint64_t foreign() const = 0;
};

using PlantTransport = Transport<LinkInputs, LinkOutputs>;
using AxisTransport = Transport<LinkOutputs, LinkInputs>;

}  // namespace forceaxis::host
