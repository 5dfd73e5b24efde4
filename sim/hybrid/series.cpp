#include "sim/hybrid/series.hpp"

#include <algorithm>
#include <cmath>

namespace forceaxis::sim {

namespace {

// A matrix entry that is not 0, with its index in the row or column.
struct Factor {
  Eigen::Index place;
  Extended value;
};

// Computes the product for a matrix a with few entries, row by row.
ExtendedMatrix sparse_product(const ExtendedMatrix &a, const ExtendedMatrix &b) {
  ExtendedMatrix c(a.rows(), b.cols());
  std::vector<Factor> factors;
  for (Eigen::Index i = 0; i < a.rows(); ++i) {
    factors.clear();
    for (Eigen::Index k = 0; k < a.cols(); ++k)
      if (a(i, k) != 0) factors.push_back({k, a(i, k)});
    for (Eigen::Index j = 0; j < b.cols(); ++j) {
      const Extended *column = b.data() + j * b.rows();
      Extended sum = 0;
      for (const Factor &factor : factors) sum += factor.value * column[factor.place];
      c(i, j) = sum;
    }
  }
  return c;
}

}  // namespace

// Computes four rows together, so that their sums stay in registers. Otherwise the program would
// need most of its time to store sums in extended precision in the memory.
ExtendedMatrix product(const ExtendedMatrix &a, const ExtendedMatrix &b) {
  if (3 * (a.array() != 0).count() < a.size()) return sparse_product(a, b);
  ExtendedMatrix c(a.rows(), b.cols());
  std::vector<Factor> factors(static_cast<std::size_t>(a.cols()));
  for (Eigen::Index j = 0; j < b.cols(); ++j) {
    std::size_t count = 0;
    for (Eigen::Index k = 0; k < a.cols(); ++k)
      if (b(k, j) != 0) factors[count++] = {k * a.rows(), b(k, j)};
    Eigen::Index i = 0;
    for (; i + 4 <= a.rows(); i += 4) {
      Extended sum0 = 0, sum1 = 0, sum2 = 0, sum3 = 0;
      for (std::size_t n = 0; n < count; ++n) {
        const Extended *column = a.data() + factors[n].place + i;
        const Extended value = factors[n].value;
        sum0 += column[0] * value;
        sum1 += column[1] * value;
        sum2 += column[2] * value;
        sum3 += column[3] * value;
      }
      c(i, j) = sum0;
      c(i + 1, j) = sum1;
      c(i + 2, j) = sum2;
      c(i + 3, j) = sum3;
    }
    for (; i < a.rows(); ++i) {
      Extended sum = 0;
      for (std::size_t n = 0; n < count; ++n)
        sum += a.data()[factors[n].place + i] * factors[n].value;
      c(i, j) = sum;
    }
  }
  return c;
}

// This product uses the kernel, which computes the same doubles on every processor. The product of
// Eigen does not.
BoundMatrix product(const BoundMatrix &a, const BoundMatrix &b) {
  const kernel::Multiply multiply = kernel::best_multiply();
  const std::size_t stride = kernel::padded(static_cast<std::size_t>(a.rows()));
  const auto columns = static_cast<std::size_t>(a.cols());
  kernel::Vector left(stride * columns, 0.0);
  kernel::Vector column(stride);
  put_block(a, 0, stride, &left);
  BoundMatrix c(a.rows(), b.cols());
  for (Eigen::Index j = 0; j < b.cols(); ++j) {
    multiply(left.data(), stride, b.data() + j * b.rows(), columns, column.data());
    std::copy_n(column.data(), c.rows(), c.data() + j * c.rows());
  }
  return c;
}

Influence influence(const ExtendedMatrix &a) {
  // The matrix |a|^(2^k) is power * 2^exponent. The 2^k-th root of the norm of this matrix is an
  // upper bound of the spectral radius.
  constexpr int kSquarings = 8;
  BoundMatrix power = absolute(a);
  long exponent = 0;
  const auto normalize = [&](double size) {
    int bits = 0;
    std::frexp(size, &bits);
    power *= std::ldexp(1.0, -bits);
    exponent += bits;
  };
  for (int k = 0; k < kSquarings && power.maxCoeff() > 0; ++k) {
    normalize(power.maxCoeff());
    power = product(power, power);
    exponent *= 2;
  }
  Influence result;
  if (power.maxCoeff() > 0) {
    normalize(power.rowwise().sum().maxCoeff());
    constexpr long kRoot = 1L << kSquarings;
    const long whole = exponent >= 0 ? (exponent + kRoot - 1) / kRoot : -(-exponent / kRoot);
    result.rate = std::max(std::ldexp(2.0, static_cast<int>(whole)), 1.0);
  }
  // 2^7 terms are sufficient, because the norm of each term is at most half the norm of the
  // previous term, and no path through the states has more steps.
  BoundMatrix w = absolute(a) / result.rate;
  result.sum = BoundMatrix::Identity(a.rows(), a.cols()) + w;
  for (int k = 1; k < 7; ++k) {
    w = product(w, w);
    result.sum += product(result.sum, w);
  }
  return result;
}

int absolute_series(const ExtendedMatrix &a, std::size_t parts, const Influence &scale,
                    double accuracy, int most, BoundMatrix *sum) {
  const BoundMatrix size = absolute(a) / static_cast<double>(parts);
  const double step = scale.rate / static_cast<double>(parts);
  *sum = BoundMatrix::Identity(a.rows(), a.cols());
  BoundMatrix term = *sum;
  for (int k = 1; k <= most; ++k) {
    term = product(size, term) / static_cast<double>(k);
    *sum += term;
    // By |b| = step W, and because W times the influence is at most the influence, the terms
    // decrease fast. If term k is below e times the influence, term k + 1 is below e times the
    // influence times step / (k + 1), term k + 2 is below e times the influence times step^2 / ((k
    // + 1) (k + 2)), and so on.
    if (2 * step > static_cast<double>(k + 1)) continue;
    if ((term.array() <= accuracy * scale.sum.array()).all()) {
      *sum += accuracy * scale.sum;
      return k;
    }
  }
  return 0;
}

ExtendedMatrix series_less_one(const ExtendedMatrix &b, int terms) {
  ExtendedMatrix term = ExtendedMatrix::Identity(b.rows(), b.cols());
  std::vector<ExtendedMatrix> all;
  for (int k = 1; k <= terms; ++k) {
    term = product(b, term) / static_cast<Extended>(k);
    all.push_back(term);
  }
  // The terms are added from the smallest to the largest.
  ExtendedMatrix tail = ExtendedMatrix::Zero(b.rows(), b.cols());
  for (auto it = all.rbegin(); it != all.rend(); ++it) tail += *it;
  return tail;
}

ExtendedMatrix series(const ExtendedMatrix &b, int terms) {
  return ExtendedMatrix::Identity(b.rows(), b.cols()) + series_less_one(b, terms);
}

std::vector<ExtendedMatrix> changes(const ExtendedMatrix &a, std::size_t halvings, int terms) {
  std::vector<ExtendedMatrix> result(halvings + 1);
  const Extended share = std::ldexp(Extended{1}, -static_cast<int>(halvings));
  result[halvings] = series_less_one(a * share, terms);
  for (std::size_t k = halvings; k-- > 0;)
    result[k] = 2 * result[k + 1] + product(result[k + 1], result[k + 1]);
  return result;
}

void put_rows(const ExtendedMatrix &rows, std::vector<double> *out) {
  for (Eigen::Index i = 0; i < rows.rows(); ++i)
    for (Eigen::Index j = 0; j < rows.cols(); ++j) out->push_back(static_cast<double>(rows(i, j)));
}

}  // namespace forceaxis::sim
