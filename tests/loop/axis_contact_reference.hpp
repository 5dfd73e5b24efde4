#pragma once
// An independent integration of the benchmark plant "axis-contact": the equations written out by
// hand, Runge-Kutta-Fehlberg 7(8) of boost::odeint, regions of every nonlinearity frozen within a
// step and the step repeated up to a bisected crossing; a signal that dips over its bound and back
// within a step shows by its rate. In extended precision unless Real says otherwise. Shares no code
// with sim/ or firmware/.
#include <array>
#include <boost/numeric/odeint/stepper/runge_kutta_fehlberg78.hpp>
#include <cmath>
#include <limits>
#include <vector>

namespace axis_contact {

struct Regions {
  int feedback = 0;   // -1, 0, 1: current feedback at -10 V, linear, at +10 V
  int amplifier = 0;  // -2..2: the five segments of the two-gain curve
  int contact = 0;    // 0 apart, 1 pressed, 2 overlapping without force
  bool operator==(const Regions &) const = default;
};

struct Reference {
  std::vector<double> force_N, robot_m, workpiece_m, current_A;
  std::vector<int> adc_count, dac_code;
  int touch_downs = 0;
  int contact_crossings = 0;
  int crossings = 0;  // all, inside ticks
  double first_touch_s = -1;
};

template <class Real>
class PlantOf {
 public:
  using State = std::array<Real, 6>;  // i, vf, xr, vr, xw, vw; SI

  State s{0, 0, Real(-0.005L), 0, 0, 0};
  Real volts = 0;
  Regions regions;

  static Real overlap(const State &x) { return x[2] - x[4]; }
  static Real pressed_force(const State &x) { return K_S * overlap(x) + B_S * (x[3] - x[5]); }
  Real force() const { return regions.contact == 1 ? pressed_force(s) : 0; }
  Real feedback(const State &x, const Regions &r) const {
    return r.feedback == 0 ? x[0] / 3 : Real(10 * r.feedback);
  }
  Real error(const State &x, const Regions &r) const {
    return K_CMD * volts - x[1] - feedback(x, r);
  }

  void operator()(const State &x, State &dx, Real /*t*/) const {
    const Real f = regions.contact == 1 ? pressed_force(x) : 0;
    const Real e = error(x, regions);
    Real vm = 0;
    switch (regions.amplifier) {
      case 0:
        vm = 15 * e;
        break;
      case 1:
        vm = OUTER * (e + 2);
        break;
      case -1:
        vm = OUTER * (e - 2);
        break;
      default:
        vm = Real(30 * regions.amplifier);
        break;
    }
    dx[0] = (vm - R * x[0] - K_E / R_T * x[3]) / L;
    dx[1] = 942 * (TACH / R_T * x[3] - x[1]);
    dx[2] = x[3];
    dx[3] = (K_E / R_T * x[0] - 500 * x[3] - f) / M_R;
    dx[4] = x[5];
    dx[5] = (f - 412700 * x[4] - B_W * x[5]) / M_W;
  }

  Regions at(const State &x) const {
    Regions r = regions;
    r.feedback = x[0] / 3 > 10 ? 1 : x[0] / 3 < -10 ? -1 : 0;
    const Real e = error(x, r);
    r.amplifier = e > 6 ? 2 : e > 2 ? 1 : e < -6 ? -2 : e < -2 ? -1 : 0;
    const Real d = overlap(x);
    const bool pushes = pressed_force(x) > 0;
    switch (regions.contact) {
      case 0:
        r.contact = d > 0 ? (pushes ? 1 : 2) : 0;
        break;
      case 1:
        r.contact = pushes ? 1 : (d > 0 ? 2 : 0);
        break;
      default:
        r.contact = d <= 0 ? 0 : (pushes ? 1 : 2);
        break;
    }
    return r;
  }

  State flow(Real dt) const {
    boost::numeric::odeint::runge_kutta_fehlberg78<State, Real> rk;
    State out = s;
    rk.do_step(*this, s, Real(0), out, dt);
    return out;
  }

  // Advances by one tick in `steps` steps, each repeated up to every crossing.
  void tick(int steps, Real start_s, Reference &ref) {
    regions = at(s);  // the command jumped
    for (int k = 0; k < steps; ++k) {
      Real left = Real(1) / 1500 / steps;
      const Real end = start_s + (k + 1) * left;
      for (;;) {
        const State trial = flow(left);
        Real lo = 0, hi = left;
        if (at(trial) == regions && !dips(trial, left, hi)) {
          s = trial;
          break;
        }
        for (int i = 0; i < 80; ++i) {
          const Real mid = (lo + hi) / 2;
          if (mid == lo || mid == hi) break;
          (at(flow(mid)) == regions ? lo : hi) = mid;
        }
        s = flow(hi);
        const Regions next = at(s);
        left -= hi;
        ++ref.crossings;
        if (next.contact != regions.contact) {
          ++ref.contact_crossings;
          if (regions.contact == 0) {
            if (ref.touch_downs++ == 0) ref.first_touch_s = static_cast<double>(end - left);
          }
        }
        regions = next;
      }
    }
  }

