#pragma once
// Computes the digital inputs of limit switches, home switch and index pulse from the position of
// the axis.
#include <cmath>
#include <cstdint>
#include <optional>

#include "sim/model/elements/encoder.hpp"

namespace forceaxis::sim {

/// Bits of SensorCodes::switches.
enum SwitchBit : std::uint8_t {
  kLimitPos = 2,
  kLimitNeg = 4,
  kIndex = 8,  ///< The body has passed the index pulse since the last call of read().
  kHome = 16
};

class SwitchBank {
 public:
  SwitchBank() = default;
  explicit SwitchBank(const Switches &places)
      : places_(places),
        fitted_(places.limit_neg || places.limit_pos || places.home_from || places.home_to ||
                places.index) {}

  bool fitted() const { return fitted_; }

  /// Returns the states of the switches, as bits SwitchBit, at a position in m. Must be called once
  /// in each tick.
  std::uint8_t read(double place) {
    unsigned bits = 0;
    if (places_.limit_pos && place >= *places_.limit_pos) bits |= kLimitPos;
    if (places_.limit_neg && place <= *places_.limit_neg) bits |= kLimitNeg;
    const bool has_home = places_.home_from || places_.home_to;
    if (has_home && !(places_.home_from && place < *places_.home_from) &&
        !(places_.home_to && place >= *places_.home_to))
      bits |= kHome;
    if (places_.index) {
      const double past = place - *places_.index;
      const double cell =
          places_.index_every ? std::floor(past / *places_.index_every) : (past >= 0.0 ? 1.0 : 0.0);
      if (cell_ && *cell_ != cell) bits |= kIndex;
      cell_ = cell;
    }
    return static_cast<std::uint8_t>(bits);
  }

 private:
  Switches places_;
  bool fitted_ = false;
  // Number of the interval between two index pulses in which the body was at the last call.
  std::optional<double> cell_;
};

}  // namespace forceaxis::sim
