#pragma once
// Converts a shaper in an experiment's [firmware] table to writes of raw values:
//
//   [firmware.shaper_force]     # or shaper_motion
//   mode_Hz = 12.3              # frequency of the mode, undamped
//   damping = 0.05              # damping ratio of the mode; absent: 0
//   kind = "zvd"                # or "zv": two impulses, half the delay, for a mode that is
//                               # known exactly
//
// The time between two impulses is half a period of the damped mode, rounded to ticks. Each impulse
// is the previous impulse multiplied by the decay of the mode in this time (Singer and Seering).
#include <cstdint>
#include <optional>
#include <string_view>
#include <tuple>
#include <vector>

#include "host/run/object_values.hpp"
#include "sim/model/field.hpp"
#include "sim/model/section.hpp"

namespace forceaxis::host {

enum class ShaperKind { zv, zvd };

struct Shaper {
  static constexpr std::string_view kMeaning =
      "An input shaper, which prevents the excitation of one mode of vibration.";
  double mode_Hz = 0.0;
  double damping = 0.0;
  ShaperKind kind = ShaperKind::zvd;

  static constexpr auto rows() {
    using sim::field;
    using namespace sim::format;
    using D = sim::Dimension;
    using S = sim::Sign;
    return std::tuple{
        field(&Shaper::mode_Hz, needed("mode_Hz", D::frequency, S::positive,
                                       "Undamped frequency of the mode of vibration. Half of its "
                                       "damped period must be 1 to "
                                       "255 ticks for zv, 1 to 127 ticks for zvd.")),
        field(&Shaper::damping, ranged("damping", D::ratio, 0.0, 0.9, 0.0,
                                       "Damping ratio of the mode of vibration.")),
        field(&Shaper::kind,
              choice("kind", "zv, zvd", "zvd", "write kind = \"zvd\"",
                     "zv: two impulses. zvd: three impulses and twice the delay, for a mode whose "
                     "frequency is known less exactly."))};
  }
};

// Returns the first object (AXIS_OBJ_) of the shaper with this key. Returns nothing if the key is
// not that of a shaper.
std::optional<std::uint16_t> shaper_of_key(std::string_view key);

// Returns the writes of all values of the shaper. Throws sim::InputError.
std::vector<ObjectWrite> read_shaper(sim::Section &section, std::uint16_t first);

}  // namespace forceaxis::host
