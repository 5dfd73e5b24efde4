#include "sim/matrix/extended.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>

namespace forceaxis::sim {
namespace {

using Complex = std::complex<Extended>;
using Eigen::Index;

// Multiplies complex numbers. Unlike the operator of the standard library, this function does not
// test for infinities.
Complex times(Complex a, Complex b) {
  return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}

Complex inverse(Complex a) {
  const Extended size = a.real() * a.real() + a.imag() * a.imag();
  return {a.real() / size, -a.imag() / size};
}

Extended times(Extended a, Extended b) { return a * b; }
Extended inverse(Extended a) { return 1 / a; }
Extended size(Extended a) { return std::abs(a); }
Extended size(Complex a) { return std::abs(a.real()) + std::abs(a.imag()); }

// Returns the largest power of 2 that is at most the positive number `value`.
Extended power_below(Extended value) { return std::ldexp(Extended{1}, std::ilogb(value)); }

// The factors P L U of a matrix. Each row is first scaled so that its largest entry is about 1.
template <typename Scalar>
class Factors {
 public:
  using Matrix = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  using Vector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;

  explicit Factors(Matrix matrix) : matrix_(std::move(matrix)), factors_(matrix_) {
    const Index n = matrix_.rows();
    scale_.resize(n);
    order_.resize(static_cast<std::size_t>(n));
    for (Index i = 0; i < n; ++i) {
      order_[static_cast<std::size_t>(i)] = i;
      Extended most = 0;
      for (Index j = 0; j < n; ++j) most = std::max(most, size(matrix_(i, j)));
      if (!(most > 0) || !std::isfinite(most)) {
        singular_ = true;
        return;
      }
      scale_(i) = 1 / power_below(most);
      factors_.row(i) *= Scalar(scale_(i));
    }
    for (Index k = 0; k < n; ++k) {
      Index pivot = k;
      for (Index i = k + 1; i < n; ++i)
        if (size(factors_(i, k)) > size(factors_(pivot, k))) pivot = i;
      if (!(size(factors_(pivot, k)) > 0)) {
        singular_ = true;
        return;
      }
      if (pivot != k) {
        factors_.row(pivot).swap(factors_.row(k));
        std::swap(order_[static_cast<std::size_t>(pivot)], order_[static_cast<std::size_t>(k)]);
      }
      const Scalar reciprocal = inverse(factors_(k, k));
      for (Index i = k + 1; i < n; ++i) {
        if (factors_(i, k) == Scalar(0)) continue;
        const Scalar factor = times(factors_(i, k), reciprocal);
        factors_(i, k) = factor;
        for (Index j = k + 1; j < n; ++j) factors_(i, j) -= times(factor, factors_(k, j));
      }
    }
  }

  bool singular() const { return singular_; }

  // Returns the solution x of M x = b. One step of iterative refinement reduces the residual.
  Vector solve(const Vector &b) const {
    Vector x = forward(b);
    Vector rest = b;
    const Index n = rest.size();
    for (Index i = 0; i < n; ++i)
      for (Index j = 0; j < n; ++j) rest(i) -= times(matrix_(i, j), x(j));
    x += forward(rest);
    return x;
  }

  // Returns the solution y of y M = c.
  Vector solve_left(const Vector &c) const {
    Vector y = backward(c);
    Vector rest = c;
    const Index n = rest.size();
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i) rest(j) -= times(matrix_(i, j), y(i));
    y += backward(rest);
    return y;
  }

 private:
  Vector forward(const Vector &b) const {
    const Index n = b.size();
    Vector x(n);
    for (Index i = 0; i < n; ++i) {
      const Index from = order_[static_cast<std::size_t>(i)];
      Scalar sum = b(from) * Scalar(scale_(from));
      for (Index j = 0; j < i; ++j) sum -= times(factors_(i, j), x(j));
      x(i) = sum;
    }
    for (Index i = n; i-- > 0;) {
      Scalar sum = x(i);
      for (Index j = i + 1; j < n; ++j) sum -= times(factors_(i, j), x(j));
      x(i) = times(sum, inverse(factors_(i, i)));
    }
    return x;
  }

