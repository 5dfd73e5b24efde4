#pragma once
// Carries records as datagrams, which may be lost, duplicated or late. The protocol of exchange.hpp
// ensures that each tick is computed exactly once.
#include <chrono>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>

#include "host/run/records.hpp"

namespace forceaxis::host {

// The transport cannot be opened, or the operating system refuses a call. what() is one line with
// the remedy.
struct TransportError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// One end of a link. `Out` is the type of the records that it sends, `In` of those that it
// receives. An object belongs to one thread.
template <class Out, class In>
class Transport {
 public:
  virtual ~Transport() = default;

  // Sends each record once. Throws TransportError if the operating system refuses.
  virtual void send(std::span<const Out> records) = 0;

  // Waits at most `wait` for a record, then receives all pending records. Returns the number of
  // records of this run, which is 0 if the time has expired or only foreign data has arrived.
  virtual std::size_t receive(std::span<In> records, std::chrono::milliseconds wait) = 0;

  // Returns the number of received records that do not belong to this run or are malformed.
  virtual std::uint64_t foreign() const = 0;
};

using PlantTransport = Transport<LinkInputs, LinkOutputs>;
using AxisTransport = Transport<LinkOutputs, LinkInputs>;

}  // namespace forceaxis::host
