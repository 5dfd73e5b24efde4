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

struct QuietShape {
  std::size_t first, channels, samples, columns;
};

class QuietKernel : public testing::TestWithParam<QuietShape> {};

TEST_P(QuietKernel, IsProductBoundAndComparisonByPlainLoops) {
  const auto [first, channels, samples, columns] = GetParam();
  const std::size_t stride = kernel::padded(channels);
  const std::size_t rows = first + (samples + 1) * stride;
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const double room = static_cast<double>(columns) / 4;
  int quiet = 0;
  for (int trial = 0; trial < 1000; ++trial) {
    std::vector<double> tick(rows * columns);
    std::vector<double> curve(samples * stride * columns);
    std::vector<double> low(stride, -std::numeric_limits<double>::infinity());
    std::vector<double> high(stride, std::numeric_limits<double>::infinity());
    std::vector<double> z(columns);
    for (double &value : tick) value = uniform(random);
    for (double &value : curve) value = 0.1 * std::fabs(uniform(random));
    for (double &value : z) value = uniform(random);
    for (std::size_t i = 0; i < channels; ++i) {
      low[i] = -room * (1.5 + uniform(random));
      high[i] = room * (1.5 + uniform(random));
    }
    const kernel::QuietTest test{tick.data(), rows,  curve.data(), samples * stride, low.data(),
                                 high.data(), first, stride,       samples,          columns};
    std::vector<double> at(rows);
    std::vector<double> dip(samples * stride);
    for (std::size_t i = 0; i < rows; ++i)
      for (std::size_t j = 0; j < columns; ++j) at[i] += tick[j * rows + i] * z[j];
    for (std::size_t i = 0; i < dip.size(); ++i)
      for (std::size_t j = 0; j < columns; ++j)
        dip[i] += curve[j * dip.size() + i] * std::fabs(z[j]);
    bool expected = true;
    for (std::size_t k = 0; k < samples; ++k)
      for (std::size_t i = 0; i < channels; ++i)
        expected =
            expected && kernel::inside(at[first + k * stride + i], at[first + (k + 1) * stride + i],
                                       dip[k * stride + i], low[i], high[i]);
    quiet += expected ? 1 : 0;
    for (const kernel::Quiet variant : {kernel::quiet_base, kernel::best_quiet()}) {
      std::vector<double> result(rows);
      std::vector<double> curved(dip.size());
      ASSERT_EQ(variant(test, z.data(), result.data(), curved.data()), expected);
      ASSERT_EQ(result, at);
      ASSERT_EQ(curved, dip);
      // What is no number is not quiet.
      std::vector<double> broken = z;
      broken[columns - 1] = std::nan("");
      ASSERT_FALSE(variant(test, broken.data(), result.data(), curved.data()));
    }
  }
  EXPECT_GT(quiet, 10);
  EXPECT_LT(quiet, 990);
}

// The first four have code of their own in the wide variant.
INSTANTIATE_TEST_SUITE_P(All, QuietKernel,
                         testing::Values(QuietShape{4, 1, 1, 4}, QuietShape{8, 3, 1, 8},
                                         QuietShape{12, 4, 1, 11}, QuietShape{16, 2, 1, 16},
                                         QuietShape{8, 3, 2, 7}, QuietShape{20, 4, 1, 18},
                                         QuietShape{8, 5, 1, 8}, QuietShape{36, 9, 3, 34}));