  Vector backward(const Vector &c) const {
    const Index n = c.size();
    Vector y = c;
    for (Index j = 0; j < n; ++j) {
      for (Index i = 0; i < j; ++i) y(j) -= times(factors_(i, j), y(i));
      y(j) = times(y(j), inverse(factors_(j, j)));
    }
    for (Index j = n; j-- > 0;)
      for (Index i = j + 1; i < n; ++i) y(j) -= times(factors_(i, j), y(i));
    Vector found(n);
    for (Index i = 0; i < n; ++i) {
      const Index to = order_[static_cast<std::size_t>(i)];
      found(to) = y(i) * Scalar(scale_(to));
    }
    return found;
  }

  Matrix matrix_, factors_;
  Eigen::Matrix<Extended, Eigen::Dynamic, 1> scale_;
  std::vector<Index> order_;  // row permutation of the LU factorization
  bool singular_ = false;
};

ExtendedMatrix balanced(const ExtendedMatrix &A) {
  const Eigen::VectorXd d = balance(A);
  ExtendedMatrix scaled = A;
  for (Index i = 0; i < A.rows(); ++i)
    for (Index j = 0; j < A.cols(); ++j) scaled(i, j) *= d(j) / d(i);
  return scaled;
}

void check_finite(const ExtendedMatrix &matrix) {
  for (Index i = 0; i < matrix.size(); ++i)
    if (!std::isfinite(matrix.data()[i])) throw std::invalid_argument("expected a finite matrix");
}

std::complex<double> rounded(Complex value) {
  return {static_cast<double>(value.real()), static_cast<double>(value.imag())};
}

}  // namespace

Eigen::VectorXd balance(const ExtendedMatrix &A) {
  const Index n = A.rows();
  Eigen::VectorXd d = Eigen::VectorXd::Ones(n);
  ExtendedMatrix work = A.cwiseAbs();
  constexpr int kSweeps = 100;
  bool moved = true;
  for (int sweep = 0; moved && sweep < kSweeps; ++sweep) {
    moved = false;
    for (Index i = 0; i < n; ++i) {
      const Extended column = work.col(i).sum() - work(i, i);
      const Extended row = work.row(i).sum() - work(i, i);
      if (!(column > 0) || !(row > 0) || !std::isfinite(column) || !std::isfinite(row)) continue;
      // Exponent of the power of 2 that is nearest to sqrt(row / column).
      const int exponent = static_cast<int>(std::lround(std::log2(row / column) / 2));
      const Extended factor = std::ldexp(Extended{1}, exponent);
      if (exponent == 0 || column * factor + row / factor >= 0.95L * (column + row)) continue;
      moved = true;
      d(i) *= static_cast<double>(factor);
      work.col(i) *= factor;
      work.row(i) /= factor;
    }
  }
  return d;
}

std::vector<std::complex<double>> eigenvalues(const ExtendedMatrix &A) {
  check_finite(A);
  if (A.rows() == 0) return {};
  // The eigenvalue iteration fails for a few matrices, but not for their transposes. A transpose
  // has the same eigenvalues.
  Eigen::EigenSolver<ExtendedMatrix> solver(balanced(A), false);
  if (solver.info() != Eigen::Success) solver.compute(balanced(A.transpose()), false);
  if (solver.info() != Eigen::Success)
    throw std::runtime_error("expected eigenvalues that converge");
  std::vector<std::complex<double>> values;
  for (const Complex value : solver.eigenvalues()) values.push_back(rounded(value));
  return values;
}

