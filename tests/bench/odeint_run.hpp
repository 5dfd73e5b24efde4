#pragma once
// boost::odeint on the benchmark: dopri5 at a tolerance of 1e-4, regions frozen within a step,
// crossings located on its dense output. Written for speed: no allocation, no step beyond a tick,
// the derivative carried from step to step as far as the command holds.
#include <boost/numeric/odeint/stepper/runge_kutta_dopri5.hpp>

#include "tests/bench/peers.hpp"
#include "tests/bench/plants.hpp"

namespace forceaxis::bench {
namespace odeint {

inline constexpr double kTolerance = 1e-4;

template <class Plant>
long run(Plant plant, int gain, int setpoint_N, int ticks, const Record &record) {
  using State = typename Plant::State;
  constexpr double tick = 1 / kRate;
  boost::numeric::odeint::runge_kutta_dopri5<State> stepper;
  State x = plant.start(), slope{}, next, next_slope, error, trial;
  long crossings = 0;
  int held = 1 << 30;
  plant.enter(x);
  for (int k = 0;; ++k) {
    const int n = convert(plant.reading(x));
    record.put<double>(static_cast<std::size_t>(k), plant, x, n);
    if (k == ticks) return crossings;
    const int code = law(n, gain, setpoint_N);
    if (code != held) {
      held = code;
      plant.set_command(volts<double>(code));
      plant.enter(x);
      plant(x, slope, 0.0);
    }
    double left = tick;
    double step = tick;
    while (left > 0) {
      if (step > left) step = left;
      stepper.do_step(plant, x, slope, 0.0, next, next_slope, step, error);
      double worst = 0;
      for (std::size_t i = 0; i < x.size(); ++i) {
        // odeint's default error checker.
        const double allowed =
            kTolerance + kTolerance * (std::abs(x[i]) + step * std::abs(slope[i]));
        worst = std::max(worst, std::abs(error[i]) / allowed);
      }
      if (worst > 1) {
        step *= std::max(0.9 * std::pow(worst, -1.0 / 3), 0.2);
        continue;
      }
      double high_margin = plant.margin(next);
      if (high_margin >= 0) {
        std::swap(x, next);
        std::swap(slope, next_slope);
        left = left > step * (1 + 1e-12) ? left - step : 0;
        if (worst < 0.5) step *= std::min(0.9 * std::pow(std::max(worst, 1e-3), -0.2), 5.0);
        continue;
      }
      // Regula falsi (Illinois) on the dense output.
      double low = 0, high = step;
      double low_margin = plant.margin(x);
      int stayed = 0;
      while (high - low > 1e-10 * step) {
        double at = low + (high - low) * low_margin / (low_margin - high_margin);
        const double guard = 1e-11 * step;
        if (!(at > low + guard)) at = low + guard;
        if (!(at < high - guard)) at = high - guard;
        stepper.calc_state(at, trial, x, slope, 0.0, next, next_slope, step);
        const double margin = plant.margin(trial);
        if (margin >= 0) {
          low = at;
          low_margin = margin;
          if (stayed == 1) high_margin /= 2;
          stayed = 1;
        } else {
          high = at;
          high_margin = margin;
          if (stayed == -1) low_margin /= 2;
          stayed = -1;
        }
      }
      stepper.calc_state(high, trial, x, slope, 0.0, next, next_slope, step);
      x = trial;
      plant.enter(x);
      plant(x, slope, 0.0);
      left -= high;
      ++crossings;
    }
  }
}

}  // namespace odeint
}  // namespace forceaxis::bench
