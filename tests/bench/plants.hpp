#pragma once
// The benchmark plants written out by hand for the peers: "axis-contact" (cases A and B, 6 states)
// and the full axis of sim/models/full_axis.toml (14 states). Regions of every nonlinearity are
// frozen between crossings. Shares no code with sim/ or firmware/.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace forceaxis::bench {

inline constexpr int kTicks = 3000;
inline constexpr double kRate = 1500;

// The force law of the scenario in integers: 2 N per count, `gain` DAC codes per ADC count.
template <class Real>
int convert(Real force) {
  const Real n = std::floor(force / 2 + Real(0.5));
  return static_cast<int>(n < -128 ? Real(-128) : n > 127 ? Real(127) : n);
}
inline int law(int n, int gain, int setpoint_N) {
  const int code = (gain * (setpoint_N - 2 * n) + 1) >> 1;
  return std::clamp(code, -2048, 2047);
}
template <class Real>
Real volts(int code) {
  return code * (Real(20) / 4096);
}

// One ohmic line segment per region: value = slope * input + offset.
template <class Real>
struct Segment {
  Real slope, offset;
};

// Preamplifier, current loop and amplifier of the DC motor. Regions: -1, 0, 1 of the two clamps,
// -2..2 of the amplifier.
template <class Real>
struct Motor {
  Real k_command, k_feedback, a_feedback;  // V/V, V s/m, rad/s
  Real k_current, preamp_limit, feedback_limit;
  Real slope, outer_slope, amp_break, supply;
  Real resistance, inductance, k_force, k_emf;  // k_force N/A, k_emf V s/m

  struct Regions {
    int preamp = 0, feedback = 0, amplifier = 0;
    bool operator==(const Regions &) const = default;
  };

  Real command = 0;  // V, held
  Regions regions{};
  Segment<Real> preamp_line{1, 0}, feedback_line{}, amplifier_line{};

  static int side(Real value, Real limit) { return value > limit ? 1 : value < -limit ? -1 : 0; }
  // |error| at which the amplifier saturates.
  Real saturation() const { return amp_break + (supply - slope * amp_break) / outer_slope; }

  Regions at(Real current, Real filtered) const {
    Regions r;
    const Real wanted = k_command * command - filtered;
    const Real measured = k_current * current;
    r.preamp = side(wanted, preamp_limit);
    r.feedback = side(measured, feedback_limit);
    const Real error = std::clamp(wanted, -preamp_limit, preamp_limit) -
                       std::clamp(measured, -feedback_limit, feedback_limit);
    r.amplifier = side(error, amp_break) + side(error, saturation());
    return r;
  }
  void enter(const Regions &r) {
    regions = r;
    preamp_line = r.preamp == 0 ? Segment<Real>{1, 0} : Segment<Real>{0, r.preamp * preamp_limit};
    feedback_line = r.feedback == 0 ? Segment<Real>{k_current, 0}
                                    : Segment<Real>{0, r.feedback * feedback_limit};
    const int sign = r.amplifier > 0 ? 1 : -1;
    amplifier_line = r.amplifier == 0 ? Segment<Real>{slope, 0}
                     : r.amplifier == sign
                         ? Segment<Real>{outer_slope, sign * (slope - outer_slope) * amp_break}
                         : Segment<Real>{0, sign * supply};
  }
  Real error(Real current, Real filtered) const {
    return preamp_line.slope * (k_command * command - filtered) + preamp_line.offset -
           feedback_line.slope * current - feedback_line.offset;
  }
  // How far the nearest region limit is, V; negative once beyond it.
  Real margin(Real current, Real filtered) const {
    const Real wanted = k_command * command - filtered;
    const Real measured = k_current * current;
    const Real e = error(current, filtered);
    const auto room = [](int region, Real value, Real limit) {
      return region == 0 ? limit - std::abs(value) : region * value - limit;
    };
    Real least = std::min(room(regions.preamp, wanted, preamp_limit),
                          room(regions.feedback, measured, feedback_limit));
    switch (regions.amplifier) {
      case 0:
        return std::min(least, amp_break - std::abs(e));
      case 1:
      case -1: {
        const Real size = regions.amplifier * e;
        return std::min(least, std::min(size - amp_break, saturation() - size));
      }
      default:
        return std::min(least, std::abs(e) - saturation());
    }
  }
  Real current_rate(Real current, Real filtered, Real speed) const {
    const Real voltage = amplifier_line.slope * error(current, filtered) + amplifier_line.offset;
    return (voltage - resistance * current - k_emf * speed) * (1 / inductance);
  }
  // The same without frozen regions, for a solver that knows none.
  Real free_current_rate(Real held, Real current, Real filtered, Real speed) const {
    const Real e = std::clamp(k_command * held - filtered, -preamp_limit, preamp_limit) -
                   std::clamp(k_current * current, -feedback_limit, feedback_limit);
    const Real voltage =
        std::clamp(outer_slope * e + (slope - outer_slope) * std::clamp(e, -amp_break, amp_break),
                   -supply, supply);
    return (voltage - resistance * current - k_emf * speed) * (1 / inductance);
  }
  Real filter_rate(Real filtered, Real speed) const {
    return a_feedback * (k_feedback * speed - filtered);
  }
};

