#pragma once
// State-space form of a plant in one of its modes, and frequency responses. The equations are those
// that the simulation uses.
#include <Eigen/Core>
#include <complex>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "sim/model/model.hpp"

namespace forceaxis::sim {

/// Linear system x' = A x + B u, y = C x + D u. x, u and y are deviations from any motion within
/// one mode.
struct Linear {
  Eigen::MatrixXd A;  ///< system matrix, n x n
  Eigen::MatrixXd B;  ///< input matrix, n x number of inputs
  Eigen::MatrixXd C;  ///< output matrix, number of outputs x n
  Eigen::MatrixXd D;  ///< direct matrix, number of outputs x number of inputs
  std::vector<std::string> states;
};

/// Selection of a mode. By default, contacts are closed and every other element is in the middle of
/// its range. `states` gives other states, as element -> state with the names of Event.
struct LinearMode {
  std::map<std::string, std::string> states;
  bool free = false;  ///< true: contacts of the model whose state the caller does not give are open
  bool drive = true;  ///< false: the model is analysed without its drive, and the input drive.force
                      ///< is the force on the axis
};

/// The name of an element with discrete states, and the names of these states as in Event.
struct SwitchStates {
  std::string element;
  std::vector<std::string> states;
};
std::vector<SwitchStates> switches_of(const Model &model);

/// Returns the linear system of a mode with the named inputs and outputs. Inputs:
///   drive.command V: the velocity command of the drive
///   drive.tach V: a voltage that is added to the tachometer of a DC motor
///   drive.force N: a force that is added to the force of the drive
///   BODY.force N: an external force on a body
/// Outputs:
///   any signal of the model
///   reading: the signal of ADC 0 before the conversion, in the unit of the signal
///   adc0, adc1: in 8-bit counts
///   encoder: in counts
/// Throws InputError if an input, output, element or state does not exist.
Linear linearise(const Model &model, const LinearMode &mode, std::span<const std::string> inputs,
                 std::span<const std::string> outputs);

}  // namespace forceaxis::sim
