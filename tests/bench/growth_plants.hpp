#pragma once
// The plants of `forceaxis bench --growth`, written out by hand for odeint: host/python/forceaxis/
// bench/growth.py writes the same plants as models. Both have the motor of cases A and B.
#include <numbers>

#include "tests/bench/plants.hpp"

namespace forceaxis::bench {

// Cases A and B without workpiece: the motor drives body 1 of `Bodies` bodies between springs, the
// last one presses on a wall. x = i, vf, positions, velocities.
template <std::size_t Bodies>
class Chain {
 public:
  using State = std::array<double, 2 + 2 * Bodies>;

  static constexpr State start() { return {}; }
  void set_command(double value) { motor.command = value; }

  void operator()(const State &x, State &dx, double /*t*/) const {
    const double *p = &x[2];
    const double *v = &x[2 + Bodies];
    double *dp = &dx[2];
    double *dv = &dx[2 + Bodies];
    dx[0] = motor.current_rate(x[0], x[1], v[0]);
    dx[1] = motor.filter_rate(x[1], v[0]);
    double from_left = motor.k_force * x[0] - 500 * v[0];
    for (std::size_t i = 0; i + 1 < Bodies; ++i) {
      const double link = kStiffness * (p[i] - p[i + 1]) + kDamping * (v[i] - v[i + 1]);
      dp[i] = v[i];
      dv[i] = (from_left - link) * (1 / kMass);
      from_left = link;
    }
    dp[Bodies - 1] = v[Bodies - 1];
    dv[Bodies - 1] = (from_left - force(x)) * (1 / kMass);
  }
  bool enter(const State &x) {
    const auto drive = motor.at(x[0], x[1]);
    const int contact = wall.at(x[1 + Bodies] + kPressed, x[1 + 2 * Bodies]);
    const bool changed = drive != motor.regions || contact != wall.region;
    motor.enter(drive);
    wall.region = contact;
    return changed;
  }
  double margin(const State &x) const {
    return std::min(motor.margin(x[0], x[1]),
                    wall.margin(x[1 + Bodies] + kPressed, x[1 + 2 * Bodies]));
  }
  double force(const State &x) const {
    return wall.force(x[1 + Bodies] + kPressed, x[1 + 2 * Bodies]);
  }
  double reading(const State &x) const { return force(x); }
  double robot(const State &x) const { return x[2]; }
  double workpiece(const State &x) const { return x[1 + Bodies]; }

 private:
  static constexpr double kMass = 132.4 / Bodies, kStiffness = 1e6 * Bodies,
                          kDamping = 500.0 * Bodies, kPressed = 5e-4;

  Motor<double> motor = AxisContact<double>{}.motor;
  Touch<double> wall{110100, 16.5};
};

// The motor drives the robot, which touches nothing. An oscillator of 1 kg hits a stop in each
// period and rubs at each reversal, without another loss. x = i, vf, xr, vr, xo, vo.
class Rattle {
 public:
  using State = std::array<double, 6>;

  explicit Rattle(double frequency_Hz)
      : starts_m_(frequency_Hz > 0 ? -kAmplitude_m : 0),
        stiffness_(square(2 * std::numbers::pi * (frequency_Hz > 0 ? frequency_Hz : 1))) {
    stop_.stiffness = stiffness_;
    rub_N_ = 1e-5 * stiffness_ * kAmplitude_m;
  }
  State start() const { return {0, 0, 0, 0, starts_m_, 0}; }
  void set_command(double value) { motor_.command = value; }

  void operator()(const State &x, State &dx, double /*t*/) const {
    dx[0] = motor_.current_rate(x[0], x[1], x[3]);
    dx[1] = motor_.filter_rate(x[1], x[3]);
    dx[2] = x[3];
    dx[3] = (motor_.k_force * x[0] - 500 * x[3]) * (1 / 132.4);
    dx[4] = slides_ == 0 ? 0 : x[5];
    dx[5] = slides_ == 0 ? 0 : push(x) - slides_ * rub_N_;
  }
  bool enter(const State &x) {
    const auto drive = motor_.at(x[0], x[1]);
    const int contact = stop_.at(x[4] - kGap_m, x[5]);
    const bool hit = contact != stop_.region;
    stop_.region = contact;
    int slides = slides_;
    // A friction decides again where it sticks, and where its speed has come to 0.
    if (slides * x[5] <= 0) {
      const double f = push(x);
      slides = std::abs(f) <= rub_N_ ? 0 : f > 0 ? 1 : -1;
    }
    const bool changed = hit || slides != slides_ || drive != motor_.regions;
    slides_ = slides;
    motor_.enter(drive);
    return changed;
  }
  double margin(const State &x) const {
    const double rub = slides_ == 0 ? rub_N_ - std::abs(push(x)) : slides_ * x[5];
    return std::min({motor_.margin(x[0], x[1]), stop_.margin(x[4] - kGap_m, x[5]), rub});
  }
  double force(const State &x) const { return stop_.force(x[4] - kGap_m, x[5]); }
  // Scaled as the model's ADC: 100 counts for the force of the spring at the first amplitude.
  double reading(const State &x) const { return 2 * force(x) * 100 / (stiffness_ * kAmplitude_m); }
  double robot(const State &x) const { return x[2]; }
  double workpiece(const State &x) const { return x[4]; }

 private:
  static constexpr double kAmplitude_m = 1e-3, kGap_m = 5e-4;
  static double square(double value) { return value * value; }
  double push(const State &x) const { return -stiffness_ * x[4] - force(x); }

  double starts_m_, stiffness_, rub_N_ = 0;
  int slides_ = 0;
  Motor<double> motor_ = AxisContact<double>{}.motor;
  Touch<double> stop_{0, 0};
};

}  // namespace forceaxis::bench
