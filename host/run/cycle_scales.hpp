#pragma once
// The units and the limits of the axis for which the program of a press cycle is compiled.
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "host/run/object_values.hpp"
#include "sim/hybrid/mode.hpp"
#include "sim/model/field.hpp"
#include "sim/model/model.hpp"
#include "sim/model/section.hpp"

namespace forceaxis::host {

/// A table of a file, for messages about its keys after the file was read.
struct CyclePlace {
  const sim::Source &source;
  std::string path = {};  ///< path of the table in the file, such as "phase[0].end[1]."

  CyclePlace at(std::string_view list, std::size_t index) const {
    return {source, path + std::string(list) + "[" + std::to_string(index) + "]."};
  }
  [[noreturn]] void fail(std::string_view key, const std::string &message) const {
    source.fail(path + std::string(key), message);
  }
  /// Throws InputError with a message about the table itself.
  [[noreturn]] void fail(const std::string &message) const {
    source.fail(path.substr(0, path.size() - 1), message);
  }
};

struct CycleScales {
  double counts_per_m = 0;
  double q8_per_N = 0;  ///< number of 1/256 counts of measured force in 1 N
  /// Number of samples per second: the ticks of an axis, or the samples of a recorded curve.
  double ticks_per_s = sim::kTickRateHz;
  double rated_N = 0;
  double limit_N = 0;  ///< value of the object force_limit in N

  /// Value of the object tare_band in 1/256 count; 0: the axis has no tare.
  double tare_band_q8 = 0;
  double position_least = 0, position_most = 0;  ///< soft limits in counts from the reference
  double span = 0;  ///< largest travel between two soft limits, in counts

  /// Ends of the range of the force sensor in compression and in tension, in 1/256 count; infinite
  /// where the force 0 is at an end of the range of codes (firmware/cycle/sample.h).
  double most_q8 = 0, least_q8 = 0;

  /// Value of the object contact_force in 1/256 count, above which the axis is in contact; nothing
  /// if it is not known.
  std::optional<std::int32_t> contact_q8;
  /// Range of the offset that a tare may measure, in 1/256 count; a tare fails if it is empty.
  std::int32_t tare_least = 0, tare_most = -1;

  double force_max_q8() const;
  double per_mille_per_N() const { return 1000 / rated_N; }
  /// Returns the smallest number of ticks that last at least `time_s`. A time that is a whole
  /// number of ticks may have a rounding error.
  double ticks_of(double time_s) const;
  /// Returns the number of firmware units in the SI unit of a quantity.
  double per(sim::Dimension dimension) const;
};

/// Returns the scales of a model. `initial` has the writes before tick 0. Throws InputError if the
/// axis cannot run a press cycle.
CycleScales cycle_scales(const sim::Source &source, const sim::Model &model,
                         const std::vector<ObjectWrite> &initial);

}  // namespace forceaxis::host
