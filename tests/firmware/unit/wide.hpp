#ifndef TESTS_UNIT_WIDE_HPP_
#define TESTS_UNIT_WIDE_HPP_

#include <cstdint>
#include <random>
#include <vector>

// Integers wide enough that nothing the firmware computes overflows in them, and numbers to try.

__extension__ typedef __int128 Wide;

inline Wide FloorDivide(Wide a, Wide b) {
  const Wide q = a / b;
  return (a % b != 0 && (a < 0) != (b < 0)) ? q - 1 : q;
}

inline Wide CeilDivide(Wide a, Wide b) { return -FloorDivide(-a, b); }

inline Wide TwoTo(unsigned n) { return Wide{1} << n; }

inline Wide Clamp(Wide x, Wide low, Wide high) { return x < low ? low : (x > high ? high : x); }

// The two's complement number of the low `bits` bits.
inline Wide Wrap(Wide x, unsigned bits) {
  Wide r = x % TwoTo(bits);
  if (r < 0) r += TwoTo(bits);
  return r >= TwoTo(bits - 1) ? r - TwoTo(bits) : r;
}

// Random bits of a random width, so that small numbers come up as often as large ones.
class RandomBits {
 public:
  explicit RandomBits(uint64_t seed) : random_(seed) {}
  uint64_t U64() { return random_() >> (random_() % 64); }
  uint32_t U32() { return static_cast<uint32_t>(random_()) >> (random_() % 32); }
  int32_t S32() {
    return static_cast<int32_t>(Wrap(random_() % 2 != 0 ? -Wide{U32()} : U32(), 32));
  }
  int64_t S64() { return static_cast<int64_t>(random_() % 2 != 0 ? ~U64() : U64() >> 1); }
  uint32_t Below(uint32_t bound) { return static_cast<uint32_t>(random_() % bound); }

 private:
  std::mt19937_64 random_;
};

// Both rails of 32 bits, powers of two and what lies beside them, and random ones.
inline std::vector<int32_t> Samples() {
  std::vector<int32_t> values;
  for (int64_t centre : {int64_t{INT32_MIN}, int64_t{-65536}, int64_t{-32768}, int64_t{0},
                         int64_t{32767}, int64_t{32768}, int64_t{65536}, int64_t{INT32_MAX}}) {
    for (int64_t d = -2; d <= 2; ++d) {
      const int64_t v = centre + d;
      if (v >= INT32_MIN && v <= INT32_MAX) values.push_back(static_cast<int32_t>(v));
    }
  }
  RandomBits random(1988);
  for (int i = 0; i < 300; ++i) values.push_back(random.S32());
  return values;
}

#endif
