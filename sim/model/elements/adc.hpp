#pragma once
#include <optional>
#include <string>

#include "sim/model/elements/ends.hpp"
#include "sim/model/elements/sampling.hpp"

namespace forceaxis::sim {

/// Creep of a sensor: the signal y becomes y + share z, with z' = (y - z) / time and z = 0 at tick
/// 0. Under a constant load, the reading grows by the fraction `share` of the load.
struct Creep {
  double share = 0.0;
  double time = 0.0;  ///< time constant in s, > 0

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(
            &Creep::share,
            ranged("creep", D::ratio, -0.1, 0.1, "no creep",
                   "Share of the load by which the reading grows under a constant load, as OIML R "
                   "60 and data sheets of load cells give it: 0.0005 is 0.05 %. The reading of a "
                   "signal y is y + creep * z, z' = (y - z) / creep_time, with z = 0 at tick 0.")),
        field(&Creep::time,
              needed_beside("creep",
                            ranged("creep_time", D::time, 0.01, 1e6, "creep must be omitted too",
                                   "Time constant of the creep, from 0.01 s to 1e6 s."))));
  }
};

/// Warm-up of a sensor. At the time t after tick 0, the zero of the sensor has moved by final (1 -
/// e^(-t / time)).
struct Drift {
  double final = 0.0;  ///< final shift of the sensor's zero, in the unit of the signal
  double time = 0.0;   ///< time constant in s, > 0

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(&Drift::final,
              of_signal(
                  "drift", any, "no drift",
                  "Final error of the zero while the sensor warms up, in the unit of the signal. "
                  "At the time t after tick 0 the error is drift * (1 - exp(-t / drift_time)).")),
        field(&Drift::time,
              needed_beside("drift",
                            ranged("drift_time", D::time, 0.01, 1e6, "drift must be omitted too",
                                   "Time constant of the drift, from 0.01 s to 1e6 s."))));
  }
};

/// Path of a signal to its ADC code. The creep and the drift of the sensor are added to the signal.
/// The sum is limited to +-sensor_limit, filtered by a first-order low-pass filter, and limited to
/// +-conditioning_limit. It is then filtered by the converter and converted with noise. Limits and
/// noise have the unit of the signal. The firmware has codes of at most 16 bits: a converter with
/// more bits gives the firmware the upper 16 bits of each code. So per_count, zero_code and bits
/// describe the code that the firmware has.
struct Adc {
  static constexpr std::string_view kMeaning =
      "An ADC of the firmware. Creep and drift are added to the signal, which then passes the "
      "sensor limit, the low pass, the limit of the electronics, the filter of the converter and "
      "the noise before its conversion to a code. With a sample rate or a latency the firmware has "
      "the newest sample that has arrived, and its age in ticks.";
  int channel = 0;  ///< number of the ADC, 0 or 1
  std::string signal;
  std::optional<Creep> creep;
  std::optional<Drift> drift;
  /// Magnitude of the signal at which the sensor saturates, > 0.
  std::optional<double> sensor_limit;
  /// Corner frequency of the low-pass filter in rad/s, > 0 and at most 1e6. The filter computes y'
  /// = filter (x - y) and starts with y = 0.
  std::optional<double> filter;
  /// Magnitude of the signal at which the analog electronics saturate, > 0.
  std::optional<double> conditioning_limit;
  /// Rms noise in the unit of the signal, >= 0.
  double noise = 0.0;
  /// Change of the signal for one code step, in the unit of the signal, not 0.
  double per_count = 0.0;
  int zero_code = 0;  ///< ADC code at the signal 0, from 0 to 2^bits - 1
  int bits = 8;       ///< number of bits of the code, 8..16

  /// Fraction of a code step that is added before the code is rounded down. The fraction is 1/2, or
  /// less if the code is the upper 16 bits of a longer code.
  double rounding = 0.5;
  std::optional<Sampling> sampling;  ///< sampling of the ADC; empty: the ADC samples at each tick,
                                     ///< without delay

