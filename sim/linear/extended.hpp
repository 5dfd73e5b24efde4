#pragma once
// Matrix functions for the linear analysis, in extended precision and without a library of linear
// algebra. So the digits of a result do not depend on the processor or on the kernel of a BLAS
// library.
//
// The error of a solution by LAPACK is relative to the largest number in the matrix. If one entry
// is far larger than those that determine the result, such as 1/L of a winding with a small
// inductance, the result has no correct digit. Here, rows are scaled, sums use extended precision,
// and one step corrects the residual, so the error is relative to each entry.
#include <Eigen/Core>
#include <complex>
#include <span>
#include <vector>

#include "sim/hybrid/network.hpp"

namespace forceaxis::sim {

/// Returns d, powers of 2 for which each row of diag(1/d) A diag(d) has about the same norm as its
/// column (Parlett and Reinsch 1969). A has n x n entries, d has n.
Eigen::VectorXd balance(const ExtendedMatrix &A);

/// Returns the eigenvalues of A (n x n), computed from its balanced form, in arbitrary order.
/// Throws std::invalid_argument if an entry of A is not finite, and std::runtime_error if the
/// iteration does not converge; no finite A is known for which it does not.
std::vector<std::complex<double>> eigenvalues(const ExtendedMatrix &A);

/// Returns the solution X of A X = B, with A (n x n) and B (n x m). Rows are scaled, pivots are
/// chosen and one step corrects the residual. X is not finite if A is singular.
ExtendedMatrix solve(const ExtendedMatrix &A, const ExtendedMatrix &B);

/// Returns e^(A T) - 1 and the integral of e^(A t) B over the sample time T in s, side by side (n x
/// (n + m)). The method doubles the difference from 1, so slow states keep their digits beside fast
/// states.
ExtendedMatrix sampled(const ExtendedMatrix &A, const ExtendedMatrix &B, double T);

/// The matrices H, Q^T B and C Q for hessenberg_response(), in double, with the upper Hessenberg
/// matrix H = Q^T A Q.
struct Hessenberg {
  Eigen::MatrixXd H;
  Eigen::MatrixXd B;
  Eigen::MatrixXd C;
};
Hessenberg hessenberg(const ExtendedMatrix &A, const ExtendedMatrix &B, const ExtendedMatrix &C);

/// The frequency response G(w) = C (p I - A)^-1 B + D of one input and one output, along the
/// boundary of stability: p = j w for dt = 0, else p is z = (1 + j w dt / 2) / (1 - j w dt / 2).
class BoundaryResponse {
 public:
  struct Value {
    std::complex<double> response;
    std::complex<double> slope;  ///< dG/dw
    /// Error of G if every entry of the matrices has an error of half a unit in the last place of a
    /// double.
    double rounding;
  };
  /// A is n x n, B is n x 1, C is 1 x n; dt is the sample time in s, 0 for continuous time.
  BoundaryResponse(ExtendedMatrix A, ExtendedMatrix B, ExtendedMatrix C, double D, double dt);
  /// Returns the response at w >= 0, in rad/s. On a pole, the response and `rounding` are infinite.
  Value at(double w) const;

 private:
  ExtendedMatrix A_, B_, C_;
  double D_, dt_;
};

}  // namespace forceaxis::sim
