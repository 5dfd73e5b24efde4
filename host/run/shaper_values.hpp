#pragma once
// Converts a shaper in an experiment's [firmware] table to writes of raw values:
//
//   [firmware.shaper_force]     # or shaper_motion
//   mode_Hz = 12.3              # frequency of the mode, undamped
//   damping = 0.05              # its damping ratio; absent: 0
//   kind = "zvd"                # or "zv": two impulses, half as late, for a mode that is well
//   known
//
// Impulses are half a period of the damped mode apart, rounded to ticks; each is smaller than the
// one before by what the mode decays by meanwhile (Singer and Seering).
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "host/run/object_values.hpp"
#include "sim/model/section.hpp"

namespace forceaxis::host {

// The first object (AXIS_OBJ_) of the shaper of a key; nothing for any other key.
std::optional<std::uint16_t> shaper_of_key(std::string_view key);

// All values of that shaper. Throws sim::InputError.
std::vector<ObjectWrite> read_shaper(sim::Section &section, std::uint16_t first);

}  // namespace forceaxis::host
