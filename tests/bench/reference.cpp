// The independent reference: Runge-Kutta-Fehlberg 7(8) in extended precision with bisected
// crossings. Cases A and B come from the loop tests' own equations, the full axis from plants.hpp.
#include <boost/numeric/odeint/stepper/runge_kutta_fehlberg78.hpp>

#include "tests/bench/peers.hpp"
#include "tests/bench/plants.hpp"
#include "tests/loop/axis_contact_reference.hpp"

namespace forceaxis::bench {
namespace {

using Real = long double;
using Plant = FullAxis<Real>;

// The amplifier's outer slope has rates of 12,500 / s, 8.4 per tick.
constexpr int kStepsPerTick = 64;

Plant::State flow(const Plant &plant, const Plant::State &x, Real step) {
  boost::numeric::odeint::runge_kutta_fehlberg78<Plant::State, Real> rk;
  Plant::State out = x;
  rk.do_step(plant, x, Real(0), out, step);
  return out;
}

bool leaves(const Plant &plant, const Plant::State &x) {
  Plant copy = plant;
  return copy.enter(x);
}

long run_full(int gain, int setpoint_N, int ticks, const Record &record) {
  Plant plant;
  Plant::State x = Plant::start();
  long crossings = 0;
  for (int k = 0;; ++k) {
    const int n = convert(plant.reading(x));
    record.put<Real>(static_cast<std::size_t>(k), plant, x, n);
    if (k == ticks) return crossings;
    plant.set_command(volts<Real>(law(n, gain, setpoint_N)));
    plant.enter(x);
    for (int part = 0; part < kStepsPerTick; ++part) {
      Real left = 1 / Real(1500) / kStepsPerTick;
      for (;;) {
        const Plant::State end = flow(plant, x, left);
        if (!leaves(plant, end)) {
          x = end;
          break;
        }
        Real low = 0, high = left;
        for (int i = 0; i < 80 && low < high; ++i) {
          const Real middle = (low + high) / 2;
          (leaves(plant, flow(plant, x, middle)) ? high : low) = middle;
        }
        x = flow(plant, x, high);
        plant.enter(x);
        left -= high;
        ++crossings;
      }
    }
  }
}

}  // namespace

long run_reference(bool full, int gain, int setpoint_N, int ticks, const Record &record) {
  if (full) return run_full(gain, setpoint_N, ticks, record);
  const axis_contact::Reference ref = axis_contact::simulate(gain, setpoint_N, 16);
  for (std::size_t k = 0; k <= static_cast<std::size_t>(ticks); ++k) {
    record.force_N[k] = ref.force_N[k];
    record.robot_m[k] = ref.robot_m[k];
    record.workpiece_m[k] = ref.workpiece_m[k];
    record.current_A[k] = ref.current_A[k];
    record.count[k] = ref.adc_count[k];
  }
  return ref.crossings;
}

}  // namespace forceaxis::bench
