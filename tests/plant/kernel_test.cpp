// Every variant of the product gives the doubles of the plain double loop.
#include "sim/hybrid/kernel.hpp"

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

TEST(Kernel, AllVariantsGiveTheDoublesOfThePlainLoop) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (std::size_t stride = 2; stride <= 70; stride += 2)
    for (const std::size_t columns : {1U, 2U, 8U, 17U}) {
      std::vector<double> m(stride * columns);
      std::vector<double> v(columns);
      for (double &value : m) value = uniform(random);
      for (double &value : v) value = uniform(random);
      std::vector<double> base(stride);
      std::vector<double> best(stride);
      kernel::multiply_base(m.data(), stride, v.data(), columns, base.data());
      kernel::best_multiply()(m.data(), stride, v.data(), columns, best.data());
      for (std::size_t i = 0; i < stride; ++i) {
        double sum = m[i] * v[0];
        for (std::size_t j = 1; j < columns; ++j) sum += m[j * stride + i] * v[j];
        ASSERT_EQ(base[i], sum) << stride << " x " << columns << ", row " << i;
        ASSERT_EQ(best[i], sum) << stride << " x " << columns << ", row " << i;
      }
    }
}

TEST(Kernel, InsideKeepsTheDistanceFromBothBounds) {
  const double a[] = {1.0, 0.0};
  const double b[] = {2.0, 0.0};
  const double dip[] = {0.5, 0.0};
  const double infinite = std::numeric_limits<double>::infinity();
  const auto inside = [&](double low, double high) {
    const double lows[] = {low, -infinite};
    const double highs[] = {high, infinite};
    return kernel::inside(a, b, dip, lows, highs, 2);
  };
  EXPECT_TRUE(inside(0.5, 2.5));
  EXPECT_FALSE(inside(0.6, 2.5));
  EXPECT_FALSE(inside(0.5, 2.4));
  EXPECT_TRUE(inside(-infinite, infinite));
  EXPECT_FALSE(inside(std::nan(""), infinite));
}

}  // namespace
}  // namespace forceaxis::sim::test
