#pragma once
// Evaluates the curve of a pressed part that any press has recorded, with the code of the firmware
// (firmware/cycle/cycle.h). One sample of the curve is one tick of the firmware, so the scales of
// the program have the rate of the samples.
#include <cstdint>
#include <span>
#include <vector>

#include "host/run/cycle_file.hpp"
#include "host/run/cycle_result.hpp"
#include "host/run/cycle_scales.hpp"

namespace forceaxis::host {

/// A sample of a recorded curve, in counts of the scales of the program.
struct CurveSample {
  std::int32_t position = 0;
  std::int32_t force_q8 = 0;
  bool is_valid = false;
  /// Number of the phase to which the sample belongs; not used if the conditions of the program
  /// decide about the phases.
  std::uint8_t phase = 0;
};

struct JudgedCurve {
  CycleResult result;
  /// Number of the phase to which the firmware has assigned each sample; CYCLE_END after the end of
  /// the cycle.
  std::vector<std::uint8_t> phases;
  /// Index of the sample at which travel 0 was found; the number of samples if it was not found.
  std::size_t zeroed_at = 0;
};

/// A program with the scales of curves. Both functions throw sim::InputError if the firmware does
/// not accept the program with these scales.
class CurveJudge {
 public:
  CurveJudge(const std::filesystem::path &file, const CycleScales &scales);

  const CycleProgram &program() const { return program_; }
  const CycleScales &scales() const { return scales_; }

  /// Evaluates a curve whose samples name their phases. Limits and conditions of phases have no
  /// effect. `start` is the sample before the first one. Each tare takes its mean within its phase.
  JudgedCurve judge_labelled(const CurveSample &start, std::span<const CurveSample> samples) const;

  /// Evaluates a curve whose phases follow from the conditions and limits of the program. The
  /// conditions `reached` and those on inputs are not met. `open`: set of phases, as bits. If the
  /// curve ends in one of them, the cycle was stopped.
  JudgedCurve judge_followed(const CurveSample &start, std::span<const CurveSample> samples,
                             std::uint32_t open) const;

 private:
  CycleScales scales_;
  CycleProgram program_;
};

}  // namespace forceaxis::host