// Contact that only pushes: apart, pressed, overlapping without force.
template <class Real>
struct Touch {
  Real stiffness, damping;
  int region = 0;

  Real pushing(Real overlap, Real speed) const { return stiffness * overlap + damping * speed; }
  Real force(Real overlap, Real speed) const { return region == 1 ? pushing(overlap, speed) : 0; }
  Real free_force(Real overlap, Real speed) const {
    return overlap > 0 ? std::max(pushing(overlap, speed), Real(0)) : 0;
  }
  int at(Real overlap, Real speed) const {
    const bool pushes = pushing(overlap, speed) > 0;
    if (region == 1 && pushes) return 1;
    return overlap > 0 ? (pushes ? 1 : 2) : 0;
  }
  Real margin(Real overlap, Real speed) const {
    if (region == 0) return -overlap * stiffness;
    const Real f = pushing(overlap, speed);
    return region == 1 ? f : std::min(overlap * stiffness, -f);
  }
};

// Cases A and B. x = i, vf, xr, vr, xw, vw.
template <class Real>
class AxisContact {
 public:
  using State = std::array<Real, 6>;

  static constexpr State start() { return {0, 0, Real(-0.005L), 0, 0, 0}; }
  void set_command(Real value) { motor.command = value; }

  void operator()(const State &x, State &dx, Real /*t*/) const {
    const Real f = touch.force(x[2] - x[4], x[3] - x[5]);
    dx[0] = motor.current_rate(x[0], x[1], x[3]);
    dx[1] = motor.filter_rate(x[1], x[3]);
    dx[2] = x[3];
    dx[3] = (motor.k_force * x[0] - 500 * x[3] - f) * (1 / Real(132.4L));
    dx[4] = x[5];
    dx[5] = (f - 412700 * x[4] - Real(8.25L) * x[5]) * (1 / Real(6.6L));
  }
  // Enters the regions of x; says whether any changed.
  bool enter(const State &x) {
    const auto drive = motor.at(x[0], x[1]);
    const int contact = touch.at(x[2] - x[4], x[3] - x[5]);
    const bool changed = drive != motor.regions || contact != touch.region;
    motor.enter(drive);
    touch.region = contact;
    return changed;
  }
  Real margin(const State &x) const {
    return std::min(motor.margin(x[0], x[1]), touch.margin(x[2] - x[4], x[3] - x[5]));
  }
  Real force(const State &x) const { return touch.force(x[2] - x[4], x[3] - x[5]); }
  Real reading(const State &x) const { return force(x); }
  Real robot(const State &x) const { return x[2]; }
  Real workpiece(const State &x) const { return x[4]; }

 private:
  static constexpr Real r = Real(0.004043L);

