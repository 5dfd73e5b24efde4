#include <gtest/gtest.h>

#include <array>
#include <random>
#include <vector>

#include "firmware/port/host/firmware.hpp"

// Every function against the same operation in 128-bit integers, at both rails, one least
// significant bit beside them and at random.

namespace {

__extension__ typedef __int128 Wide;
__extension__ typedef unsigned __int128 UnsignedWide;

constexpr uint32_t kSeed = 1988;
constexpr int kFuzz = 20000;

Wide FloorDivide(Wide a, Wide b) {
  const Wide q = a / b;
  return (a % b != 0 && a < 0) ? q - 1 : q;
}

Wide Wrap(Wide x, int bits) {
  const Wide modulus = Wide{1} << bits;
  Wide r = x % modulus;
  if (r < 0) r += modulus;
  return r >= modulus / 2 ? r - modulus : r;
}

std::vector<int32_t> Samples() {
  std::vector<int32_t> values;
  for (int64_t centre : {int64_t{INT32_MIN}, int64_t{-65536}, int64_t{-32768}, int64_t{0},
                         int64_t{32767}, int64_t{32768}, int64_t{65536}, int64_t{INT32_MAX}}) {
    for (int64_t d = -2; d <= 2; ++d) {
      const int64_t v = centre + d;
      if (v >= INT32_MIN && v <= INT32_MAX) values.push_back(static_cast<int32_t>(v));
    }
  }
  std::mt19937 random(kSeed);
  for (int i = 0; i < 300; ++i) {
    // A random width, so that small numbers come up as often as large ones.
    const auto bits = static_cast<int32_t>(random());
    values.push_back(bits / (1 << (random() % 31)));
  }
  return values;
}

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
        const int32_t expected = x < low ? low : (x > high ? high : x);
        ASSERT_EQ(fx_clamp(x, low, high), expected);
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
  for (int bits = 8; bits <= 16; ++bits) {
    for (int code : {0, 1, 254, 255, 256, 257, 4095, 4096, 32767, 32768, 65534, 65535}) {
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

// The real way to a stop, speed by speed.
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

TEST(Fx, LittleEndianBytes) {
  std::array<uint8_t, 6> bytes{0xEE, 0, 0, 0, 0, 0xEE};
  fx_store_le(&bytes[1], 0x89ABCDEFu, 4);
  EXPECT_EQ(bytes, (std::array<uint8_t, 6>{0xEE, 0xEF, 0xCD, 0xAB, 0x89, 0xEE}));
  EXPECT_EQ(fx_load_le(&bytes[1], 4), 0x89ABCDEFu);
  EXPECT_EQ(fx_load_le(&bytes[1], 2), 0xCDEFu);
  EXPECT_EQ(fx_load_le(&bytes[1], 1), 0xEFu);
  fx_store_le(&bytes[1], 0x11223344u, 2);
  EXPECT_EQ(bytes, (std::array<uint8_t, 6>{0xEE, 0x44, 0x33, 0xAB, 0x89, 0xEE}));
  EXPECT_EQ(fx_sign_extend(0xCDEFu, 16), -12817);
  EXPECT_EQ(fx_sign_extend(0x80u, 8), -128);
  EXPECT_EQ(fx_sign_extend(0x7Fu, 8), 127);
  EXPECT_EQ(fx_sign_extend(0xFFFFFFFFu, 32), -1);
  EXPECT_EQ(fx_quotient(12288, 7), 1755u);
  EXPECT_EQ(fx_quotient(UINT32_MAX, 1), UINT32_MAX);
}

}  // namespace
