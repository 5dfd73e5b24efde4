#pragma once
// The plant of a force loop as the firmware sees it: from the DAC code of a tick to the measured
// force before the conversion, sampled with a zero-order hold.
#include <complex>
#include <optional>
#include <span>
#include <vector>

#include "sim/linear/code_period.hpp"
#include "sim/linear/hold.hpp"
#include "sim/linear/linear.hpp"
#include "sim/matrix/extended.hpp"
#include "sim/model/elements/bus_cycle.hpp"
#include "sim/model/elements/sampling.hpp"
#include "sim/model/model.hpp"

namespace forceaxis::sim {

/// Returns w = tan(pi f tick_s) for a frequency f in Hz from minus half to plus half the tick rate.
/// At these two ends, w is -1e9 and 1e9. The function uses long double, because the functions for
/// double of the C library depend on the processor.
double tangent_of(double frequency_hz, double tick_s);

/// A command that is held over a bus cycle of m ticks has, in addition to its frequency f, the
/// frequencies f + k / (m tick_s), k = 1 .. m - 1. Returns frequency k in Hz, shifted to the range
/// from minus half to plus half the tick rate; k = 0 is f itself.
double alias_of(double frequency_hz, int k, double tick_s, int cycle_ticks);

class ForcePlant {
 public:
  /// Returns the plant of a model in one mode. Returns nothing if the command does not act on the
  /// measured force in this mode. `tick_s` is the sampling period in s. Throws InputError if the
  /// model has no drive or no ADC on channel 0.
  static std::optional<ForcePlant> of(const Model &model, const LinearMode &mode, double tick_s);

  /// Returns the poles in 1/s, as log(z) / tick_s. A pole at z = 0 is -infinity.
  const std::vector<std::complex<double>> &poles() const { return poles_; }
  /// Returns the zeros in 1/s, in the form of poles().
  const std::vector<std::complex<double>> &zeros() const { return zeros_; }
  /// Computes the response in 8-bit counts per DAC code without a delay, at the frequencies f with
  /// w = tan(pi f tick_s). `values` has one element for each frequency.
  void response(std::span<const double> w, std::span<std::complex<double>> values) const;
  double tick_s() const { return tick_s_; }
  /// Returns the bus between the firmware and the drive. response() is without the bus.
  const BusCycle &bus() const { return bus_; }
  /// Returns true if held_response() is exact. This is so if the firmware sends one code in each
  /// period after which the pattern of the samples repeats.
  bool exact() const { return period_ || hold_.readings == 0; }
  /// Returns the same plant for other phases of a sensor whose phase is not known. Without
  /// `all_phases`, the list has the plant with the newest readings that the sensor can give. With
  /// `all_phases`, it has one plant for each phase for which forceaxis.linear analyses the loop.
  /// The list is empty for any other sensor.
  std::vector<ForcePlant> with_other_phases(bool all_phases) const;
  /// Computes the response in 8-bit counts per DAC code with the bus and the sensor's samples, at
  /// the frequencies f with w = tan(pi f tick_s) and at f + k / (m tick_s) for a cycle of m ticks.
  /// `w` and `values` have all frequencies for k = 0 first, then those for k = 1. The loop is the
  /// sum over k of the law times this response. The sum is exact if exact() is true. Otherwise
  /// hold() approximates the effect of the samples.
  void held_response(std::span<const double> w, std::span<std::complex<double>> values) const;
  /// Returns the factor between response() and held_response(). Returns nullptr if held_response()
  /// is not such a product, or if the factor is 1.
  const Hold *hold() const { return period_ || immediate() ? nullptr : &hold_; }
  /// Returns the factor that converts a response in the unit of the force per volt to 8-bit counts
  /// per DAC code.
  double count_per_code() const { return count_per_code_; }

 private:
  void set_ages(const Sampling &sampling);
  Extended phase_of(Extended arrives) const;
  /// Returns true if bus and samples have no effect on the response.
  bool immediate() const { return bus_.immediate() && hold_.readings == 0; }

  double tick_s_ = 0.0;
  BusCycle bus_;
  Hold hold_;
  // Number of ticks by which the readings are newer with the best phase of the samples; 0 if the
  // phase is known.
  Extended newer_by_ = 0;
  // Exact response with a sensor whose pattern of samples repeats with the codes.
  std::optional<CodePeriod> period_;
  TickSystem continuous_;
  CodeTiming timing_;
  Hessenberg balanced_;
  double count_per_code_ = 0.0;
  std::vector<std::complex<double>> poles_, zeros_;
};

}  // namespace forceaxis::sim
