// Bytes, bits, fields and check sums: what lies where, against the value put together byte by byte
// in the test. Bytes beside a place are guards and must stay.

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/firmware/unit/wide.hpp"
#include "tests/support/frames.hpp"

namespace {

constexpr uint64_t kSeed = 8005;
constexpr int kFuzz = 100000;
constexpr uint8_t kGuard = 0xEE;

TEST(FxBytes, LittleEndianNumbers) {
  RandomBits random(kSeed);
  for (int i = 0; i < kFuzz; ++i) {
    const uint32_t value = i == 0 ? 0x89ABCDEFu : random.U32();
    const Bytes expected = LittleEndian(value, 4);
    for (uint8_t count : {1, 2, 4}) {
      std::array<uint8_t, 6> bytes;
      bytes.fill(kGuard);
      fx_store_le(&bytes[1], value, count);
      for (size_t k = 0; k < bytes.size(); ++k) {
        const bool stored = k >= 1 && k <= count;
        ASSERT_EQ(bytes[k], stored ? expected[k - 1] : kGuard) << value << " " << int{count};
      }
      ASSERT_EQ(fx_load_le(&bytes[1], count), value & (UINT32_MAX >> (32 - 8 * count)));
    }
    ASSERT_EQ(fx_load_le32(expected.data()), value);
  }
}

TEST(FxBytes, CopiesAreExactlyAsLong) {
  const std::array<uint8_t, 5> from{0x11, 0x22, 0x33, 0x44, 0x55};
  std::array<uint8_t, 6> to;
  to.fill(kGuard);
  fx_copy_2(&to[1], &from[1]);
  EXPECT_EQ(to, (std::array<uint8_t, 6>{kGuard, 0x22, 0x33, kGuard, kGuard, kGuard}));
  fx_copy_4(&to[1], &from[1]);
  EXPECT_EQ(to, (std::array<uint8_t, 6>{kGuard, 0x22, 0x33, 0x44, 0x55, kGuard}));
  // A place may overlap its source: all is read before anything is written.
  to = {1, 2, 3, 4, 5, 6};
  fx_copy_4(&to[1], &to[0]);
  EXPECT_EQ(to, (std::array<uint8_t, 6>{1, 1, 2, 3, 4, 6}));
}

TEST(FxBytes, SignsAreExtended) {
  EXPECT_EQ(fx_sign_extend(0xCDEFu, 16), -12817);
  EXPECT_EQ(fx_sign_extend(1, 1), -1);
  RandomBits random(kSeed);
  for (unsigned bits = 1; bits <= 32; ++bits) {
    const uint32_t mask = UINT32_MAX >> (32 - bits);
    const uint32_t sign = 1u << (bits - 1);
    const auto check = [&](uint32_t value) {
      ASSERT_EQ(Wide{fx_sign_extend(value & mask, static_cast<uint8_t>(bits))},
                Wrap(value & mask, bits))
          << value << " " << bits;
    };
    for (uint32_t value : {0u, 1u, sign - 1, sign, sign + 1, mask}) check(value);
    for (int i = 0; i < 3000; ++i) check(random.U32());
  }
}

TEST(FxBytes, BigEndianRegisters) {
  for (uint32_t value = 0; value <= 65535; ++value) {
    std::array<uint8_t, 4> bytes{kGuard, 0, 0, kGuard};
    fx_store_be16(&bytes[1], static_cast<uint16_t>(value));
    ASSERT_EQ(bytes, (std::array<uint8_t, 4>{kGuard, static_cast<uint8_t>(value / 256),
                                             static_cast<uint8_t>(value % 256), kGuard}));
    ASSERT_EQ(fx_load_be16(&bytes[1]), value);
  }
}

// The check values of the catalogue of CRCs, those of "123456789": 4B37h and CBF43926h.
TEST(FxBytes, CheckSums) {
  const Bytes nine{'1', '2', '3', '4', '5', '6', '7', '8', '9'};
  const auto modbus = [](const Bytes &bytes) {
    uint16_t crc = 0xFFFF;
    for (uint8_t byte : bytes) crc = fx_crc16_modbus(crc, byte);
    return crc;
  };
  const auto ethernet = [](const Bytes &bytes) {
    uint32_t crc = UINT32_MAX;
    for (uint8_t byte : bytes) crc = fx_crc32(crc, byte);
    return ~crc;
  };
  EXPECT_EQ(modbus(nine), 0x4B37);
  EXPECT_EQ(ethernet(nine), 0xCBF43926u);
  EXPECT_EQ(ethernet({}), 0u);
  uint32_t crc = fx_crc32_word(UINT32_MAX, 0x34333231);  // "1234", "5678"
  crc = fx_crc32_word(crc, 0x38373635);
  EXPECT_EQ(~fx_crc32(crc, '9'), 0xCBF43926u);
  EXPECT_EQ(modbus(Closed(nine)), 0) << "over a frame with its CRC";
  for (unsigned byte = 0; byte <= 255; ++byte) {
    const Bytes one{static_cast<uint8_t>(byte)};
    ASSERT_EQ(modbus(one), Crc16(one));
    ASSERT_EQ(ethernet(one), Crc32(one.data(), 1));
  }
  RandomBits random(kSeed);
  for (int i = 0; i < 2000; ++i) {
    Bytes bytes(random.Below(64));
    for (uint8_t &byte : bytes) byte = static_cast<uint8_t>(random.Below(256));
    ASSERT_EQ(modbus(bytes), Crc16(bytes));
    ASSERT_EQ(ethernet(bytes), Crc32(bytes.data(), bytes.size()));
  }
}

// The check value of CRC-16/XMODEM, and that of nothing and of zeros.
TEST(FxCrc, BlocksOfCanopenHaveTheCcittPolynomialFromZero) {
  uint16_t crc = 0;
  for (const char byte : std::string("123456789")) {
    crc = fx_crc16_ccitt(crc, static_cast<uint8_t>(byte));
  }
  EXPECT_EQ(crc, 0x31C3);
  EXPECT_EQ(fx_crc16_ccitt(0, 0), 0);
  EXPECT_EQ(fx_crc16_ccitt(0, 1), 0x1021);
}

TEST(FxBytes, RowsOfBits) {
  RandomBits random(kSeed);
  for (int i = 0; i < 2000; ++i) {
    const uint32_t count = random.Below(40);
    std::vector<bool> row;
    std::array<uint8_t, 7> bytes;
    bytes.fill(kGuard);
    for (uint32_t n = 0; n < count; ++n) {
      row.push_back(random.Below(2) != 0);
      fx_bit_append(&bytes[1], n, row.back());
    }
    unsigned octets = 0;
    while (8 * octets < count) ++octets;
    ASSERT_EQ(fx_octets(count), octets) << count;
    for (uint32_t n = 0; n < 8 * octets; ++n) {
      ASSERT_EQ(fx_bit_get(&bytes[1], n), n < count && row[n]) << "bit " << n << " of " << count;
    }
    ASSERT_EQ(bytes[0], kGuard);
    ASSERT_EQ(bytes[1 + octets], kGuard) << "the byte after the last bit";
  }
  EXPECT_EQ(fx_octets(0), 0u);
  const uint8_t mixed[2] = {0x80, 0x01};
  EXPECT_FALSE(fx_bit_get(mixed, 6));
  EXPECT_TRUE(fx_bit_get(mixed, 7));
  EXPECT_TRUE(fx_bit_get(mixed, 8));
  EXPECT_FALSE(fx_bit_get(mixed, 9));
}

TEST(FxBytes, BitsAndFields) {
  RandomBits random(kSeed);
  for (uint32_t n = 0; n < 32; ++n) {
    ASSERT_EQ(Wide{fx_bit(n)}, TwoTo(n));
    ASSERT_EQ(fx_lowest_bit(1u << n), n);
    ASSERT_EQ(fx_lowest_bit(UINT32_MAX << n), n);
    for (int i = 0; i < 1000; ++i) {
      ASSERT_EQ(fx_lowest_bit((random.U32() << n) | (1u << n)), n);
    }
    for (uint32_t width = 1; width <= 31; ++width) {
      for (int i = 0; i < 50; ++i) {
        const uint32_t bits = i == 0 ? UINT32_MAX : random.U32();
        ASSERT_EQ(Wide{fx_field(bits, n, width)}, FloorDivide(bits, TwoTo(n)) % TwoTo(width));
      }
    }
  }
}

TEST(FxBytes, Payloads) {
  RandomBits random(kSeed);
  for (int i = 0; i < 3000; ++i) {
    const uint64_t payload = i == 0 ? 0x8123456789ABCDEFu : random.U64();
    std::array<uint8_t, 8> bytes;
    for (unsigned k = 0; k < 8; ++k) bytes[k] = static_cast<uint8_t>(payload >> (8 * k));
    for (unsigned count = 0; count <= 8; ++count) {
      ASSERT_EQ(Wide{fx_load_payload(bytes.data(), static_cast<uint8_t>(count))},
                Wide{payload} % TwoTo(8 * count));
    }
    for (uint32_t first = 0; first < 64; ++first) {
      for (uint32_t width = 1; width <= 32 && first + width <= 64; ++width) {
        ASSERT_EQ(Wide{fx_payload_get(payload, first, width)},
                  FloorDivide(payload, TwoTo(first)) % TwoTo(width));
      }
    }
    uint16_t places[4];
    for (uint16_t &place : places) place = static_cast<uint16_t>(random.Below(8));
    uint32_t gathered = 0;
    for (int k = 3; k >= 0; --k) gathered = gathered * 256 + bytes[places[k]];
    ASSERT_EQ(fx_gather_le(bytes.data(), places), gathered);
  }
}

TEST(Bytes, WordsAreCopiedUpwards) {
  for (uint32_t count : {0u, 4u, 8u, 40u}) {
    uint8_t bytes[64];
    for (uint8_t i = 0; i < 64; ++i) bytes[i] = i;
    fx_copy_words(&bytes[4], &bytes[12], count);  // the source may overlap behind the target
    for (uint8_t i = 0; i < 64; ++i) {
      EXPECT_EQ(bytes[i], i >= 4 && i < 4 + count ? i + 8 : i) << count;
    }
  }
}

TEST(Bytes, ClearSetsItsBytesAndNoOthers) {
  for (uint32_t count = 0; count <= 9; ++count) {
    std::array<uint8_t, 16> bytes{};
    bytes.fill(0xA5);
    fx_clear(&bytes[3], count);
    for (uint32_t i = 0; i < bytes.size(); ++i) {
      EXPECT_EQ(bytes[i], i >= 3 && i < 3 + count ? 0 : 0xA5) << count;
    }
  }
}

}  // namespace
