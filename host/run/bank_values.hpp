#pragma once
// Converts a bank of the force law in an experiment's [firmware] table to writes of raw values:
//
//   [firmware.bank_1]
//   gain = 4.37                 # DAC codes per count of an 8-bit reading
//   integral_rad_per_s = 8.0    # absent: no integral
//   velocity_gain = 0.0         # DAC codes per encoder count a tick
//   sections = [[b0, b1, b2, a1, a2]]   # up to three, a0 = 1
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "host/run/object_values.hpp"
#include "sim/model/section.hpp"

namespace forceaxis::host {

// The number (0..3) of a key bank_1 to bank_4; nothing for any other key.
std::optional<std::uint8_t> bank_of_key(std::string_view key);

// All values of that bank, the CRC of what was rounded included. Throws sim::InputError.
std::vector<ObjectWrite> read_bank(sim::Section &section, std::uint8_t bank);

}  // namespace forceaxis::host