 private:
  struct Watched {  // low < value < high within the regions at hand
    Real value, rate, low, high;
  };
  std::array<Watched, 4> watched(const State &x) const {
    constexpr Real kInfinity = std::numeric_limits<Real>::infinity();
    constexpr Real kEdges[] = {-kInfinity, -6, -2, 2, 6, kInfinity};
    State dx;
    (*this)(x, dx, 0);
    const int fb = regions.feedback, a = regions.amplifier + 2, c = regions.contact;
    const Real slope = fb == 0 ? dx[0] / 3 : 0;
    const Real force_rate = K_S * (x[3] - x[5]) + B_S * (dx[3] - dx[5]);
    return {Watched{x[0] / 3, dx[0] / 3,
                    fb == 0   ? Real(-10)
                    : fb == 1 ? Real(10)
                              : -kInfinity,
                    fb == 0    ? Real(10)
                    : fb == -1 ? Real(-10)
                               : kInfinity},
            Watched{error(x, regions), -dx[1] - slope, kEdges[a], kEdges[a + 1]},
            Watched{overlap(x), x[3] - x[5], c == 2 ? Real(0) : -kInfinity,
                    c == 0 ? Real(0) : kInfinity},
            Watched{pressed_force(x), force_rate, c == 1 ? Real(0) : -kInfinity,
                    c == 2 ? Real(0) : kInfinity}};
  }

  // Both ends of a step lie within the regions; finds an extremum between them that does not.
  bool dips(const State &trial, Real dt, Real &outside) const {
    const auto from = watched(s), to = watched(trial);
    for (std::size_t i = 0; i < from.size(); ++i) {
      for (const Real sign : {Real(1), Real(-1)}) {
        const Real bound = sign > 0 ? from[i].low : -from[i].high;
        const Real start = sign * from[i].value - bound, end = sign * to[i].value - bound;
        const Real falls = -sign * from[i].rate, rises = sign * to[i].rate;
        // Twice as steep all the way would not reach the bound.
        if (falls <= 0 || rises <= 0 || start > 2 * falls * dt || end > 2 * rises * dt) continue;
        Real lo = 0, hi = dt;
        for (int k = 0; k < 80; ++k) {
          const Real mid = (lo + hi) / 2;
          if (mid == lo || mid == hi) break;
          (sign * watched(flow(mid))[i].rate < 0 ? lo : hi) = mid;
        }
        if (at(flow(hi)) == regions) continue;
        outside = hi;
        return true;
      }
    }
    return false;
  }

  static constexpr Real K_S = 110100, B_S = 16.5L, R_T = 0.004043L, K_CMD = 3.9L, OUTER = 7.5L;
  static constexpr Real R = 4.5L, K_E = 0.5L, L = 0.0158L, TACH = 4.2L * 0.039L;
  static constexpr Real M_R = 132.4L, M_W = 6.6L, B_W = 8.25L;
};

using Real = long double;
using Plant = PlantOf<Real>;

// Case A: gain 4, setpoint 59 N. Case B: gain 15, setpoint 100 N. 3001 samples.
inline Reference simulate(int gain_codes_per_count, Real setpoint_N, int steps_per_tick) {
  Reference ref;
  Plant plant;
  const Real q = 20.0L / 4096;
  const Real kf = gain_codes_per_count * q / 2;
  for (int k = 0; k <= 3000; ++k) {
    const Real f = plant.force();
    Real n = std::floor(f / 2 + 0.5L);
    n = n < -128 ? -128 : n > 127 ? 127 : n;
    Real c = std::floor(kf * (setpoint_N - 2 * n) / q + 0.5L);
    c = c < -2048 ? -2048 : c > 2047 ? 2047 : c;
    ref.force_N.push_back(static_cast<double>(f));
    ref.robot_m.push_back(static_cast<double>(plant.s[2]));
    ref.workpiece_m.push_back(static_cast<double>(plant.s[4]));
    ref.current_A.push_back(static_cast<double>(plant.s[0]));
    ref.adc_count.push_back(static_cast<int>(n));
    ref.dac_code.push_back(static_cast<int>(c));
    plant.volts = c * q;
    if (k < 3000) plant.tick(steps_per_tick, Real(k) / 1500, ref);
  }
  return ref;
}

}  // namespace axis_contact
