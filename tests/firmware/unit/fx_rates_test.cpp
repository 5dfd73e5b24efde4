// Rates, times and ratios of fx.h against the same quotient in 128-bit integers. A second is 1500
// ticks.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>

#include "firmware/port/host/firmware.hpp"
#include "tests/firmware/unit/wide.hpp"

namespace {

constexpr uint64_t kSeed = 402;
constexpr int kFuzz = 200000;

TEST(FxRates, CountsPerSecondAsQ16PerTick) {
  const auto check = [](uint32_t x) {
    const Wide rate = x > FX_PER_S_MAX ? FX_PER_S_MAX : x;
    ASSERT_EQ(Wide{fx_q16_from_per_s(x)}, FloorDivide(rate * 65536, 1500)) << x;
  };
  EXPECT_EQ(fx_q16_from_per_s(0), 0);
  EXPECT_EQ(fx_q16_from_per_s(1500), 65536);
  EXPECT_EQ(fx_q16_from_per_s(3000), 131072);
  EXPECT_EQ(fx_q16_from_per_s(3072000), 1 << 27);
  EXPECT_EQ(fx_q16_from_per_s(1), 43);       // 43.69
  EXPECT_EQ(fx_q16_from_per_s(374), 16340);  // 16340.3
  // The largest one is the last that fits.
  EXPECT_LE(Wide{FX_PER_S_MAX} * 65536 / 1500, Wide{INT32_MAX});
  EXPECT_GT((Wide{FX_PER_S_MAX} + 1) * 65536 / 1500, Wide{INT32_MAX});
  EXPECT_EQ(fx_q16_from_per_s(UINT32_MAX), 2147483604) << "2^31 - 43.69";
  for (uint32_t x = 0; x < 3000; ++x) check(x);
  for (uint32_t d = 0; d < 800; ++d) check(FX_PER_S_MAX - 400 + d);
  for (uint32_t d = 0; d < 5; ++d) check(UINT32_MAX - d);
  RandomBits random(kSeed);
  for (int i = 0; i < kFuzz; ++i) check(random.U32());
}

TEST(FxRates, AccelerationsAsQ16PerTickSquared) {
  const auto check = [](uint32_t x) {
    ASSERT_EQ(Wide{fx_q16_from_per_s2(x)}, FloorDivide(Wide{x} * 65536, 2250000)) << x;
  };
  EXPECT_EQ(fx_q16_from_per_s2(2250000), 65536);
  EXPECT_EQ(fx_q16_from_per_s2(225000), 6553);  // a tenth: 6553.6
  for (uint32_t x = 0; x < 3000; ++x) check(x);
  for (uint32_t k = 1; k <= 7635; ++k) {
    for (uint32_t d = 0; d < 3; ++d) check(k * 140625 - 1 + d);
  }
  for (uint32_t d = 1; d < 5; ++d) check((1u << 30) - d);
  RandomBits random(kSeed);
  for (int i = 0; i < kFuzz; ++i) check(random.U32() >> 2);
}

TEST(FxRates, Q16PerTickAsCountsPerSecond) {
  const auto check = [](int32_t x) {
    // Half up: floor(1500 x / 2^16 + 1/2).
    ASSERT_EQ(Wide{fx_per_s_from_q16(x)}, FloorDivide(Wide{x} * 3000 + 65536, 131072)) << x;
  };
  EXPECT_EQ(fx_per_s_from_q16(65536), 1500);
  EXPECT_EQ(fx_per_s_from_q16(INT32_MAX), 49152000);
  EXPECT_EQ(fx_per_s_from_q16(INT32_MIN), -49152000);
  // Ties: 1500 x / 65536 = 375 x / 16384 is k + 1/2 for x = 8192 (2 j + 1).
  EXPECT_EQ(fx_per_s_from_q16(8192), 188);    // 187.5
  EXPECT_EQ(fx_per_s_from_q16(-8192), -187);  // -187.5
  EXPECT_EQ(fx_per_s_from_q16(24576), 563);   // 562.5
  for (int32_t x : Samples()) check(x);
  RandomBits random(kSeed);
  for (int i = 0; i < kFuzz; ++i) check(random.S32());
  // A written value reads back unchanged.
  for (uint32_t x = 0; x < 3000; ++x) {
    ASSERT_EQ(fx_per_s_from_q16(fx_q16_from_per_s(x)), static_cast<int32_t>(x));
  }
  for (int i = 0; i < kFuzz; ++i) {
    const uint32_t x = random.Below(FX_PER_S_MAX + 1);
    ASSERT_EQ(fx_per_s_from_q16(fx_q16_from_per_s(x)), static_cast<int32_t>(x));
    ASSERT_EQ(fx_per_s_from_q16(-fx_q16_from_per_s(x)), -static_cast<int32_t>(x));
  }
}

TEST(FxRates, CountsInTicksAsCountsPerSecond) {
  const auto check = [](int32_t x) {
    const Wide mean = FloorDivide(Wide{x} * 1500 + 8, 16);
    ASSERT_EQ(Wide{fx_per_s_from_16_ticks(x)}, Clamp(mean, INT32_MIN, INT32_MAX)) << x;
    ASSERT_EQ(Wide{fx_per_s_from_tick(x)}, Clamp(Wide{x} * 1500, INT32_MIN, INT32_MAX)) << x;
  };
  EXPECT_EQ(fx_per_s_from_16_ticks(1), 94);   // 93.75
  EXPECT_EQ(fx_per_s_from_16_ticks(2), 188);  // 187.5
  EXPECT_EQ(fx_per_s_from_16_ticks(-2), -187);
  EXPECT_EQ(fx_per_s_from_16_ticks(INT32_MAX), INT32_MAX);
  EXPECT_EQ(fx_per_s_from_16_ticks(INT32_MIN), INT32_MIN);
  EXPECT_EQ(fx_per_s_from_tick(-2), -3000);
  for (int32_t x : Samples()) check(x);
  for (int32_t d = -3; d <= 3; ++d) {
    for (int sign : {1, -1}) {
      check(sign * (22906492 + d));  // 2^31 x 16 / 1500
      check(sign * (1431655 + d));   // 2^31 / 1500
    }
  }
  RandomBits random(kSeed);
  for (int i = 0; i < kFuzz; ++i) check(random.S32());
}

TEST(FxRates, TimesRoundUpToTicks) {
  const auto check_ms = [](uint32_t ms) {
    ASSERT_EQ(Wide{fx_ticks_from_ms(ms)}, CeilDivide(Wide{ms} * 3, 2)) << ms;
  };
  for (uint32_t ms = 0; ms <= 65535; ++ms) check_ms(ms);
  for (uint32_t d = 0; d < 4; ++d) check_ms((1u << 31) - d);
  RandomBits random(kSeed);
  for (int i = 0; i < kFuzz; ++i) check_ms(random.U32() >> 1);
  EXPECT_EQ(fx_ticks_from_100us(50), 8u);      // 7.5
  EXPECT_EQ(fx_ticks_from_period(1, -3), 2u);  // 1.5
  EXPECT_EQ(fx_ticks_from_period(255, -6), 1u);
  for (uint32_t n = 0; n <= 65535; ++n) {
    ASSERT_EQ(Wide{fx_ticks_from_100us(static_cast<uint16_t>(n))}, CeilDivide(Wide{n} * 3, 20));
  }
  Wide per = 1;  // 10^-exponent
  for (int exponent = 0; exponent >= -6; --exponent, per *= 10) {
    for (int mantissa = 0; mantissa <= 255; ++mantissa) {
      ASSERT_EQ(
          Wide{fx_ticks_from_period(static_cast<uint8_t>(mantissa), static_cast<int8_t>(exponent))},
          CeilDivide(Wide{mantissa} * 1500, per))
          << mantissa << " " << exponent;
    }
  }
}

// The step that covers a distance in n ticks: at most a 1/n part, shorter by less than 2^-10 count,
// never above the bound; n of them cover the distance.
TEST(FxRates, PartsOfADistanceGetThere) {
  const auto check = [](uint64_t d, uint32_t n, int32_t most) {
    const Wide part = FloorDivide(d, n);
    const Wide step = fx_part_q16(d, n, most);
    if (part >= most) {
      ASSERT_EQ(step, most) << d << " " << n << " " << most;
      return;
    }
    ASSERT_LE(step, part) << d << " " << n << " " << most;
    ASSERT_LT(part - step, 64) << d << " " << n << " " << most;
    ASSERT_TRUE(step == part || (n > 1 && d > UINT32_MAX)) << d << " " << n << " " << most;
  };
  const uint64_t longest = FX_DISTANCE_MAX_Q16;
  RandomBits random(kSeed);
  for (uint64_t d : {uint64_t{0}, uint64_t{1}, uint64_t{UINT32_MAX} - 1, uint64_t{UINT32_MAX},
                     uint64_t{UINT32_MAX} + 1, longest - 1, longest}) {
    for (uint32_t n : {1u, 2u, 3u, 64u, 65u, 382500u}) {
      for (int32_t most : {1, 65536, 1 << 27, INT32_MAX}) check(d, n, most);
      // A bound that the step just meets, or just not.
      for (int32_t e = -1; e <= 1; ++e) {
        check(d, n, static_cast<int32_t>(Clamp(FloorDivide(d, n) + e, 1, INT32_MAX)));
      }
    }
  }
  for (int i = 0; i < kFuzz; ++i) {
    check(random.U64() & longest, 1 + random.Below(382500),
          static_cast<int32_t>(random.U32() >> 1) | 1);
  }
  for (int i = 0; i < 300; ++i) {
    const uint64_t whole = random.U64() & longest;
    uint64_t d = whole;
    for (uint32_t n = 1 + random.Below(300) + static_cast<uint32_t>(whole >> 30); n > 0; --n) {
      d -= static_cast<uint64_t>(fx_part_q16(d, n, INT32_MAX));
    }
    ASSERT_EQ(d, 0u) << whole;
  }
}

// a / b * 2^e to 32 significant bits, floor; the largest is just below 2^32.
void CheckRatio(uint32_t a, uint32_t b, int e) {
  const fx_ratio_t ratio = fx_ratio(a, b, static_cast<int8_t>(e));
  const auto scaled = [&](int shift) {  // floor(a / b * 2^(e + shift))
    const int up = e + shift;
    return up >= 0 ? FloorDivide(Wide{a} * TwoTo(static_cast<unsigned>(up)), b)
                   : FloorDivide(a, Wide{b} * TwoTo(static_cast<unsigned>(-up)));
  };
  if (scaled(0) >= TwoTo(32)) {
    ASSERT_EQ(ratio.mantissa, UINT32_MAX) << a << " " << b << " " << e;
    ASSERT_EQ(ratio.shift, 0);
    return;
  }
  ASSERT_GE(ratio.mantissa, 0x80000000u) << a << " " << b << " " << e;
  ASSERT_EQ(Wide{ratio.mantissa}, scaled(ratio.shift)) << a << " " << b << " " << e;
}

TEST(FxRates, RatiosHave32Bits) {
  for (uint32_t a :
       {1u, 2u, 3u, 65535u, 65536u, 0x7FFFFFFFu, 0x80000000u, 0x80000001u, UINT32_MAX}) {
    for (uint32_t b :
         {1u, 2u, 3u, 65535u, 65536u, 0x7FFFFFFFu, 0x80000000u, 0x80000001u, UINT32_MAX}) {
      for (int e = -16; e <= 16; ++e) CheckRatio(a, b, e);
    }
  }
  RandomBits random(kSeed);
  for (int i = 0; i < kFuzz; ++i) {
    CheckRatio(random.U32() | 1u, random.U32() | 1u, static_cast<int>(random.Below(33)) - 16);
  }
}

// Of 64 bits: the same where both fit in 32, and else to 2^-30 of it.
TEST(FxRates, RatiosOfWideNumbers) {
  RandomBits random(kSeed);
  for (int i = 0; i < kFuzz / 4; ++i) {
    const int e = static_cast<int>(random.Below(17)) - 8;
    const uint32_t a = random.U32() | 1u;
    const uint32_t b = random.U32() | 1u;
    const fx_ratio_t narrow = fx_ratio(a, b, static_cast<int8_t>(e));
    const fx_ratio_t same = fx_ratio_wide(a, b, static_cast<int8_t>(e));
    ASSERT_EQ(narrow.mantissa, same.mantissa);
    ASSERT_EQ(narrow.shift, same.shift);
    const uint64_t wide_a = (uint64_t{a} << 32 | random.U32()) >> random.Below(33);
    const uint64_t wide_b = (uint64_t{b} << 32 | random.U32()) >> random.Below(33);
    if (wide_a == 0 || wide_b == 0) continue;
    const fx_ratio_t ratio = fx_ratio_wide(wide_a, wide_b, static_cast<int8_t>(e));
    const double exact = std::ldexp(static_cast<double>(wide_a) / static_cast<double>(wide_b), e);
    const double found = std::ldexp(static_cast<double>(ratio.mantissa), -int{ratio.shift});
    if (exact >= 4294967295.0) {
      ASSERT_EQ(ratio.mantissa, UINT32_MAX);
      ASSERT_EQ(ratio.shift, 0);
    } else {
      ASSERT_NEAR(found / exact, 1.0, std::ldexp(1.0, -30)) << wide_a << " / " << wide_b;
    }
  }
}

void CheckApply(int32_t x, fx_ratio_t ratio, uint32_t n) {
  const unsigned shift = ratio.shift + n;
  const Wide product = Wide{x < 0 ? -Wide{x} : Wide{x}} * ratio.mantissa;
  // Half away from 0.
  const Wide size = Clamp((product * 2 / TwoTo(shift) + 1) / 2, 0, INT32_MAX);
  ASSERT_EQ(Wide{fx_ratio_apply(x, ratio, n)}, x < 0 ? -size : size)
      << x << " x " << ratio.mantissa << " / 2^" << int{ratio.shift} << " / 2^" << n;
}

TEST(FxRates, ARatioIsAppliedWithOneRounding) {
  for (int32_t x : Samples()) {
    for (uint32_t mantissa : {0u, 0x80000000u, 0x80000001u, 0xC0000000u, 0xFFFFFFFFu}) {
      for (unsigned shift = 0; shift <= 80; ++shift) {
        for (uint32_t n : {0u, 16u, 32u}) {
          CheckApply(x, {.mantissa = mantissa, .shift = static_cast<uint8_t>(shift)}, n);
        }
      }
    }
  }
  // Ties: 3 / 2 and 5 / 2 go away from 0, and so do their negatives.
  const fx_ratio_t half = fx_ratio(1, 2, 0);
  EXPECT_EQ(fx_ratio_apply(3, half, 0), 2);
  EXPECT_EQ(fx_ratio_apply(-3, half, 0), -2);
  EXPECT_EQ(fx_ratio_apply(5, half, 0), 3);
  EXPECT_EQ(fx_ratio_apply(-5, half, 0), -3);
  EXPECT_EQ(fx_ratio_apply(INT32_MIN, fx_ratio(1, 1, 0), 0), -INT32_MAX);
  EXPECT_EQ(fx_ratio_apply(INT32_MAX, fx_ratio(1, 1, 0), 0), INT32_MAX);
  RandomBits random(kSeed);
  for (int i = 0; i < kFuzz; ++i) {
    const fx_ratio_t ratio =
        fx_ratio(random.U32() | 1u, random.U32() | 1u, static_cast<int8_t>(random.Below(33)) - 16);
    CheckApply(random.S32(), ratio, random.Below(33));
  }
}

// Worked by hand; the first two are the force of a reading and back at the default scales.
TEST(FxRates, RatiosOfForces) {
  const struct {
    uint32_t a, b;
    int8_t e;
    int32_t x, value;
  } rows[] = {{100000, 2500000, 8, 1000, 10240},
              {2500000, 100000, -8, 10240, 1000},
              {1, 2147483647, -8, INT32_MAX, 0},
              {2147483647, 1, 8, 1, INT32_MAX},
              {1, 1, 0, -12345, -12345},
              {3, 1, 0, 7, 21},
              {1, 3, 0, 300000000, 100000000},
              {1, 2, 0, 3, 2},
              {1, 2, 0, -3, -2},
              {7, 5, 2, 100, 560}};
  for (const auto &row : rows) {
    EXPECT_EQ(fx_ratio_apply(row.x, fx_ratio(row.a, row.b, row.e), 0), row.value)
        << row.a << " / " << row.b;
  }
}

TEST(FxRates, PerMilleOfTheRangeOfAnAdc) {
  EXPECT_EQ(fx_per_mille_of_bits(128, 8), 500);
  EXPECT_EQ(fx_per_mille_of_bits(255, 8), 996);  // 996.09
  EXPECT_EQ(fx_per_mille_of_bits(65535, 16), 999);
  for (unsigned bits = 0; bits <= 16; ++bits) {
    for (unsigned code = 0; code <= 65535; ++code) {
      const Wide share = FloorDivide(Wide{code} * 1000, TwoTo(bits));
      ASSERT_EQ(Wide{fx_per_mille_of_bits(static_cast<uint16_t>(code), static_cast<uint8_t>(bits))},
                Clamp(share, 0, INT16_MAX))
          << code << " " << bits;
    }
  }
}

}  // namespace
