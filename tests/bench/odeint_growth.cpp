// boost::odeint on the plants of `forceaxis bench --growth`.
#include <stdexcept>

#include "tests/bench/growth_plants.hpp"
#include "tests/bench/odeint_run.hpp"

namespace forceaxis::bench {

long run_odeint_chain(int bodies, int gain, int setpoint_N, int ticks, const Record &record) {
  switch (bodies) {
    case 2:
      return odeint::run(Chain<2>{}, gain, setpoint_N, ticks, record);
    case 5:
      return odeint::run(Chain<5>{}, gain, setpoint_N, ticks, record);
    case 11:
      return odeint::run(Chain<11>{}, gain, setpoint_N, ticks, record);
    case 20:
      return odeint::run(Chain<20>{}, gain, setpoint_N, ticks, record);
    case 29:
      return odeint::run(Chain<29>{}, gain, setpoint_N, ticks, record);
    default:
      throw std::invalid_argument("expected a chain of 2, 5, 11, 20 or 29 bodies");
  }
}

long run_odeint_rattle(double frequency_Hz, int gain, int setpoint_N, int ticks,
                       const Record &record) {
  return odeint::run(Rattle{frequency_Hz}, gain, setpoint_N, ticks, record);
}

}  // namespace forceaxis::bench
