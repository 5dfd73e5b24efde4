// Exact conversion by a fraction, beside arithmetic in 128 bits.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <random>

#include "firmware/port/host/firmware.hpp"

namespace {

__extension__ using Wide = __int128;

Wide FloorDiv(Wide a, Wide b) {
  const Wide quotient = a / b;
  return quotient * b > a ? quotient - 1 : quotient;
}

// floor(x n / d + 1/2)
Wide Scaled(Wide x, Wide n, Wide d) { return FloorDiv(2 * x * n + d, 2 * d); }

Wide Product(const std::array<uint32_t, 3> &factors) {
  return Wide{factors[0]} * factors[1] * factors[2];
}

class Fraction : public ::testing::Test {
 protected:
  uint32_t Upto(uint32_t most) { return static_cast<uint32_t>(random_() % most) + 1; }
  int32_t Any(int bits) {
    return fx_floor_shift(fx_s32_from_u32(static_cast<uint32_t>(random_())),
                          static_cast<uint32_t>(32 - bits));
  }
  static void ExpectScaled(int32_t found, Wide exact, int32_t x) {
    const Wide sure = INT32_MAX - 4;
    if (exact <= sure && exact >= -sure) {
      ASSERT_EQ(found, static_cast<int32_t>(exact)) << x;
    } else {
      ASSERT_EQ(found, (x < 0) ? -INT32_MAX : INT32_MAX) << x;
    }
  }
  std::mt19937_64 random_{20261122};
};

// Also the saturation, whose last four values may be either.
TEST_F(Fraction, ConvertsExactlyBothWays) {
  int refused = 0;
  for (int i = 0; i < 20000; ++i) {
    const uint32_t most = (1u << (1 + i % 31)) - 1;
    const std::array<uint32_t, 3> over{Upto(most), Upto(1 + i % 7), Upto(1 + i % 97)};
    const std::array<uint32_t, 3> under{Upto(most), Upto(1 + i % 5), Upto(1 + i % 101)};
    Wide a = Product(over), b = Product(under);
    while (b != 0) {
      const Wide rest = a % b;
      a = b;
      b = rest;
    }
    const Wide n = Product(over) / a, d = Product(under) / a;
    fx_fraction_t fraction{};
    const bool fits = fx_fraction(over.data(), under.data(), &fraction);
    ASSERT_EQ(fits, n <= INT32_MAX && d <= INT32_MAX);
    if (!fits) {
      ++refused;
      ASSERT_EQ(fraction.num, 0u) << "unchanged";
      continue;
    }
    ASSERT_EQ(fraction.num, n);
    ASSERT_EQ(fraction.den, d);
    for (int k = 0; k < 20; ++k) {
      const int32_t x = k == 0 ? INT32_MIN : k == 1 ? INT32_MAX : Any(12 + k);
      ExpectScaled(fx_fraction_apply(x, &fraction), Scaled(x, n, d), x);
      ExpectScaled(fx_fraction_invert(x, &fraction), Scaled(x, d, n), x);
    }
  }
  EXPECT_GT(refused, 100);
}

// Half of a unit rounds up, on either side of 0.
TEST_F(Fraction, RoundsHalfUp) {
  const uint32_t over[3] = {1, 1, 1}, under[3] = {2, 1, 1};
  fx_fraction_t half{};
  ASSERT_TRUE(fx_fraction(over, under, &half));
  EXPECT_EQ(fx_fraction_apply(3, &half), 2);
  EXPECT_EQ(fx_fraction_apply(1, &half), 1);
  EXPECT_EQ(fx_fraction_apply(-1, &half), 0);
  EXPECT_EQ(fx_fraction_apply(-3, &half), -1);
  EXPECT_EQ(fx_fraction_invert(-3, &half), -6);
}

// Where a user's unit is at least a count, or at most, one way and back is where it began: nothing
// can add up, however often it is done.
TEST_F(Fraction, ThereAndBackIsTheSame) {
  for (int i = 0; i < 20000; ++i) {
    const uint32_t over[3] = {Upto(100000), 1, 1}, under[3] = {Upto(100000), 1, 1};
    fx_fraction_t fraction{};
    ASSERT_TRUE(fx_fraction(over, under, &fraction));
    const int32_t x = Any(14);
    if (fraction.num >= fraction.den) {
      ASSERT_EQ(fx_fraction_invert(fx_fraction_apply(x, &fraction), &fraction), x);
    } else {
      ASSERT_EQ(fx_fraction_apply(fx_fraction_invert(x, &fraction), &fraction), x);
    }
  }
}

TEST_F(Fraction, ARatioIsDividedAndJudged) {
  for (int i = 0; i < 2000; ++i) {
    const uint32_t a = Upto(1u << 20), b = Upto(1u << 20), by = Upto(3000000);
    const fx_ratio_t ratio = fx_ratio(a, b, 0);
    const double value = static_cast<double>(a) / b;
    const fx_ratio_t divided = fx_ratio_divided(ratio, by, 0);
    EXPECT_NEAR(divided.mantissa * std::exp2(-divided.shift) * by / value, 1.0, 1e-9);
    for (uint8_t bits = 0; bits <= 20; ++bits) {
      EXPECT_EQ(fx_ratio_is_moderate(ratio, bits),
                value >= std::exp2(-bits) && value < std::exp2(bits + 1))
          << a << ' ' << b;
    }
  }
}

}  // namespace
