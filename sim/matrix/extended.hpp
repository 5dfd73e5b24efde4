#pragma once
// Matrix functions of the simulator and the linear analysis in extended precision. These functions
// use no BLAS library, so the digits of a result do not depend on the processor or on a BLAS
// kernel.
//
// The error of a solution by LAPACK is relative to the largest entry of the matrix. If one entry is
// far larger than the entries that determine the result, the result has no correct digit. An
// example is 1/L of a winding with a small inductance. Here, rows are scaled, sums use extended
// precision, and one step corrects the residual, so the error is relative to each entry.
#include <Eigen/Core>
#include <complex>
#include <span>
#include <vector>

namespace forceaxis::sim {

/// Number type of matrices that are computed in extended precision and then rounded to double.
using Extended = long double;
using ExtendedMatrix = Eigen::Matrix<Extended, Eigen::Dynamic, Eigen::Dynamic>;
using ComplexMatrix = Eigen::Matrix<std::complex<Extended>, Eigen::Dynamic, Eigen::Dynamic>;

/// Returns scale factors d that balance the n x n matrix A: each row of diag(1/d) A diag(d) has
/// about the same norm as the column with the same index (Parlett and Reinsch 1969). The n factors
/// are powers of 2.
Eigen::VectorXd balance(const ExtendedMatrix &A);

/// Returns the eigenvalues of the n x n matrix A in arbitrary order. They are computed from the
/// balanced matrix. Throws std::invalid_argument if an entry of A is not finite. Throws
/// std::runtime_error if the iteration does not converge, which has never been observed for a
/// finite A.
std::vector<std::complex<double>> eigenvalues(const ExtendedMatrix &A);

/// The fast modes of the system x' = A x. The state x is the sum of two parts. The part right (left
/// x) moves with the fast eigenvalues. The remaining part does not move with them. A conjugate pair
/// of eigenvalues has one row or column in each matrix.
struct FastModes {
  ComplexMatrix values;  ///< f x 1, eigenvalues with an imaginary part of at least 0
  ComplexMatrix right;   ///< n x f, right eigenvectors

  /// Left eigenvectors as rows, f x n; their product with the right ones is the identity.
  ComplexMatrix left;
  /// The n x n matrix A without its fast part: A - right values left, with both modes of each
  /// conjugate pair.
  ExtendedMatrix slow;
  /// The n x n matrix with an upper bound of the error for each entry of `slow`.
  ExtendedMatrix error;
};

/// Returns the modes of the n x n matrix A whose eigenvalues are larger than `above` in magnitude.
/// If these modes cannot be separated from the others, because eigenvectors are nearly parallel,
/// f is 0 and `slow` is A. Throws std::invalid_argument if an entry of A is not finite.
FastModes fast_modes(const ExtendedMatrix &A, Extended above);

/// Returns the solution X of A X = B, with A (n x n) and B (n x m). The method scales rows, chooses
/// pivots and corrects the residual in one step. X is not finite if A is singular.
ExtendedMatrix solve(const ExtendedMatrix &A, const ExtendedMatrix &B);

/// Returns an n x (n + m) matrix for the sample time T in s. Its left n columns are e^(A T) - 1;
/// its right m columns are the integral of e^(A t) B over T. The method computes e^(A T) - 1
/// without forming e^(A T), which preserves the accuracy of slow states in a system with fast
/// states.
ExtendedMatrix sampled(const ExtendedMatrix &A, const ExtendedMatrix &B, double T);

/// The matrices H, Q^T B and C Q for hessenberg_response() in double. H = Q^T A Q is an upper
/// Hessenberg matrix.
struct Hessenberg {
  Eigen::MatrixXd H;
  Eigen::MatrixXd B;
  Eigen::MatrixXd C;
};
Hessenberg hessenberg(const ExtendedMatrix &A, const ExtendedMatrix &B, const ExtendedMatrix &C);

/// The frequency response G(w) = C (p I - A)^-1 B + D from one input to one output. p is on the
/// stability boundary: p = j w for dt = 0, and p = (1 + j w dt / 2) / (1 - j w dt / 2) otherwise.
class BoundaryResponse {
 public:
  struct Value {
    std::complex<double> response;
    /// Derivative dG/dw.
    std::complex<double> slope;
    /// Error of G if every entry of A, B, C and D has an error of half a unit in the last place of
    /// a double.
    double rounding;
  };
  /// A is n x n, B is n x 1 and C is 1 x n. dt is the sample time in s, or 0 for continuous time.
  BoundaryResponse(ExtendedMatrix A, ExtendedMatrix B, ExtendedMatrix C, double D, double dt);
  /// Returns the response at the frequency w >= 0, in rad/s. At a pole, `response` and `rounding`
  /// are infinite.
  Value at(double w) const;

 private:
  ExtendedMatrix A_, B_, C_;
  double D_, dt_;
};

}  // namespace forceaxis::sim
