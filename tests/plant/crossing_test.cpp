// First sign changes of polynomials, against roots known by construction and against sampling.
#include "sim/hybrid/crossing.hpp"

#include <cmath>
#include <random>
#include <vector>

#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

// Coefficients of scale * prod (1 - s / root).
std::vector<double> with_roots(double scale, const std::vector<double> &roots) {
  std::vector<long double> q = {scale};
  for (const double root : roots) {
    q.push_back(0);
    for (std::size_t k = q.size() - 1; k > 0; --k) q[k] -= q[k - 1] / root;
  }
  return {q.begin(), q.end()};
}

TEST(FirstCrossing, FindsTheFirstOfSeveral) {
  const auto q = with_roots(3.0, {0.25, 0.5, 0.75, 2.0});
  double root = 0.0;
  ASSERT_TRUE(first_crossing(q.data(), q.size() - 1, 1.0, &root));
  EXPECT_NEAR(root, 0.25, 1e-15);
  EXPECT_FALSE(first_crossing(q.data(), q.size() - 1, 0.2499999999, &root));
}

TEST(FirstCrossing, CloseRootsAndTouchingOnes) {
  for (const double gap : {1e-2, 1e-4, 1e-6}) {
    const auto q = with_roots(1.0, {0.3, 0.3 + gap, -5.0});
    double root = 0.0;
    ASSERT_TRUE(first_crossing(q.data(), q.size() - 1, 1.0, &root)) << gap;
    EXPECT_NEAR(root, 0.3, 1e-15 / gap + 1e-15);
  }
  const double touching[] = {1.0, -2.0 / 0.3, 1.0 / 0.09 * (1 + 1e-9)};
  double root = 0.0;
  EXPECT_FALSE(first_crossing(touching, 2, 1.0, &root));
}

TEST(FirstCrossing, RandomPolynomialsAgainstSamples) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  int found = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    double q[9];
    q[0] = std::fabs(uniform(random)) + 1e-3;
    for (int k = 1; k < 9; ++k) q[k] = 4.0 * uniform(random);
    const auto value = [&](double s) {
      double sum = 0.0;
      for (int k = 8; k >= 0; --k) sum = sum * s + q[k];
      return sum;
    };
    double root = 1.0;
    const bool crosses = first_crossing(q, 8, 1.0, &root);
    found += crosses ? 1 : 0;
    for (int i = 0; i <= 500; ++i) {
      const double s = root * (1 - 1e-12) * i / 500.0;
      ASSERT_GT(value(s), -1e-13) << "trial " << trial << " at " << s;
    }
    if (crosses) {
      ASSERT_NEAR(value(root), 0.0, 1e-13) << "trial " << trial;
    }
  }
  EXPECT_GT(found, 5000);
}

}  // namespace
}  // namespace forceaxis::sim::test
