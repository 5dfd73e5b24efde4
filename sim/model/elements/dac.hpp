#pragma once
#include <optional>
#include <string>

#include "sim/model/elements/ends.hpp"

namespace forceaxis::sim {

struct Dac {
  static constexpr std::string_view kMeaning =
      "The DAC of the command. Its output voltage is code * 2 range / 2^bits + offset + "
      "noise.";
  /// Number of bits, 8 to 16; the codes of step() are -2^(bits-1) to 2^(bits-1)-1.
  int bits = 12;
  double range = 10.0;  ///< output voltage range in V, > 0; the lowest code gives -range
  double offset = 0.0;  ///< output voltage in V at code 0
  double noise = 0.0;   ///< rms noise of the output voltage in V, >= 0

  /// Returns the voltage of one code of this DAC.
  double volts_per_step() const { return 2.0 * range / static_cast<double>(1 << bits); }
  /// Returns the voltage of one DAC code of the firmware. The gains and limits of the firmware are
  /// in 1/2048 of the range for every number of bits.
  double volts_per_code() const { return range / 2048.0; }

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(&Dac::bits,
              integer("bits", 8, 16, 12.0,
                      "Resolution of the converter in bits. A run needs 12 to 16; it gives the "
                      "firmware `dac_bits` of this value. A drive on a bus may have 16.")),
        field(&Dac::range,
              number("range", D::voltage, positive, 10.0,
                     "Range of the output voltage: the voltage at the lowest code is -range.")),
        field(&Dac::offset, number("offset", D::voltage, any, 0.0, "Output voltage at code 0.")),
        field(&Dac::noise, number("noise", D::voltage, not_negative, 0.0,
                                  "Noise of the output voltage (rms).")));
  }
};

}  // namespace forceaxis::sim
