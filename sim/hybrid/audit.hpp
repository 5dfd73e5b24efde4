#pragma once
// The matrices for the energy audit of one mode.
#include <cstddef>
#include <memory>
#include <vector>

#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/network.hpp"

namespace forceaxis::sim {

/// Rows that compute the powers and the stored energies in one mode. A power is the product of two
/// factors, for example a force and a velocity. A stored energy is half such a product plus a
/// constant part. Each row is multiplied by the vector z.
struct EnergyRows {
  /// Rows for the first factor of each power: all energy supplies, followed by all dampers.
  std::vector<double> first;
  /// Rows for the second factor of each power: all energy supplies, followed by all dampers.
  std::vector<double> second;
  /// Rows for the first factor of the energy in each storage element.
  std::vector<double> store_first;
  /// Rows for the second factor of the energy in each storage element.
  std::vector<double> store_second;
  /// Rows for the constant part, in J, of the energy in each storage element.
  std::vector<double> store_constant;
};

EnergyRows energy_rows(const Network &network, const ModeEquations &equations);

/// The integrals of all powers in one mode, as quadratic forms of the vector z. They take longer to
/// build than the mode itself.
struct EnergyForms {
  /// Number of rows in a matrix of forms: the padded number of supplies and dampers.
  std::size_t stride = 0;
  /// Quadratic forms of the energies in J, with the index [column j][row i][supplies, then
  /// dampers]. The forms with index k are integrals over 2^-k ticks. Only a mode with pieces has
  /// more than one of them.
  std::vector<kernel::Vector> over;
};

/// Builds the forms of a mode. `a` is the square flow matrix for the unit of time `tick_s` in s.
/// The integrals are over 1, 1/2, ..., 2^-halvings ticks.
std::unique_ptr<const EnergyForms> build_energy_forms(const Network &network,
                                                      const ModeEquations &equations,
                                                      const ExtendedMatrix &a, Extended tick_s,
                                                      std::size_t halvings);

}  // namespace forceaxis::sim