namespace {

// The eigenvectors of the balanced matrix whose eigenvalues are larger than `above`.
struct Eigenpairs {
  ComplexMatrix values;
  ComplexMatrix vectors;
};

std::optional<Eigenpairs> eigenpairs(const ExtendedMatrix &balanced, Extended above) {
  const Eigen::EigenSolver<ExtendedMatrix> solver(balanced, true);
  if (solver.info() != Eigen::Success) return std::nullopt;
  const auto &values = solver.eigenvalues();
  std::vector<Index> chosen;
  for (Index i = 0; i < values.size(); ++i)
    if (std::abs(values(i)) > above) chosen.push_back(i);
  const auto count = static_cast<Index>(chosen.size());
  const ComplexMatrix all = solver.eigenvectors();
  Eigenpairs pairs{ComplexMatrix(count, 1), ComplexMatrix(balanced.rows(), count)};
  for (Index i = 0; i < count; ++i) {
    pairs.values(i, 0) = values(chosen[static_cast<std::size_t>(i)]);
    pairs.vectors.col(i) = all.col(chosen[static_cast<std::size_t>(i)]);
  }
  return pairs;
}

// Returns the factors of balance(). A row of zeros does not limit the factor of its column, so this
// column gets the norm 1 at most.
Eigen::VectorXd balance_columns(const ExtendedMatrix &A) {
  Eigen::VectorXd d = balance(A);
  for (Index j = 0; j < A.rows(); ++j) {
    if (A.row(j).cwiseAbs().sum() > 0) continue;
    Extended sum = 0;
    for (Index i = 0; i < A.rows(); ++i) sum += std::abs(A(i, j)) / d(i);
    if (sum > 0) d(j) = static_cast<double>(1 / power_below(sum));
  }
  return d;
}

}  // namespace

FastModes fast_modes(const ExtendedMatrix &A, Extended above) {
  check_finite(A);
  const Index n = A.rows();
  FastModes none{ComplexMatrix(0, 1), ComplexMatrix(n, 0), ComplexMatrix(0, n), A,
                 ExtendedMatrix::Zero(n, n)};
  const Eigen::VectorXd d = balance_columns(A);
  const auto scale = d.cast<Extended>().asDiagonal();
  const auto unscale = d.cwiseInverse().cast<Extended>().asDiagonal();
  const ExtendedMatrix balanced = unscale * A * scale;
  const auto right = eigenpairs(balanced, above);
  const auto left = eigenpairs(balanced.transpose(), above);
  if (!right || !left || right->values.rows() != left->values.rows()) return none;
  if (right->values.rows() == 0) return none;
  // The left eigenvectors span the same space as the rows of the inverse that belongs to `right`.
  const ComplexMatrix overlap = left->vectors.transpose() * right->vectors;
  const ComplexMatrix rows = overlap.partialPivLu().solve(ComplexMatrix(left->vectors.transpose()));
  const ComplexMatrix moved = right->vectors * right->values.col(0).asDiagonal();
  const ExtendedMatrix residual = (balanced.cast<Complex>() * right->vectors - moved).cwiseAbs();
  const ExtendedMatrix error =
      residual * rows.cwiseAbs() +
      16 * std::numeric_limits<Extended>::epsilon() * (moved.cwiseAbs() * rows.cwiseAbs());
  // With a larger error, the separation of the fast modes has no benefit.
  constexpr Extended kMostError = 0x1p-40L;
  if (!(error.maxCoeff() <= kMostError * balanced.cwiseAbs().maxCoeff())) return none;

  std::vector<Index> chosen;
  for (Index i = 0; i < right->values.rows(); ++i)
    if (right->values(i, 0).imag() >= 0) chosen.push_back(i);
  const auto count = static_cast<Index>(chosen.size());
  FastModes modes{ComplexMatrix(count, 1), ComplexMatrix(n, count), ComplexMatrix(count, n),
                  A - ExtendedMatrix(scale * (moved * rows).real() * unscale),
                  scale * error * unscale};
  for (Index i = 0; i < count; ++i) {
    const Index from = chosen[static_cast<std::size_t>(i)];
    modes.values(i, 0) = right->values(from, 0);
    for (Index j = 0; j < n; ++j) {
      modes.right(j, i) = right->vectors(j, from) * Complex(d(j));
      modes.left(i, j) = rows(from, j) / Complex(d(j));
    }
  }
  return modes;
}

ExtendedMatrix solve(const ExtendedMatrix &A, const ExtendedMatrix &B) {
  const Factors<Extended> factors(A);
  ExtendedMatrix X(B.rows(), B.cols());
  if (factors.singular()) {
    X.setConstant(std::numeric_limits<Extended>::quiet_NaN());
    return X;
  }
  for (Index j = 0; j < B.cols(); ++j) X.col(j) = factors.solve(B.col(j));
  return X;
}

