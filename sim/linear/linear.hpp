#pragma once
// State space of a plant in one of its modes, from the same equations that the stepper integrates,
// and frequency responses.
#include <Eigen/Core>
#include <complex>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "sim/model/model.hpp"

namespace forceaxis::sim {

/// x' = A x + B u, y = C x + D u: deviations from any motion within one mode.
struct Linear {
  Eigen::MatrixXd A;  ///< n x n
  Eigen::MatrixXd B;  ///< n x inputs
  Eigen::MatrixXd C;  ///< outputs x n
  Eigen::MatrixXd D;  ///< outputs x inputs
  std::vector<std::string> states;
};

/// Which mode. Contacts touch and everything else is in the middle of its range unless `states`
/// (element -> state, as in Event) says otherwise.
struct LinearMode {
  std::map<std::string, std::string> states;
  bool free = false;  ///< contacts are apart
  bool drive = true;  ///< false: the drive is removed; input drive.force acts in its place
};

/// An element that switches and its states, as in Event.
struct SwitchStates {
  std::string element;
  std::vector<std::string> states;
};
std::vector<SwitchStates> switches_of(const Model &model);

/// Inputs: drive.command V | drive.tach V, added to a DC motor's tachometer | drive.force N, on the
/// drive's body and against its reaction, in addition to the drive's own | BODY.force N, external.
/// Outputs: any signal of the model | reading, what ADC 0 converts, in its signal's unit | adc0,
/// adc1 in 8-bit counts | encoder in counts. Throws InputError if an input, output, element or
/// state does not exist.
Linear linearise(const Model &model, const LinearMode &mode, std::span<const std::string> inputs,
                 std::span<const std::string> outputs);

/// y = C (s I - H)^-1 B + D at many points s, for H upper Hessenberg (n x n). `values` holds
/// points x outputs x inputs. Each point costs O(n^2): Gaussian elimination of one subdiagonal with
/// pivots. At a pole the values are not finite.
void hessenberg_response(const Eigen::MatrixXd &H, const Eigen::MatrixXd &B,
                         const Eigen::MatrixXd &C, const Eigen::MatrixXd &D,
                         std::span<const std::complex<double>> points,
                         std::span<std::complex<double>> values);

}  // namespace forceaxis::sim
