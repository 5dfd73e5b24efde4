#pragma once
// What the linear analysis computes of matrices, in extended precision and without a library of
// linear algebra: the digits of a result hang neither on the processor nor on its BLAS kernel.
//
// A solve of LAPACK is right to a rounding of the largest number in it. Where one is far larger
// than those that decide (1/L of a winding of little inductance), nothing is left of these. Here
// the error is that of each entry: rows are scaled, sums are extended, the residual is solved for.
#include <Eigen/Core>
#include <complex>
#include <span>
#include <vector>

#include "sim/hybrid/network.hpp"

namespace forceaxis::sim {

/// Powers of 2 so that in diag(1/d) A diag(d) each row weighs about as much as its column (Parlett
/// and Reinsch 1969). A (n x n), d (n).
Eigen::VectorXd balance(const ExtendedMatrix &A);

/// Eigenvalues of A (n x n), of its balanced form, in no order. Throws std::runtime_error where the
/// iteration does not end, which no finite A is known to cause; std::invalid_argument for an A that
/// is not finite.
std::vector<std::complex<double>> eigenvalues(const ExtendedMatrix &A);

/// X of A X = B, A (n x n), B (n x m): rows scaled, pivots, one step on the residual. Not finite
/// for a singular A.
ExtendedMatrix solve(const ExtendedMatrix &A, const ExtendedMatrix &B);

/// e^(A T) - 1 and the integral of e^(A t) B over a sample of T, side by side (n x (n + m)). The
/// difference from 1 is what is doubled, so that slow states keep their digits beside fast ones.
ExtendedMatrix sampled(const ExtendedMatrix &A, const ExtendedMatrix &B, double T);

/// H, Q^T B, C Q with H = Q^T A Q upper Hessenberg, in double, for hessenberg_response.
struct Hessenberg {
  Eigen::MatrixXd H;
  Eigen::MatrixXd B;
  Eigen::MatrixXd C;
};
Hessenberg hessenberg(const ExtendedMatrix &A, const ExtendedMatrix &B, const ExtendedMatrix &C);

/// G(w) = C (p I - A)^-1 B + D, one input and one output, along the boundary of stability:
/// p = j w for dt = 0, else z = (1 + j w dt / 2) / (1 - j w dt / 2).
class BoundaryResponse {
 public:
  struct Value {
    std::complex<double> response;
    std::complex<double> slope;  ///< dG/dw
    double rounding;  ///< what half a unit in the last place of each entry, in double, moves G by
  };
  /// A (n x n), B (n x 1), C (1 x n).
  BoundaryResponse(ExtendedMatrix A, ExtendedMatrix B, ExtendedMatrix C, double D, double dt);
  /// At w >= 0, rad/s; on a pole the response is infinite and so is `rounding`.
  Value at(double w) const;

 private:
  ExtendedMatrix A_, B_, C_;
  double D_, dt_;
};

}  // namespace forceaxis::sim
