#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <numbers>
#include <random>

#include "firmware/port/host/firmware.hpp"
#include "tests/firmware/unit/wide.hpp"

// The arithmetic of fx.h against the same operation in 128-bit integers: at both rails, one least
// significant bit beside them, at ties of the rounding and at random. Rates, times and ratios are
// in fx_rates_test.cpp, bytes in bytes_test.cpp; test_style.py sees that no function is left out.

namespace {

__extension__ typedef unsigned __int128 UnsignedWide;

constexpr uint32_t kSeed = 1988;
constexpr int kFuzz = 200000;

constexpr int64_t TwoTo32() { return int64_t{1} << 32; }

TEST(Fx, ReinterpretsBits) {
  EXPECT_EQ(fx_s32_from_u32(0), 0);
  EXPECT_EQ(fx_s32_from_u32(0x7FFFFFFFu), INT32_MAX);
  EXPECT_EQ(fx_s32_from_u32(0x80000000u), INT32_MIN);
  EXPECT_EQ(fx_s32_from_u32(0xFFFFFFFFu), -1);
}

TEST(Fx, DifferenceWraps) {
  EXPECT_EQ(fx_diff_wrap(INT32_MIN, INT32_MAX), 1);
  EXPECT_EQ(fx_diff_wrap(INT32_MAX, INT32_MIN), -1);
  EXPECT_EQ(fx_diff_wrap(INT32_MIN, 0), INT32_MIN);
  EXPECT_EQ(fx_diff_wrap(0, INT32_MIN), INT32_MIN);
  for (int32_t a : Samples()) {
    for (int32_t b : Samples()) {
      ASSERT_EQ(fx_diff_wrap(a, b), static_cast<int32_t>(Wrap(Wide{a} - b, 32))) << a << " " << b;
    }
  }
}

TEST(Fx, SumWraps) {
  EXPECT_EQ(fx_sum_wrap(INT32_MAX, 1), INT32_MIN);
  EXPECT_EQ(fx_sum_wrap(INT32_MIN, -1), INT32_MAX);
  EXPECT_EQ(fx_sum_wrap(INT32_MIN, INT32_MIN), 0);
  for (int32_t a : Samples()) {
    for (int32_t b : Samples()) {
      ASSERT_EQ(fx_sum_wrap(a, b), static_cast<int32_t>(Wrap(Wide{a} + b, 32))) << a << " " << b;
    }
  }
}

TEST(Fx, ClampsAndSaturates) {
  EXPECT_EQ(fx_saturate(int64_t{2048}, -2048, 2047), 2047);
  EXPECT_EQ(fx_saturate(int64_t{2047}, -2048, 2047), 2047);
  EXPECT_EQ(fx_saturate(int64_t{2046}, -2048, 2047), 2046);
  EXPECT_EQ(fx_saturate(int64_t{-2049}, -2048, 2047), -2048);
  EXPECT_EQ(fx_saturate(int64_t{-2048}, -2048, 2047), -2048);
  EXPECT_EQ(fx_saturate(int64_t{-2047}, -2048, 2047), -2047);
  EXPECT_EQ(fx_saturate(INT64_MAX, INT32_MIN, INT32_MAX), INT32_MAX);
  EXPECT_EQ(fx_saturate(INT64_MIN, INT32_MIN, INT32_MAX), INT32_MIN);
  EXPECT_EQ(fx_saturate(int64_t{INT32_MAX} + 1, INT32_MIN, INT32_MAX), INT32_MAX);
  EXPECT_EQ(fx_saturate(int64_t{INT32_MIN} - 1, INT32_MIN, INT32_MAX), INT32_MIN);
  for (int32_t a : Samples()) {
    for (int32_t b : Samples()) {
      const int32_t low = a < b ? a : b;
      const int32_t high = a < b ? b : a;
      for (int32_t x : {INT32_MIN, low, high, INT32_MAX, 0}) {
        ASSERT_EQ(Wide{fx_clamp(x, low, high)}, Clamp(x, low, high));
        for (int64_t wide : {int64_t{x}, int64_t{x} - 1, int64_t{x} + 1, int64_t{x} * 65536}) {
          ASSERT_EQ(Wide{fx_saturate(wide, low, high)}, Clamp(wide, low, high));
        }
      }
    }
  }
}

TEST(Fx, MagnitudeAndInterval) {
  EXPECT_EQ(fx_magnitude(INT32_MIN), 2147483648u);
  EXPECT_EQ(fx_magnitude(INT32_MAX), 2147483647u);
  EXPECT_EQ(fx_magnitude(-1), 1u);
  for (int32_t x : Samples()) {
    const Wide size = x < 0 ? -Wide{x} : Wide{x};
    ASSERT_EQ(fx_magnitude(x), static_cast<uint32_t>(size));
    for (int32_t limit : Samples()) {
      if (limit >= 0) {
        ASSERT_EQ(fx_within(x, limit), size <= limit) << x << " " << limit;
      }
    }
  }
}

TEST(Fx, ProductIsWide) {
  for (int32_t a : Samples()) {
    for (int32_t b : Samples()) {
      ASSERT_EQ(Wide{fx_mul(a, b)}, Wide{a} * Wide{b}) << a << " " << b;
    }
  }
}

TEST(Fx, ScaleIsExactInItsDomainAndWrapsOutside) {
  EXPECT_EQ(fx_scale(-255, 8), -65280);
  EXPECT_EQ(fx_scale(-2048, 16), -134217728);
  for (int32_t x : Samples()) {
    for (uint32_t n = 0; n <= 30; ++n) {
      ASSERT_EQ(fx_scale(x, n), static_cast<int32_t>(Wrap(Wide{x} * (Wide{1} << n), 32)));
    }
  }
}

TEST(Fx, FloorShift) {
  EXPECT_EQ(fx_floor_shift(-1, 31), -1);
  EXPECT_EQ(fx_floor_shift(-5, 1), -3);
  EXPECT_EQ(fx_floor_shift(INT32_MIN, 31), -1);
  for (int32_t x : Samples()) {
    for (uint32_t n = 0; n <= 31; ++n) {
      ASSERT_EQ(Wide{fx_floor_shift(x, n)}, FloorDivide(x, Wide{1} << n)) << x << " " << n;
    }
  }
}

TEST(Fx, RoundsHalfUp) {
  EXPECT_EQ(fx_round_q16(32767), 0);
  EXPECT_EQ(fx_round_q16(32768), 1);
  EXPECT_EQ(fx_round_q16(-32768), 0);
  EXPECT_EQ(fx_round_q16(-32769), -1);
  EXPECT_EQ(fx_round_q16(-98304), -1);
  EXPECT_EQ(fx_round_q16(INT32_MAX), 32768);
  EXPECT_EQ(fx_round_q16(INT32_MIN), -32768);
  std::mt19937 random(kSeed);
  for (int i = 0; i < kFuzz; ++i) {
    const auto x = static_cast<int32_t>(random());
    ASSERT_EQ(Wide{fx_round_q16(x)}, FloorDivide(Wide{x} + 32768, 65536)) << x;
  }
  for (int32_t x : Samples()) {
    ASSERT_EQ(Wide{fx_round_q16(x)}, FloorDivide(Wide{x} + 32768, 65536)) << x;
  }
}

TEST(Fx, FitsBits) {
  for (int bits = 0; bits <= 16; ++bits) {
    EXPECT_EQ(fx_highest_code(static_cast<uint8_t>(bits)), TwoTo(static_cast<unsigned>(bits)) - 1);
    for (int code = 0; code <= 65535; ++code) {
      ASSERT_EQ(fx_fits_bits(static_cast<uint16_t>(code), static_cast<uint8_t>(bits)),
                code < (1 << bits));
    }
  }
}

TEST(Fx, DecayReachesZeroExactlyAndNeverChangesSign) {
  EXPECT_EQ(fx_decay(0, 5), 0);
  EXPECT_EQ(fx_decay(1, 5), 0);
  EXPECT_EQ(fx_decay(-1, 5), 0);
  EXPECT_EQ(fx_decay(100, 0), 0);
  EXPECT_EQ(fx_decay(1000, 3), 875);
  EXPECT_EQ(fx_decay(-1000, 3), -875);
  EXPECT_EQ(fx_decay(INT32_MIN, 1), -1073741824);
  for (int32_t x : Samples()) {
    for (uint32_t n = 0; n <= 31; ++n) {
      const Wide size = x < 0 ? -Wide{x} : Wide{x};
      Wide step = FloorDivide(size, Wide{1} << n);
      if (step == 0) step = 1;
      const Wide left = size == 0 ? 0 : size - step;
      ASSERT_EQ(Wide{fx_decay(x, n)}, x < 0 ? -left : left) << x << " " << n;
    }
  }
}

TEST(Fx, MeansAddUpToTheChanges) {
  std::mt19937 random(5);
  for (const int64_t most : {3L, 1000L, 2147483647L}) {
    int16_t rest = 0;
    int64_t changes = 0, sum = 0;
    for (int i = 0; i < 2000; ++i) {
      const auto n = static_cast<int32_t>((most == INT32_MAX ? 2 : 1) + random() % 255);
      const auto drawn = static_cast<int64_t>(random() % static_cast<uint64_t>(2 * most + 1));
      const auto x = static_cast<int32_t>(drawn - most);
      changes += x;
      sum += static_cast<int64_t>(fx_mean(x, n, &rest)) * n;
      ASSERT_EQ(changes - sum, rest) << "step " << i;
      ASSERT_LT(std::abs(rest), n);
    }
  }
}

TEST(Fx, Q32Positions) {
  EXPECT_EQ(fx_cnt_from_q32(fx_q32_from_cnt(-7)), -7);
  EXPECT_EQ(fx_cnt_from_q32(fx_q32_advance(fx_q32_from_cnt(5), 32767)), 5);
  EXPECT_EQ(fx_cnt_from_q32(fx_q32_advance(fx_q32_from_cnt(5), 32768)), 6);
  EXPECT_EQ(fx_cnt_from_q32(fx_q32_advance(fx_q32_from_cnt(5), -32768)), 5);
  EXPECT_EQ(fx_cnt_from_q32(fx_q32_advance(fx_q32_from_cnt(5), -32769)), 4);
  EXPECT_EQ(fx_cnt_from_q32(fx_q32_advance(fx_q32_from_cnt(INT32_MAX), 65536)), INT32_MIN);
  for (int32_t x : Samples()) {
    for (int32_t v : Samples()) {
      // In units of 2^-16 count, wrapping at 2^48.
      const Wide sum = Wrap(Wide{x} * 65536 + v, 48);
      const Wide cnt = Wrap(FloorDivide(sum + 32768, 65536), 32);
      ASSERT_EQ(Wide{fx_cnt_from_q32(fx_q32_advance(fx_q32_from_cnt(x), v))}, cnt) << x << " " << v;
    }
  }
}

TEST(Fx, DistanceIsTheShorterWayRound) {
  bool negative = true;
  EXPECT_EQ(
      fx_distance_q16(fx_q32_from_cnt(INT32_MIN + 2), fx_q32_from_cnt(INT32_MAX - 1), &negative),
      4u * 65536u);
  EXPECT_FALSE(negative);
  EXPECT_EQ(fx_distance_q16(0, 0, &negative), 0u);
  EXPECT_FALSE(negative);
  for (int32_t to : Samples()) {
    for (int32_t from : Samples()) {
      for (int32_t part : {0, 1, 65535, -65535}) {
        const Wide way = Wrap((Wide{to} - from) * 65536 - part, 48);
        const Wide size = way < 0 ? -way : way;
        const Wide most = (Wide{1} << 37) - 1;
        const uint64_t got = fx_distance_q16(
            fx_q32_from_cnt(to), fx_q32_advance(fx_q32_from_cnt(from), part), &negative);
        ASSERT_EQ(Wide{got}, size > most ? most : size) << to << " " << from << " " << part;
        ASSERT_EQ(negative, way < 0);
      }
    }
  }
}

// The true stopping distance, summed tick by tick.
Wide StoppingWay(Wide v, Wide a) {
  const Wide n = v / a;
  return (n + 1) * v - a * n * (n + 1) / 2;
}

TEST(Fx, StopsWithinIsSafeAndNearlySharp) {
  std::mt19937_64 random(kSeed);
  const uint64_t longest = FX_DISTANCE_MAX_Q16;
  for (int i = 0; i < 200000; ++i) {
    const auto a = static_cast<int32_t>(1 + (random() % (1u << 24)) / (1u << (random() % 24)));
    const auto v = static_cast<int32_t>((random() % (1u << 28)) / (1u << (random() % 28)));
    const Wide way = StoppingWay(v, a);
    for (Wide d :
         {way - 1, way, way + a / 8 + 1, Wide{random() % (longest + 1)}, Wide{0}, Wide{longest}}) {
      if (d < 0 || d > Wide{longest}) continue;
      const bool stops = fx_stops_within(v, a, fx_stopping_room(a, static_cast<uint64_t>(d)));
      if (stops) {
        ASSERT_LE(way, d) << "v " << v << " a " << a;
      }
      if (d >= way + a / 8 + 1) {
        ASSERT_TRUE(stops) << "v " << v << " a " << a;
      }
    }
  }
}

TEST(Fx, StoppingRoomDoesNotOverflow) {
  const int32_t a = 1 << 24;
  const UnsignedWide product = UnsignedWide{8} * static_cast<uint32_t>(a) * FX_DISTANCE_MAX_Q16;
  EXPECT_EQ(UnsignedWide{fx_stopping_room(a, FX_DISTANCE_MAX_Q16)}, product);
}

// Within 6 / 32768 of the sine everywhere, 0 at 0, and odd about half a turn but for the rounding.
TEST(Fx, SineIsCloseEverywhere) {
  EXPECT_EQ(fx_sine_q15(0), 0);
  int32_t lowest = 0, highest = 0;
  const auto check = [&](uint32_t phase) {
    const int32_t sine = fx_sine_q15(phase);
    const double exact = 32768.0 * std::sin(2.0 * std::numbers::pi * phase / 4294967296.0);
    ASSERT_LE(std::abs(sine - exact), 6.0) << phase;
    ASSERT_LE(std::abs(sine), 32767) << phase;
    ASSERT_LE(std::abs(sine + fx_sine_q15(phase + 0x80000000u)), 3) << phase;
    lowest = std::min(lowest, sine);
    highest = std::max(highest, sine);
  };
  for (uint32_t i = 0; i < (1u << 18); ++i) check(i << 14);
  for (uint32_t quarter = 0; quarter < 4; ++quarter) {
    for (uint32_t d = 0; d < 8; ++d) check(quarter * 0x40000000u + d - 4);
  }
  RandomBits random(kSeed);
  for (int i = 0; i < kFuzz / 4; ++i) check(random.U32());
  EXPECT_GE(highest, 32762);
  EXPECT_LE(lowest, -32762);
}

TEST(Fx, FloorShiftOfWideNumbers) {
  EXPECT_EQ(fx_floor_shift_wide(-1, 31), -1);
  EXPECT_EQ(fx_floor_shift_wide(-5, 1), -3);
  RandomBits random(kSeed);
  const auto check = [](int64_t x) {
    for (uint32_t n = 1; n <= 31; ++n) {
      ASSERT_EQ(Wide{fx_floor_shift_wide(x, n)}, FloorDivide(x, TwoTo(n))) << x << " " << n;
    }
  };
  for (int64_t centre : {INT64_MIN, -TwoTo32(), int64_t{0}, TwoTo32() / 2, TwoTo32(), INT64_MAX}) {
    for (int64_t d = -2; d <= 2; ++d) {
      check(static_cast<int64_t>(Clamp(Wide{centre} + d, INT64_MIN, INT64_MAX)));
    }
  }
  for (int i = 0; i < kFuzz / 10; ++i) check(random.S64());
}

TEST(Fx, RoundingToTheStepsOfAConverter) {
  EXPECT_EQ(fx_step_mask(12), -65536);
  EXPECT_EQ(fx_step_mask(16), -4096);
  RandomBits random(kSeed);
  const auto check = [](int32_t x) {
    ASSERT_EQ(Wide{fx_code_from_q16(x)}, FloorDivide(Wide{x} + 32768, 65536)) << x;
    for (uint8_t bits = 12; bits <= 16; ++bits) {
      const Wide step = TwoTo(28u - bits);
      ASSERT_EQ(-Wide{fx_step_mask(bits)}, step);
      ASSERT_EQ(Wide{fx_round_to(x, fx_step_mask(bits))},
                FloorDivide(Wide{x} + step / 2, step) * step)
          << x << " " << int{bits};
    }
  };
  const int32_t most = INT32_MAX - 32768;
  for (int32_t centre : {-most + 2, -65536, -32768, -4096, 0, 2048, 32768, 65536, most - 2}) {
    for (int32_t d = -2; d <= 2; ++d) check(centre + d);
  }
  for (int i = 0; i < kFuzz; ++i)
    check(static_cast<int32_t>(Clamp(Wide{random.S32()}, Wide{-most}, Wide{most})));
}

TEST(Fx, QuotientsAndHalves) {
  EXPECT_EQ(fx_quotient(12288, 7), 1755u);
  EXPECT_EQ(fx_quotient(UINT32_MAX, 1), UINT32_MAX);
  RandomBits random(kSeed);
  for (int i = 0; i < kFuzz; ++i) {
    const uint32_t a = random.U32();
    const uint32_t b = random.U32() | 1u;
    ASSERT_EQ(Wide{fx_quotient(a, b)}, FloorDivide(a, b)) << a << " " << b;
  }
  for (uint32_t n = 0; n <= 131071; ++n) ASSERT_EQ(fx_half(n), n / 2);
  for (uint32_t x = 0; x <= 65535; ++x) {
    for (uint32_t n = 0, by = 1; n <= 15; ++n, by *= 2) {
      ASSERT_EQ(fx_halved(static_cast<uint16_t>(x), static_cast<uint8_t>(n)), x / by);
    }
  }
}

TEST(Fx, InterpolatesWithOneRounding) {
  RandomBits random(kSeed);
  const auto within = [&](int64_t bound) {
    return static_cast<int32_t>(Wrap(random.U64(), 63) % (bound + 1));
  };
  for (int i = 0; i < kFuzz; ++i) {
    const int64_t most = int64_t{1} << (i % 30);
    const int32_t x0 = within(most), x1 = within(most), y0 = within(1 << 30), y1 = within(most);
    if (x0 == x1) continue;
    const int64_t low = std::min(x0, x1), high = std::max(x0, x1);
    const auto x =
        static_cast<int32_t>(low + static_cast<int64_t>(random.U64() % (high - low + 1)));
    for (const int32_t at : {x, x0, x1}) {
      // Of a positive denominator.
      const Wide den = Wide{high} - low;
      const Wide num = (Wide{y1} - y0) * (Wide{at} - x0) * (x1 > x0 ? 1 : -1);
      ASSERT_EQ(fx_interpolate(x0, y0, x1, y1, at, FX_ROUND_DOWN),
                static_cast<int32_t>(y0 + FloorDivide(num, den)));
      ASSERT_EQ(fx_interpolate(x0, y0, x1, y1, at, FX_ROUND_UP),
                static_cast<int32_t>(y0 + CeilDivide(num, den)));
      ASSERT_EQ(fx_interpolate(x0, y0, x1, y1, at, FX_ROUND_HALF_UP),
                static_cast<int32_t>(y0 + FloorDivide(2 * num + den, 2 * den)))
          << x0 << " " << y0 << " " << x1 << " " << y1 << " " << at;
    }
  }
}

// Lines of up to 2^19-1 in x and 2^24-1 in y, the longest and steepest among them.
TEST(Fx, InterpolatesShortLinesAsLongOnes) {
  RandomBits random(kSeed);
  for (int i = 0; i < kFuzz; ++i) {
    const auto up_to = [&](int64_t most) {
      return static_cast<int32_t>(random.U64() %
                                  (i % 7 == 0 ? 1 + most : 1 + most % (1 << (i % 24))));
    };
    const int32_t length = (i % 5 == 0) ? 524287 : 1 + up_to(524286);
    const int32_t size = (i % 3 == 0) ? 16777215 : up_to(16777215);
    const int32_t x0 = up_to(1 << 30) - (1 << 30) + up_to(1 << 29);
    const int32_t y0 = (i % 2 == 0) ? -8388608 : 8388607, y1 = (i % 2 == 0) ? y0 + size : y0 - size;
    const auto part = static_cast<int32_t>(random.U64() % static_cast<uint64_t>(length + 1));
    for (const int32_t at : {0, 1, part, length - 1, length}) {
      ASSERT_EQ(fx_interpolate_short(x0, y0, x0 + length, y1, x0 + at),
                fx_interpolate(x0, y0, x0 + length, y1, x0 + at, FX_ROUND_HALF_UP))
          << y0 << " " << y1 << " " << length << " " << at;
    }
  }
}

TEST(Fx, AMeanIsRoundedHalfUp) {
  RandomBits random(kSeed);
  for (int i = 0; i < kFuzz; ++i) {
    const auto n = static_cast<int32_t>(1 + random.U64() % (i % 2 == 0 ? 9 : 16383));
    const int64_t most = std::min<int64_t>(i % 3 == 0 ? 50 : int64_t{n} << 17, INT32_MAX);
    const auto sum =
        static_cast<int64_t>(random.U64() % static_cast<uint64_t>(2 * most + 1)) - most;
    for (const int64_t at : {sum, most, -most})
      if (std::abs(at) <= int64_t{n} << 17) {
        ASSERT_EQ(fx_mean_half_up(static_cast<int32_t>(at), static_cast<uint32_t>(n)),
                  static_cast<int32_t>(FloorDivide(2 * at + n, 2 * n)))
            << at << " / " << n;
      }
  }
  EXPECT_EQ(fx_mean_half_up(-1, 2), 0);
  EXPECT_EQ(fx_mean_half_up(1, 2), 1);
}

}  // namespace
