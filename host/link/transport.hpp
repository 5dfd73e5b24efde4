#pragma once
// Sends and receives the records of records.hpp as datagrams, which can be lost, duplicated or
// late. The protocol in exchange.hpp ensures that each tick is computed exactly once.
#include <chrono>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>

#include "host/run/records.hpp"

namespace forceaxis::host {

// Error: the transport cannot be opened, or the operating system refuses a call. what() returns one
// line with the remedy.
struct TransportError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// One end of a link. `Out` is the type of the sent records, `In` the type of the received records.
// Only one thread may use an object.
template <class Out, class In>
class Transport {
 public:
  virtual ~Transport() = default;

  // Sends each record once. Throws TransportError if the operating system refuses a record.
  virtual void send(std::span<const Out> records) = 0;

  // Waits for a record, at most the time `wait`, then receives all pending records. Returns the
  // number of received records of this run. This number is 0 if no record has arrived, or only
  // records of other runs.
  virtual std::size_t receive(std::span<In> records, std::chrono::milliseconds wait) = 0;

  // Returns the number of received records that do not belong to this run or are malformed.
  virtual std::uint64_t foreign() const = 0;
};

using PlantTransport = Transport<LinkInputs, LinkOutputs>;
using AxisTransport = Transport<LinkOutputs, LinkInputs>;

}  // namespace forceaxis::host
