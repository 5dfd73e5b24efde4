#pragma once
// Converts a bank of the force law in an experiment's [firmware] table to writes of raw values:
//
//   [firmware.bank_1]
//   gain = 4.37                 # DAC codes per count of an 8-bit reading
//   integral_rad_per_s = 8.0    # absent: no integral
//   velocity_gain = 0.0         # DAC codes per encoder count a tick
//   sections = [[b0, b1, b2, a1, a2]]   # up to three, a0 = 1
//   certificate = false         # absent: with a certificate for this experiment's sensor
#include <array>
#include <cstdint>
#include <optional>
#include <string_view>
#include <tuple>
#include <vector>

#include "host/run/object_values.hpp"
#include "sim/hybrid/mode.hpp"
#include "sim/model/field.hpp"
#include "sim/model/section.hpp"

namespace forceaxis::host {

// Returns the bank number 0 to 3 for a key bank_1 to bank_4, or nothing for any other key.
std::optional<std::uint8_t> bank_of_key(std::string_view key);

// The coefficients b0, b1, b2, a1 and a2 of a second-order section, as raw values of the firmware.
using LawSection = std::array<std::int32_t, 5>;

// The sections of a bank, in the order in which the force law computes them.
struct LawSections {
  std::vector<LawSection> all;
};

struct Bank {
  static constexpr std::string_view kMeaning = "A bank of the force law.";
  double gain = 0.0;
  double integral_rad_per_s = 0.0;
  double velocity_gain = 0.0;
  bool certificate = true;
  LawSections sections;

  static constexpr auto rows() {
    using sim::field;
    using namespace sim::format;
    using D = sim::Dimension;
    return std::tuple{
        field(&Bank::gain, ranged("gain", D::ratio, 0.0, 65535.0 / 256.0, "",
                                  "DAC codes per count of the measured force at 8 bits.")),
        field(&Bank::integral_rad_per_s,
              ranged("integral_rad_per_s", D::ratio, 0.0, sim::kTickRateHz, 0.0,
                     "Rate of the integral action, in rad/s.")),
        field(&Bank::velocity_gain, ranged("velocity_gain", D::ratio, 0.0, 65535.0 / 256.0, 0.0,
                                           "DAC codes per encoder count per tick.")),
        field(&Bank::certificate,
              other("certificate", "flag", "true",
                    "Whether the bank has a certificate for the sensor of this experiment.")),
        field(&Bank::sections,
              other("sections", "list of [b0, b1, b2, a1, a2]", "none",
                    "Up to three second-order sections with a0 = 1, coefficients from -16 to "
                    "16."))};
  }
};

struct BankValues {
  std::uint8_t bank;  // number of the bank, 0..3
  bool certified;
  std::uint32_t crc;
  std::vector<ObjectWrite> writes;
};

// Returns the writes of all values of the bank, including the CRC of the rounded values, but
// without the certificate. Throws sim::InputError.
BankValues read_bank(sim::Section &section, std::uint8_t bank);

// Returns the writes of the bank's certificate. `adc_bits` is the number of bits of the force ADC
// of the firmware. `force_scale` is the value of the object force_scale in uN.
std::vector<ObjectWrite> certificate_of_bank(const BankValues &bank, std::int32_t adc_bits,
                                             std::int32_t force_scale);

}  // namespace forceaxis::host