 public:
  // The scenario's preamplifier is not limited.
  Motor<Real> motor{Real(3.9L),
                    Real(4.2L) * Real(0.039L) / r,
                    942,
                    1 / Real(3),
                    Real(1e30L),
                    10,
                    15,
                    Real(7.5L),
                    2,
                    60,
                    Real(4.5L),
                    Real(0.0158L),
                    Real(0.5L) / r,
                    Real(0.5L) / r};
  Touch<Real> touch{110100, Real(16.5L)};
};

// x = i, vf, then positions and velocities of rotor, arm, tip, sensor, workpiece, base.
template <class Real>
class FullAxis {
 public:
  using State = std::array<Real, 14>;

  static constexpr State start() {
    const Real back = Real(-0.005L);
    return {0, 0, back, back, back, back, 0, 0, 0, 0, 0, 0, 0, 0};
  }
  void set_command(Real value) { motor.command = value; }

  void operator()(const State &x, State &dx, Real /*t*/) const {
    const Real *p = &x[2];
    const Real *v = &x[8];
    const auto link = [&](int a, int b, Real k, Real d) {
      return k * (p[a] - p[b]) + d * (v[a] - v[b]);
    };
    const Real screw = link(0, 1, kScrew, 1500);
    const Real arm = link(1, 2, 665000, 640);
    const Real cell = link(2, 3, kSensor, Real(16.5L));
    const Real pad = force(x);
    const Real fixture = link(4, 5, 412700, Real(8.25L));
    const Real slide = 500 * (v[1] - v[5]);
    const Real thrust = motor.k_force * x[0];
    const Real speed = v[0] - v[5];
    dx[0] = motor.current_rate(x[0], x[1], speed);
    dx[1] = motor.filter_rate(x[1], speed);
    for (std::size_t i = 0; i < 6; ++i) dx[2 + i] = v[i];
    dx[8] = (thrust - screw) * (1 / Real(79.5L));
    dx[9] = (screw - arm - slide) * (1 / Real(35));
    dx[10] = (arm - cell) * (1 / Real(17.9L));
    dx[11] = (cell - pad) * (1 / Real(0.14L));
    dx[12] = (pad - fixture) * (1 / Real(6.6L));
    dx[13] = (fixture + slide - thrust - 3600000 * p[5] - 9500 * v[5]) * (1 / Real(500));
  }
  bool enter(const State &x) {
    const auto drive = motor.at(x[0], x[1]);
    const int contact = touch.at(x[5] - x[6], x[11] - x[12]);
    const bool changed = drive != motor.regions || contact != touch.region;
    motor.enter(drive);
    touch.region = contact;
    return changed;
  }
  Real margin(const State &x) const {
    return std::min(motor.margin(x[0], x[1]), touch.margin(x[5] - x[6], x[11] - x[12]));
  }
  Real force(const State &x) const { return touch.force(x[5] - x[6], x[11] - x[12]); }
  Real reading(const State &x) const { return kSensor * (x[4] - x[5]); }
  Real robot(const State &x) const { return x[2]; }
  Real workpiece(const State &x) const { return x[6]; }

 private:
  static constexpr Real r = Real(0.004043L);
  static constexpr Real kSensor = 110100, kScrew = 10000000;

 public:
  Motor<Real> motor{Real(3.9L),
                    Real(4.2L) * Real(0.039L) / r,
                    942,
                    Real(0.333L),
                    10,
                    10,
                    15,
                    Real(7.5L),
                    2,
                    60,
                    Real(4.5L),
                    Real(0.0158L),
                    Real(0.5L) / r,
                    Real(0.5L) / r};
  Touch<Real> touch{25000, 30};
};

// What a run leaves: one value a tick, before the control update, in the caller's arrays.
struct Record {
  double *force_N, *robot_m, *workpiece_m, *current_A;
  int *count;
  template <class Real, class Plant, class State>
  void put(std::size_t k, const Plant &plant, const State &x, int n) const {
    force_N[k] = static_cast<double>(plant.force(x));
    robot_m[k] = static_cast<double>(plant.robot(x));
    workpiece_m[k] = static_cast<double>(plant.workpiece(x));
    current_A[k] = static_cast<double>(x[0]);
    count[k] = n;
  }
};

}  // namespace forceaxis::bench
