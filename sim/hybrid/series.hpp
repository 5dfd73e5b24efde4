#pragma once
// Functions that compute Taylor series of matrix exponentials with error bounds, and functions that
// copy matrices in extended precision to the arrays of a mode.
#include <cstddef>
#include <vector>

#include "sim/hybrid/kernel.hpp"
#include "sim/matrix/extended.hpp"

namespace forceaxis::sim {

/// Relative truncation error of the series of a flow matrix.
inline constexpr double kTruncation = 0x1p-58;
/// Highest order of the Taylor series on a part of a tick.
inline constexpr int kHighestOrder = 13;

/// Matrix of upper bounds. These are computed in double, with an error that is far below the
/// rounding error that each test of a mode assumes.
using BoundMatrix = Eigen::MatrixXd;

/// Returns the product a b. Every entry is summed in ascending order of the columns of a. Terms
/// that are 0 because of a sparse factor take no time.
ExtendedMatrix product(const ExtendedMatrix &a, const ExtendedMatrix &b);
BoundMatrix product(const BoundMatrix &a, const BoundMatrix &b);

inline BoundMatrix absolute(const ExtendedMatrix &a) { return a.cwiseAbs().cast<double>(); }

/// The influence of each entry of z on each other entry, which is the sum of all W^k with W = |a| /
/// rate. `rate` is at least twice the spectral radius of |a| and at least 1. The truncation error
/// of a Taylor series is relative to this influence.
struct Influence {
  /// Scale of the matrix `a`: a power of two in the unit of the entries of `a`.
  double rate = 1;
  BoundMatrix sum;
};

Influence influence(const ExtendedMatrix &a);

/// Computes an upper bound of e^|b| with b = a / parts. The terms |b|^k / k! are summed until every
/// entry of the remaining terms is below `accuracy` times the influence; this amount is then added.
/// Returns the number of terms after the identity, or 0 if `most` terms are not sufficient.
int absolute_series(const ExtendedMatrix &a, std::size_t parts, const Influence &scale,
                    double accuracy, int most, BoundMatrix *sum);

/// Returns the sum of b^k / k! for k = 1 to `terms`, which is e^b - 1.
ExtendedMatrix series_less_one(const ExtendedMatrix &b, int terms);

/// Returns the sum of b^k / k! for k = 0 to `terms`, which is e^b.
ExtendedMatrix series(const ExtendedMatrix &b, int terms);

/// Returns the matrices e^(a / 2^k) - 1 for k = 0 to `halvings`. `terms` is the order of the series
/// for the last matrix. The error is relative to the change of a state and not to the state.
std::vector<ExtendedMatrix> changes(const ExtendedMatrix &a, std::size_t halvings, int terms);

/// Appends the elements of a matrix to `out`, row by row.
void put_rows(const ExtendedMatrix &rows, std::vector<double> *out);

/// Copies `rows` into a matrix that is stored by columns. The first row is copied to the row
/// `first`.
template <typename Scalar>
void put_block(const Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic> &rows, std::size_t first,
               std::size_t stride, kernel::Vector *out, std::size_t offset = 0) {
  for (Eigen::Index j = 0; j < rows.cols(); ++j)
    for (Eigen::Index i = 0; i < rows.rows(); ++i)
      (*out)[offset + static_cast<std::size_t>(j) * stride + first + static_cast<std::size_t>(i)] =
          static_cast<double>(rows(i, j));
}

}  // namespace forceaxis::sim
