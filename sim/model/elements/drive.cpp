#include "sim/model/elements/drive.hpp"

#include "sim/model/read.hpp"

namespace forceaxis::sim {

void DcMotor::complete(Section &section, Names &) {
  if (amp_break)
    // With the key amp_break, the key k_amp_outer is required.
    k_amp_outer = section.number("k_amp_outer");
  else if (section.has("k_amp_outer"))
    section.fail("amp_break",
                 "expected a finite number > 0 in V beside k_amp_outer, got nothing; "
                 "add this key or remove k_amp_outer");
  else
    k_amp_outer = k_amp;
}

void DriveMotor::complete(Section &section, bool turns) {
  one_of(section, "k_force", "k_torque", "the force or torque constant of the motor");
  if (k_torque)
    force_per_amp = *k_torque / section.value("r_trans", Dimension::transmission, Sign::positive);
  else if (r_trans && !turns)
    section.fail("r_trans", "expected no r_trans beside k_force, got one; remove one key");
  if (rated_current && !(*rated_current < *peak_current))
    section.fail("rated_current", "expected a current below peak_current, " +
                                      number_text(*peak_current) + " A, got " +
                                      number_text(*rated_current) +
                                      "; exchange or correct the two currents");
}

void VelocityDrive::complete(Section &section, Names &) {
  motor.complete(section, tuning.inertia.has_value());
  one_of(section, "k_velocity", "bandwidth", "the gain or the bandwidth of the velocity loop");
  expect_beside(section, "integral_time", "k_velocity");
  for (const char *key : {"damping_ratio", "tuned_mass", "tuned_inertia"})
    expect_beside(section, key, "bandwidth");
  if (!tuning.bandwidth) return;
  one_of(section, "tuned_mass", "tuned_inertia", "the mass or inertia of the tuning");
  if (tuning.inertia) {
    const double r = section.value("r_trans", Dimension::transmission, Sign::positive);
    tuning.mass = *tuning.inertia / (r * r);
  }
  const auto gains =
      velocity_gains(*tuning.mass, *tuning.bandwidth, tuning.damping_ratio, motor.rate);
  if (!gains)
    section.fail("bandwidth", "expected a bandwidth that a current loop of " +
                                  number_text(motor.rate) + " rad/s permits, got " +
                                  number_text(*tuning.bandwidth) +
                                  " rad/s; lower it, lower damping_ratio or raise "
                                  "current_bandwidth");
  k_velocity = gains->k_velocity;
  integral_time = gains->integral_time;
}

void StepperDrive::complete(Section &section, Names &) {
  if (segments % 4 != 0)
    section.fail("segments",
                 "expected a multiple of 4, so that a point has the holding force, got " +
                     std::to_string(segments) + "; give 16");
}

void Drive::complete(Section &section, Names &names) {
  if (body == reaction)
    section.fail("reaction", "expected another body than drive.body or ground, got " +
                                 in_quotes(names.points[static_cast<std::size_t>(body)]) +
                                 "; choose the body on which the reaction force acts");
  if (bus.ticks != 1 && bus.ticks % 3 != 0)
    section.fail("cycle_ticks", "expected 1, or a multiple of 3 ticks, which are 2 ms, got " +
                                    std::to_string(bus.ticks) +
                                    "; set the bus to a cycle of 2 ms, 4 ms or longer");
}

// The poles of the closed velocity loop are the roots of (s^2 + 2 zeta w s + w^2) (s + p), whose
// sum is the current bandwidth. The bandwidth of the closed loop rises with w from 0 to its limit
// at p = 0.
std::optional<VelocityGains> velocity_gains(double mass_kg, double bandwidth, double damping_ratio,
                                            double current_bandwidth) {
  const auto gains = [&](double w) {
    const double p = current_bandwidth - 2.0 * damping_ratio * w;
    const double middle = w * w + 2.0 * damping_ratio * w * p;
    return VelocityGains{mass_kg * middle / current_bandwidth, middle / (w * w * p)};
  };
  const auto follows = [&](double w) {
    const VelocityGains at = gains(w);
    const double p = current_bandwidth - 2.0 * damping_ratio * w;
    const double top = at.k_velocity * current_bandwidth / mass_kg;
    // The squares of the magnitudes are compared, because the last digits of std::hypot differ
    // between versions of libm.
    const auto squared = [](double re, double im) { return re * re + im * im; };
    const double up = squared(top * bandwidth, top / at.integral_time);
    const double down =
        squared(w * w - bandwidth * bandwidth, 2.0 * damping_ratio * w * bandwidth) *
        squared(bandwidth, p);
    return 2.0 * up >= down;
  };
  double low = 0.0;
  double high = current_bandwidth / (2.0 * damping_ratio);
  constexpr double kMost = 1.0 - 1e-9;  // factor 1: the velocity loop has no integral action
  if (!follows(high * kMost)) return std::nullopt;
  high *= kMost;
  for (int k = 0; k < 200 && low < high; ++k) {
    const double middle = 0.5 * (low + high);
    (follows(middle) ? high : low) = middle;
  }
  return gains(high);
}

}  // namespace forceaxis::sim
