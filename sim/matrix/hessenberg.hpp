#pragma once
// Frequency response of a system whose matrix is an upper Hessenberg matrix.
#include <Eigen/Core>
#include <complex>
#include <span>

namespace forceaxis::sim {

/// Computes y = C (s I - H)^-1 B + D at many points s, for an upper Hessenberg matrix H (n x n).
/// `values` has points x outputs x inputs elements. Gaussian elimination of one subdiagonal with
/// pivots takes O(n^2) operations for each point. At a pole the values are not finite.
void hessenberg_response(const Eigen::MatrixXd &H, const Eigen::MatrixXd &B,
                         const Eigen::MatrixXd &C, const Eigen::MatrixXd &D,
                         std::span<const std::complex<double>> points,
                         std::span<std::complex<double>> values);

}  // namespace forceaxis::sim
