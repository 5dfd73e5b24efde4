// Matrices whose numbers are far apart, against closed forms.
#include "sim/matrix/extended.hpp"

#include <algorithm>
#include <cmath>
#include <complex>

#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

using Complex = std::complex<double>;

ExtendedMatrix filled(int rows, int columns, std::initializer_list<double> values) {
  ExtendedMatrix matrix(rows, columns);
  auto value = values.begin();
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j) matrix(i, j) = *value++;
  return matrix;
}

void expect_near(Extended value, Extended expected, double share) {
  EXPECT_LT(std::abs(value - expected), share * std::abs(expected)) << static_cast<double>(value);
}

TEST(Extended, AHoldOfAnIntegratorIsExact) {
  const double T = 1.0 / 1500;
  const ExtendedMatrix step = sampled(filled(2, 2, {0, 1, 0, 0}), filled(2, 1, {0, 1}), T);
  EXPECT_EQ(step(0, 1), static_cast<Extended>(T));
  EXPECT_EQ(step(0, 0), 0);
  expect_near(step(0, 2), static_cast<Extended>(T) * T / 2, 1e-18);
  expect_near(step(1, 2), T, 1e-18);
}

TEST(Extended, AHoldOfASlowStateKeepsItsDigitsBesideAFastOne) {
  const double T = 1.0 / 1500;
  const ExtendedMatrix step = sampled(filled(2, 2, {-1e9, 0, 0, -1e-3}), filled(2, 1, {1, 1}), T);
  expect_near(step(0, 0), -1, 1e-18);
  expect_near(step(1, 1), std::expm1(-static_cast<Extended>(1e-3) * T), 1e-17);
  expect_near(step(1, 2), -std::expm1(-static_cast<Extended>(1e-3) * T) / 1e-3L, 1e-15);
}

TEST(Extended, ASolveIsRightInEachRow) {
  // Rows of 1e-15 to 1e15; the solution is (1, 2, 3).
  const ExtendedMatrix A = filled(3, 3, {1e15, -2e15, 3e15, 4e-15, 1e-15, 5e-15, 7, 3, -1});
  const ExtendedMatrix x = solve(A, A * filled(3, 1, {1, 2, 3}));
  for (int i = 0; i < 3; ++i) expect_near(x(i, 0), i + 1, 1e-17);
  EXPECT_TRUE(std::isnan(solve(filled(2, 2, {1, 2, 2, 4}), filled(2, 1, {1, 1}))(0, 0)));
}

TEST(Extended, EigenvaluesOfATriangleAreItsDiagonal) {
  const ExtendedMatrix A = filled(3, 3, {-1e11, 1e11, 3e10, 0, -7, 1e5, 0, 0, -0.25});
  auto values = eigenvalues(A);
  std::sort(values.begin(), values.end(), [](Complex a, Complex b) { return a.real() < b.real(); });
  expect_near(values[0].real(), -1e11, 1e-15);
  expect_near(values[1].real(), -7, 1e-9);
  expect_near(values[2].real(), -0.25, 1e-8);
  EXPECT_TRUE(eigenvalues(ExtendedMatrix(0, 0)).empty());
  EXPECT_THROW(eigenvalues(filled(1, 1, {NAN})), std::invalid_argument);
}

TEST(Extended, BalancingIsByPowersOfTwo) {
  const Eigen::VectorXd d = balance(filled(2, 2, {1, 1048576, 1.0 / 1048576, 1}));
  EXPECT_EQ(d(0) / d(1), 1048576.0);
}

TEST(BoundaryResponse, HasTheDigitsOfAFastAndASlowPole) {
  // 1e12 / ((s + 1)(s + 1e12)).
  const BoundaryResponse response(filled(2, 2, {-1, 1, 0, -1e12}), filled(2, 1, {0, 1e12}),
                                  filled(1, 2, {1, 0}), 0.0, 0.0);
  for (const double w : {0.0, 1e-3, 1.0, 1e6, 1e12, 1e15}) {
    const Complex s(0, w);
    const Complex expected = 1e12 / ((s + 1.0) * (s + 1e12));
    const auto value = response.at(w);
    EXPECT_LT(std::abs(value.response - expected), 1e-15 * std::abs(expected)) << w;
    const Complex slope = -Complex(0, 1) * expected * (1.0 / (s + 1.0) + 1.0 / (s + 1e12));
    EXPECT_LT(std::abs(value.slope - slope), 2e-15 * std::abs(slope)) << w;
    EXPECT_LT(value.rounding, 1e-14 * std::abs(expected)) << w;
  }
}

TEST(BoundaryResponse, IsInfiniteOnAPoleAndGoesAroundTheUnitCircle) {
  const double T = 1.0 / 1500;
  const BoundaryResponse sum(filled(1, 1, {1}), filled(1, 1, {1}), filled(1, 1, {1}), 0.0, T);
  EXPECT_TRUE(std::isinf(sum.at(0.0).response.real()));
  for (const double w : {1e-6, 1.0, 3000.0, 1e7}) {  // 1 / (z - 1) is 1/(j w T) - 1/2
    const Complex expected(-0.5, -1 / (w * T));
    const auto value = sum.at(w);
    EXPECT_LT(std::abs(value.response - expected), 1e-15 * std::abs(expected)) << w;
    EXPECT_NEAR(value.slope.imag(), 1 / (w * w * T), 1e-14 / (w * w * T)) << w;
  }
}

}  // namespace
}  // namespace forceaxis::sim::test
