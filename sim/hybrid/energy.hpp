#pragma once
// The energy balance of a stepped plant.
#include <cstddef>
#include <vector>

#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/mode.hpp"

namespace forceaxis::sim {

/// Integrals since the start, J.
struct EnergyIntegrals {
  std::vector<double> supplied;    ///< per Network::supplies()
  std::vector<double> dissipated;  ///< per Network::dampers()
  double discarded = 0.0;          ///< spring energy lost when a contact separates under load
  double impulse = 0.0;            ///< work of impulses
};

/// Spring energy, one entry per Network::storages(), J.
std::vector<double> stored_energies(const Mode &mode, const ModeAudit &audit, const double *z);

/// Accumulates the integrals with compensated sums; the motion does not depend on it. Copies are
/// independent.
class EnergyAccount {
 public:
  explicit EnergyAccount(const Network &network);

  /// The mode of all further calls; both must outlive them.
  void enter(const Mode &mode, const ModeAudit &audit);
  /// A whole tick from z on.
  void add_tick(const double *z);
  /// `s` ticks, `rate_hz` of them a second, from z on, of which `chain` holds the Taylor
  /// coefficients (order + 1 blocks of Mode::flow_stride).
  void add_part(const double *z, const double *chain, double s, double rate_hz);
  /// Spring energy now, J.
  double stored(const double *z) const;
  /// Both in J.
  void discard(double energy) { discarded_.add(energy); }
  void add_impulse(double work) { impulse_.add(work); }
  /// Resets the discarded energy to 0.
  void begin() { discarded_ = {}; }

  EnergyIntegrals integrals() const;

 private:
  struct Sum {  // Neumaier's compensated sum
    double value = 0.0;
    double lost = 0.0;
    void add(double term);
    double total() const { return value + lost; }
  };

  kernel::Multiply multiply_ = kernel::best_multiply();
  const Mode *mode_ = nullptr;
  const ModeAudit *audit_ = nullptr;
  kernel::Vector forms_;
  kernel::Vector integrals_;  // of supplies, then dampers
  std::vector<Sum> supplied_;
  std::vector<Sum> dissipated_;
  Sum discarded_;
  Sum impulse_;
};

}  // namespace forceaxis::sim
