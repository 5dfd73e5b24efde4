#pragma once
// Injects transport faults for tests: dropped records, duplicated records, and records with one
// wrong bit. The faults depend only on the seed and on the sent records.
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "host/link/transport.hpp"

namespace forceaxis::host {

struct Injection {
  double drop = 0;       // fraction, 0 to 1, of the sent records that are dropped
  double duplicate = 0;  // fraction, 0 to 1, of the sent records that are sent twice
  std::uint64_t seed = 1;
  // Tick whose first sent record has one inverted bit.
  std::optional<std::int64_t> flip_tick;
  // Number of the inverted bit: 0 to 63 in the fields encoder, adc0 and adc1, or 0 to 15 in the DAC
  // code.
  int flip_bit = 0;
};

// Reads a text such as "drop=0.05,double=0.05,seed=1,flip=TICK,bit=0"; each part is optional.
// Throws std::invalid_argument, which names the wrong part and the expected value.
Injection injection_of(const std::string &text);

struct InjectionCounts {
  std::uint64_t dropped = 0;
  std::uint64_t doubled = 0;
  std::uint64_t flipped = 0;
};

// Returns a transport that injects these faults into the sent records. `counts` must exist as long
// as the transport.
template <class Out, class In>
std::unique_ptr<Transport<Out, In>> injecting(std::unique_ptr<Transport<Out, In>> transport,
                                              const Injection &injection, InjectionCounts &counts);

extern template std::unique_ptr<PlantTransport> injecting(std::unique_ptr<PlantTransport>,
                                                          const Injection &, InjectionCounts &);
extern template std::unique_ptr<AxisTransport> injecting(std::unique_ptr<AxisTransport>,
                                                         const Injection &, InjectionCounts &);

}  // namespace forceaxis::host
