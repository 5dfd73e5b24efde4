#pragma once
// How records travel: datagrams that may be lost, doubled or late. What makes a run of them that
// needs each exactly once is exchange.hpp.
#include <chrono>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>

#include "host/run/records.hpp"

namespace forceaxis::host {

// The transport cannot be had, or the machine refuses it. One line, with what to do.
struct TransportError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// One end of a link; `Out` is what it sends, `In` what it receives. Belongs to one thread.
template <class Out, class In>
class Transport {
 public:
  virtual ~Transport() = default;

  // Puts each record on the wire once. Throws TransportError if the machine refuses.
  virtual void send(std::span<const Out> records) = 0;

  // Waits until a record has come or the time is over, then takes what is there without waiting
  // further. Returns how many, 0 after the time or when something came that was no record of ours.
  virtual std::size_t receive(std::span<In> records, std::chrono::milliseconds wait) = 0;

  // Of everything that arrived and was of no use: another run's, or malformed.
  virtual std::uint64_t foreign() const = 0;
};

using PlantTransport = Transport<LinkInputs, LinkOutputs>;
using AxisTransport = Transport<LinkOutputs, LinkInputs>;

}  // namespace forceaxis::host
