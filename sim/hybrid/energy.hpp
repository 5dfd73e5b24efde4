#pragma once
// Where the mechanical energy of a stepped plant goes.
#include <cstddef>
#include <vector>

#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/mode.hpp"

namespace forceaxis::sim {

/// Integrals since the start, J.
struct EnergyIntegrals {
  std::vector<double> supplied;    ///< per Network::supplies()
  std::vector<double> dissipated;  ///< per Network::dampers()
  double discarded = 0.0;          ///< spring energy dropped when a contact lets go under load
  double impulse = 0.0;            ///< work of impulses
};

/// Spring energy, one entry per Network::storages(), J.
std::vector<double> stored_energies(const Mode &mode, const ModeAudit &audit, const double *z);

/// Adds up, with compensated sums; changes nothing of the motion. Copies are independent.
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
  double stored(const double *z) const;
  void discard(double energy) { discarded_.add(energy); }
  void add_impulse(double work) { impulse_.add(work); }
  /// Forgets what was discarded so far.
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
