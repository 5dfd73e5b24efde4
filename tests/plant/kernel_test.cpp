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
  for (std::size_t stride = 4; stride <= 72; stride += 4)
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

// Two samples of three channels (and padding), by plain loops.
TEST(Kernel, TheQuietTestIsProductBoundAndComparison) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  constexpr std::size_t kColumns = 5;
  constexpr std::size_t kFirst = 8;
  constexpr std::size_t kStride = 4;
  constexpr std::size_t kSamples = 2;
  constexpr std::size_t kChannels = 3;
  constexpr std::size_t kRows = kFirst + (kSamples + 1) * kStride;
  int quiet = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    std::vector<double> tick(kRows * kColumns);
    std::vector<double> curve(kSamples * kStride * kColumns);
    std::vector<double> low(kStride, -std::numeric_limits<double>::infinity());
    std::vector<double> high(kStride, std::numeric_limits<double>::infinity());
    std::vector<double> z(kColumns);
    for (double &value : tick) value = uniform(random);
    for (double &value : curve) value = 0.1 * std::fabs(uniform(random));
    for (double &value : z) value = uniform(random);
    for (std::size_t i = 0; i < kChannels; ++i) {
      low[i] = -1.5 + 0.5 * uniform(random);
      high[i] = 1.5 + 0.5 * uniform(random);
    }
    const kernel::QuietTest test{tick.data(), kRows,  curve.data(), kSamples * kStride, low.data(),
                                 high.data(), kFirst, kStride,      kSamples,           kColumns};
    std::vector<double> at(kRows);
    std::vector<double> dip(kSamples * kStride);
    for (std::size_t i = 0; i < kRows; ++i)
      for (std::size_t j = 0; j < kColumns; ++j) at[i] += tick[j * kRows + i] * z[j];
    for (std::size_t i = 0; i < dip.size(); ++i)
      for (std::size_t j = 0; j < kColumns; ++j)
        dip[i] += curve[j * dip.size() + i] * std::fabs(z[j]);
    bool expected = true;
    for (std::size_t k = 0; k < kSamples; ++k)
      for (std::size_t i = 0; i < kChannels; ++i)
        expected = expected &&
                   kernel::inside(at[kFirst + k * kStride + i], at[kFirst + (k + 1) * kStride + i],
                                  dip[k * kStride + i], low[i], high[i]);
    quiet += expected ? 1 : 0;
    for (const kernel::Quiet variant : {kernel::quiet_base, kernel::best_quiet()}) {
      std::vector<double> result(kRows);
      std::vector<double> curved(dip.size());
      ASSERT_EQ(variant(test, z.data(), result.data(), curved.data()), expected);
      ASSERT_EQ(result, at);
      ASSERT_EQ(curved, dip);
    }
  }
  EXPECT_GT(quiet, 500);
  EXPECT_LT(quiet, 1500);
}

TEST(Kernel, InsideKeepsTheDistanceFromBothBounds) {
  const double infinite = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(kernel::inside(1.0, 2.0, 0.5, 0.5, 2.5));
  EXPECT_TRUE(kernel::inside(2.0, 1.0, 0.5, 0.5, 2.5));
  EXPECT_FALSE(kernel::inside(1.0, 2.0, 0.5, 0.6, 2.5));
  EXPECT_FALSE(kernel::inside(1.0, 2.0, 0.5, 0.5, 2.4));
  EXPECT_TRUE(kernel::inside(1.0, 2.0, 0.5, -infinite, infinite));
  EXPECT_FALSE(kernel::inside(std::nan(""), 2.0, 0.5, -infinite, infinite));
  EXPECT_FALSE(kernel::inside(1.0, std::nan(""), 0.5, -infinite, infinite));
  EXPECT_FALSE(kernel::inside(1.0, 2.0, std::nan(""), -infinite, infinite));
}

}  // namespace
}  // namespace forceaxis::sim::test
