#pragma once
// The energy balance of a simulated plant.
#include <cstddef>
#include <vector>

#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/mode.hpp"

namespace forceaxis::sim {

/// Energies in J since the start of the run.
struct EnergyIntegrals {
  /// Work of each energy source, in the order of Network::supplies().
  std::vector<double> supplied;
  /// Energy that each damper has dissipated, in the order of Network::dampers().
  std::vector<double> dissipated;
  /// Spring energy that was lost when contacts opened or when a stepper motor was disabled.
  double discarded = 0.0;
  double impulse = 0.0;  ///< work of all impulses on bodies, in J
};

/// Returns the spring energy in J of each element of Network::storages().
std::vector<double> stored_energies(const Mode &mode, const double *z);

/// Integrates the energies with compensated sums. The motion of the plant does not depend on these
/// energies. Copies of an account are independent.
class EnergyAccount {
 public:
  explicit EnergyAccount(const Network &network);

  /// Selects the mode of all further calls. `mode` must exist until the next call of enter().
  void enter(const Mode &mode) { mode_ = &mode; }
  /// Adds the energies of a period of 2^-halvings ticks that starts at the state z. `forms` has the
  /// quadratic forms of the present mode.
  void add_whole(const EnergyForms &forms, const double *z, std::size_t halvings);
  /// Adds the energies of a period of `s` ticks that starts at the state z. `rate_hz` is the number
  /// of ticks in a second. `chain` has the Taylor coefficients of the state: order + 1 blocks of
  /// Mode::flow_stride values.
  void add_part(const double *z, const double *chain, double s, double rate_hz);
  /// Returns the spring energy at the state z, in J.
  double stored(const double *z) const;
  /// discard() adds spring energy that is lost at one instant, for example when a contact opens.
  /// add_impulse() adds the work of an impulse. The unit is J.
  void discard(double energy) { discarded_.add(energy); }
  void add_impulse(double work) { impulse_.add(work); }
  /// Sets the sum of the discarded energy to 0.
  void begin() { discarded_ = {}; }

  EnergyIntegrals integrals() const;

 private:
  struct Sum {  // compensated summation by the method of Neumaier
    double value = 0.0;
    double lost = 0.0;
    void add(double term);
    double total() const { return value + lost; }
  };

  kernel::Multiply multiply_ = kernel::best_multiply();
  const Mode *mode_ = nullptr;
  kernel::Vector products_;
  kernel::Vector integrals_;  // energies in J: first those that each source has supplied, then
                              // those that each damper has dissipated
  std::vector<Sum> supplied_;
  std::vector<Sum> dissipated_;
  Sum discarded_;
  Sum impulse_;
};

}  // namespace forceaxis::sim