TEST(Kernel, TheGridTestMarksThePartsThatAreNotInside) {
  std::mt19937 random(9);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (const std::size_t parts : {8U, 16U, 64U})
    for (int trial = 0; trial < 300; ++trial) {
      constexpr std::size_t kColumns = 5;
      const std::size_t ends = kernel::padded(parts + 1);
      std::vector<double> m(ends * kColumns);
      std::vector<double> d(parts * kColumns);
      std::vector<double> z(kColumns);
      for (double &value : m) value = uniform(random);
      for (double &value : d) value = 0.1 * std::fabs(uniform(random));
      for (double &value : z) value = uniform(random);
      const kernel::GridTest test{m.data(), d.data(), parts, kColumns, -1.0, 1.2};
      std::vector<double> at(ends);
      std::vector<double> dip(parts);
      for (std::size_t i = 0; i < ends; ++i)
        for (std::size_t j = 0; j < kColumns; ++j) at[i] += m[j * ends + i] * z[j];
      for (std::size_t i = 0; i < parts; ++i)
        for (std::size_t j = 0; j < kColumns; ++j) dip[i] += d[j * parts + i] * std::fabs(z[j]);
      std::uint64_t expected = 0;
      for (std::size_t k = 0; k < parts; ++k)
        if (!kernel::inside(at[k], at[k + 1], dip[k], -1.0, 1.2)) expected |= std::uint64_t{1} << k;
      for (const kernel::Grid variant : {kernel::grid_base, kernel::best_grid()}) {
        std::vector<double> signal(ends);
        std::vector<double> room(parts);
        ASSERT_EQ(variant(test, z.data(), signal.data(), room.data()), expected);
      }
    }
}

// The bounds by their definition, in the order of the columns.
TEST(Kernel, TheSecondTestIsItsDefinition) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  int calm = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const std::size_t states = 1 + static_cast<std::size_t>(trial) % 9;
    const std::size_t columns = states + 2;
    const std::size_t stride = trial % 2 == 0 ? 4 : 8;
    const std::size_t samples = 1 + static_cast<std::size_t>(trial) % 3;
    const std::size_t first = kernel::padded(states);
    const std::size_t tail_rows = samples * stride;
    const std::size_t head_rows = first + tail_rows;
    kernel::Vector head(head_rows * columns), tail(tail_rows * states), doubt(tail_rows);
    std::vector<double> z(columns), signal((samples + 1) * stride), low(stride), high(stride);
    for (double &value : head) value = 0.1 * uniform(random);
    for (double &value : tail) value = 0.1 * std::fabs(uniform(random));
    for (double &value : doubt) value = 0.01 * std::fabs(uniform(random));
    for (double &value : z) value = uniform(random);
    for (double &value : signal) value = 0.5 * uniform(random);
    for (double &value : low) value = -0.6 - std::fabs(uniform(random));
    for (double &value : high) value = 0.6 + std::fabs(uniform(random));
    const kernel::CalmTest test{head.data(),  head_rows,  tail.data(), tail_rows,
                                doubt.data(), low.data(), high.data(), first,
                                stride,       samples,    columns,     states};
    double largest = 0.0;
    for (const double value : z) largest = std::max(largest, std::fabs(value));
    std::vector<double> at(head_rows), dip(tail_rows);
    for (std::size_t i = 0; i < head_rows; ++i)
      for (std::size_t j = 0; j < columns; ++j) at[i] += head[j * head_rows + i] * z[j];
    bool expected = true;
    for (std::size_t i = 0; i < tail_rows; ++i) {
      for (std::size_t j = 0; j < states; ++j) dip[i] += tail[j * tail_rows + i] * std::fabs(at[j]);
      dip[i] += std::fabs(at[first + i]) + doubt[i] * largest;
      expected = expected && kernel::inside(signal[i], signal[i + stride], dip[i], low[i % stride],
                                            high[i % stride]);
    }
    calm += expected ? 1 : 0;
    for (const kernel::Calm variant : {kernel::calm_base, kernel::best_calm()}) {
      std::vector<double> product(head_rows), bound(tail_rows);
      ASSERT_EQ(variant(test, z.data(), signal.data(), product.data(), bound.data()), expected);
      ASSERT_EQ(product, at);
      ASSERT_EQ(bound, dip);
      std::vector<double> broken = z;
      broken[columns - 1] = std::nan("");
      ASSERT_FALSE(variant(test, broken.data(), signal.data(), product.data(), bound.data()));
    }
  }
  EXPECT_GT(calm, 100);
  EXPECT_LT(calm, 380);
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