  /// Order of the filter of a sigma-delta converter, 3 to 5, or 0 for none (sinc_filter.hpp). A
  /// converter with a filter also has `sampling`.
  int sinc_order = 0;
  /// Values of the model file for a converter whose code may have up to 24 bits.
  struct Given {
    double zero_code = 0.0;
    std::optional<double> sample_rate, sample_phase;
    enum class Filter { none, sinc3, sinc4, sinc5 } filter = Filter::none;
    double latency = 0.0;
  };
  Given given;

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(&Adc::channel, integer("channel", 0, 1, std::nullopt,
                                     "Number of the converter; channel 0 measures the force that "
                                     "the firmware controls.")),
        field(&Adc::signal,
              other("signal", "signal", "",
                    "The signal of the model that the converter measures; see the signals below.")),
        part(&Adc::creep), part(&Adc::drift),
        field(
            &Adc::sensor_limit,
            of_signal("sensor_limit", positive, "not limited",
                      "Magnitude at which the sensor saturates, > 0, in the unit of the signal.")),
        field(
            &Adc::filter,
            optional(
                "filter", D::rate, positive, "no filter",
                "Corner frequency of a first-order low pass after the sensor, at most 1e6 rad/s.")),
        field(&Adc::conditioning_limit, of_signal("conditioning_limit", positive, "not limited",
                                                  "Magnitude at which the analog electronics "
                                                  "saturate, > 0, in the unit of the signal.")),
        field(&Adc::noise, of_signal("noise", not_negative, "0",
                                     "Measurement noise (rms), in the unit of the signal.")),
        field(&Adc::per_count, of_signal("per_count", not_zero, "",
                                         "Change of the signal for one ADC code, not 0, in the "
                                         "unit of the signal per count.",
                                         KeyFormat::Unit::of_signal_per_count)),
        field(&Adc::given, &Given::zero_code,
              number("zero_code", D::count, any, 0.0,
                     "ADC code at signal 0: an integer from 0 to 2^bits - 1. With 2^(bits-1) the "
                     "converter measures both directions.")),
        field(&Adc::bits, integer("bits", 8, 24, 8.0,
                                  "Resolution of the converter in bits. The firmware has the upper "
                                  "16 bits of a longer code, so its `adc_bits` is then 16.")),
        field(&Adc::given, &Given::sample_rate,
              ranged("sample_rate", D::frequency, 1.0, 30e3, "a sample at each tick of 1/1500 s",
                     "Rate of the samples, from 1 Hz to 30 kHz.")),
        field(&Adc::given, &Given::filter,
              choice("converter_filter", "none, sinc3, sinc4, sinc5", "none",
                     "take the filter from the data sheet of the converter",
                     "Filter of a sigma-delta converter, beside sample_rate: a sample is the mean "
                     "of the signal over the last 3, 4 or 5 periods T of the samples, weighted so "
                     "that a frequency f keeps |sin(pi f T) / (pi f T)| to the power of 3, 4 or 5. "
                     "The delay is 1.5, 2 or 2.5 periods, beside `latency`. The limits of sensor "
                     "and electronics act before the filter, noise and conversion after it. Before "
                     "tick 0 the signal has its value of tick 0.")),
        field(&Adc::given, &Given::sample_phase,
              ranged("sample_phase", D::time, 0.0, 1.0, "not known",
                     "Time from tick 0 to the first sample, at least 0 and below 1 / sample_rate. "
                     "Without this key a run takes 0, and limits and margins are the worst of all "
                     "phases. A time below 1 ns counts as 0.")),
        field(&Adc::given, &Given::latency,
              ranged("latency", D::time, 0.0, 0.1, 0.0,
                     "Time from a sample to the tick from which on the firmware has it, at most "
                     "0.1 s. A time below 1 ns counts as 0. Until the first sample arrives, the "
                     "firmware has the signal of tick 0.")));
  }
  /// Derives the sampling, and zero, step and bits of the code that the firmware has.
  void complete(Section &section, Names &names);
};

}  // namespace forceaxis::sim
