#pragma once
// Faults of a transport, for tests: records dropped, doubled, or with one bit of their values
// flipped, below the exchange. A function of the seed and of the records sent alone.
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "host/link/transport.hpp"

namespace forceaxis::host {

struct Injection {
  double drop = 0;       // share of the records sent by this end that never leave
  double duplicate = 0;  // share that leaves twice
  std::uint64_t seed = 1;
  std::optional<std::int64_t> flip_tick;  // the first record of this tick has one bit flipped:
  int flip_bit = 0;  // of encoder, adc0, adc1 (from bit 0 to 63), or of dac (0 to 15)
};

// "drop=0.05,double=0.05,seed=1,flip=TICK,bit=0", any of them. Throws std::invalid_argument naming
// the part and what was expected.
Injection injection_of(const std::string &text);

struct InjectionCounts {
  std::uint64_t dropped = 0;
  std::uint64_t doubled = 0;
  std::uint64_t flipped = 0;
};

// A transport with these faults in what it sends. `counts` must outlive it.
template <class Out, class In>
std::unique_ptr<Transport<Out, In>> injecting(std::unique_ptr<Transport<Out, In>> transport,
                                              const Injection &injection, InjectionCounts &counts);

extern template std::unique_ptr<PlantTransport> injecting(std::unique_ptr<PlantTransport>,
                                                          const Injection &, InjectionCounts &);
extern template std::unique_ptr<AxisTransport> injecting(std::unique_ptr<AxisTransport>,
                                                         const Injection &, InjectionCounts &);

}  // namespace forceaxis::host