ExtendedMatrix sampled(const ExtendedMatrix &A, const ExtendedMatrix &B, double T) {
  check_finite(A);
  check_finite(B);
  const Index n = A.rows();
  const Index m = B.cols();
  ExtendedMatrix whole = ExtendedMatrix::Zero(n + m, n + m);
  const Eigen::VectorXd d = balance(A);
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < n; ++j) whole(i, j) = A(i, j) * d(j) / d(i) * T;
    for (Index j = 0; j < m; ++j) whole(i, n + j) = B(i, j) / d(i) * T;
  }
  // The Taylor series is computed for a fraction of the sample time for which |A| T is at most 1/2.
  // With this order, the series is accurate to the last digit.
  constexpr int kOrder = 18;
  Extended norm = 0;
  for (Index j = 0; j < n; ++j) norm = std::max(norm, whole.col(j).cwiseAbs().sum());
  const int doublings = norm > 0.5L ? std::ilogb(norm) + 2 : 0;
  whole *= std::ldexp(Extended{1}, -doublings);
  ExtendedMatrix less = whole / kOrder;  // Taylor series e^X - 1 = X (1 + X/2 (1 + X/3 (...)))
  for (int k = kOrder - 1; k >= 1; --k) less = (whole + whole * less) / k;
  for (int k = 0; k < doublings; ++k) less = (2 * less + less * less).eval();
  ExtendedMatrix found = less.topRows(n);
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < n + m; ++j) found(i, j) *= j < n ? d(i) / d(j) : d(i);
  return found;
}

Hessenberg hessenberg(const ExtendedMatrix &A, const ExtendedMatrix &B, const ExtendedMatrix &C) {
  if (A.rows() == 0) return {A.cast<double>(), B.cast<double>(), C.cast<double>()};
  const Eigen::HessenbergDecomposition<ExtendedMatrix> reduced(A);
  const ExtendedMatrix Q = reduced.matrixQ();
  return {ExtendedMatrix(reduced.matrixH()).cast<double>(), (Q.transpose() * B).cast<double>(),
          (C * Q).cast<double>()};
}

BoundaryResponse::BoundaryResponse(ExtendedMatrix A, ExtendedMatrix B, ExtendedMatrix C, double D,
                                   double dt)
    : A_(std::move(A)), B_(std::move(B)), C_(std::move(C)), D_(D), dt_(dt) {
  if (A_.rows() != A_.cols() || B_.rows() != A_.rows() || B_.cols() != 1 ||
      C_.cols() != A_.rows() || C_.rows() != 1)
    throw std::invalid_argument("expected one input and one output");
}

BoundaryResponse::Value BoundaryResponse::at(double w) const {
  const Index n = A_.rows();
  const Extended half = static_cast<Extended>(w) * dt_ / 2;
  const Complex below = inverse(Complex(1, -half));
  // The variable is p in continuous time and z - 1 in discrete time. The form z - 1 preserves the
  // accuracy of slow states.
  const Complex point = dt_ > 0 ? times(Complex(0, 2 * half), below) : Complex(0, w);
  const Extended one = dt_ > 0 ? 1 : 0;
  const Complex turn = dt_ > 0 ? times(times(below, below), Complex(0, dt_)) : Complex(0, 1);
  Factors<Complex>::Matrix matrix = -A_.cast<Complex>();
  for (Index i = 0; i < n; ++i) matrix(i, i) = point + (one - A_(i, i));
  const Factors<Complex> factors(std::move(matrix));
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  if (factors.singular()) return {{kInfinity, 0.0}, {kInfinity, 0.0}, kInfinity};
  const auto x = factors.solve(B_.col(0).cast<Complex>());
  const auto y = factors.solve_left(C_.row(0).transpose().cast<Complex>());
  Complex sum = D_;
  Complex slope = 0;
  Extended moved = std::abs(D_);
  for (Index i = 0; i < n; ++i) {
    sum += x(i) * C_(0, i);
    slope -= times(x(i), y(i));
    Extended flow = std::abs(B_(i, 0));
    for (Index j = 0; j < n; ++j) flow += std::abs(A_(i, j)) * size(x(j));
    moved += std::abs(C_(0, i)) * size(x(i)) + size(y(i)) * flow;
  }
  constexpr double kHalfUnit = std::numeric_limits<double>::epsilon() / 2;
  return {rounded(sum), rounded(times(slope, turn)), static_cast<double>(moved) * kHalfUnit};
}

}  // namespace forceaxis::sim
