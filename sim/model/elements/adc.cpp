#include "sim/model/elements/adc.hpp"

#include "sim/model/read.hpp"

namespace forceaxis::sim {
namespace {

// Returns a time, or 0 for a time below 1 ns, because the simulation does not distinguish such a
// time from 0.
double time_or_0(double time_s) {
  constexpr double kShortest = 1e-9;
  return time_s < kShortest ? 0.0 : time_s;
}

std::optional<Sampling> sampling_of(Section &section, const Adc::Given &given) {
  Sampling sampling;
  sampling.rate_hz = given.sample_rate.value_or(sampling.rate_hz);
  sampling.phase_s = time_or_0(given.sample_phase.value_or(0.0));
  sampling.phase_known = given.sample_phase || !given.sample_rate;
  sampling.latency_s = time_or_0(given.latency);
  if (!(sampling.phase_s * sampling.rate_hz < 1.0))
    section.fail("sample_phase", "expected a time below one period of the samples, " +
                                     number_text(1.0 / sampling.rate_hz) + " s, got " +
                                     number_text(sampling.phase_s) +
                                     " s; give the time to the first sample");
  if (!given.sample_rate && sampling.phase_s == 0.0 && sampling.latency_s == 0.0)
    return std::nullopt;
  return sampling;
}

// Reduces a converter of more than 16 bits to the upper 16 bits of its code.
void keep_upper_bits(Adc &adc) {
  constexpr int kFirmwareBits = 16;
  if (adc.bits <= kFirmwareBits) return;
  const int codes = 1 << (adc.bits - kFirmwareBits);
  adc.rounding = (0.5 + adc.zero_code % codes) / codes;
  adc.zero_code /= codes;
  adc.per_count *= codes;
  adc.bits = kFirmwareBits;
}

}  // namespace

void Adc::complete(Section &section, Names &) {
  constexpr double kFastestFilter = 1e6;
  if (filter && *filter > kFastestFilter)
    section.fail("filter", "expected at most 1e6 rad/s, got " + number_text(*filter) +
                               "; omit a filter whose effect within a tick is negligible");
  const int top = (1 << bits) - 1;
  const double zero = given.zero_code;
  if (!(zero >= 0.0 && zero <= top && zero == static_cast<int>(zero)))
    section.fail("zero_code", "expected a whole number 0.." + std::to_string(top) + ", got " +
                                  number_text(zero) + "; choose a code of this ADC");
  zero_code = static_cast<int>(zero);
  keep_upper_bits(*this);
  sampling = sampling_of(section, given);
  constexpr int kOrders[] = {0, 3, 4, 5};
  sinc_order = kOrders[static_cast<int>(given.filter)];
  if (sinc_order > 0) expect_beside(section, "converter_filter", "sample_rate");
}

}  // namespace forceaxis::sim
