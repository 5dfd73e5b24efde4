// The protocol of the force converters ADS1256 and AD7193: codes, errors and the configuration,
// from their data sheets. tests/firmware/chip/test_converter.py has models of both on the SPI bus.
#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cstdint>
#include <random>
#include <vector>

extern "C" {
#include "firmware/objects/generated/axis_objects.h"
#include "firmware/port/converter.h"
}

namespace {

using Bytes = std::array<std::uint8_t, CONVERTER_BYTES>;
constexpr std::uint8_t kAd7193 = AXIS_FORCE_CONVERTER_AD7193;
constexpr std::uint8_t kAds1256 = AXIS_FORCE_CONVERTER_ADS1256;

Bytes word(std::uint32_t data, std::uint8_t status = 0) {
  return {static_cast<std::uint8_t>(data >> 16), static_cast<std::uint8_t>(data >> 8),
          static_cast<std::uint8_t>(data), status};
}

// The status that the AD7193 appends: the bit 10h makes the number of ones even.
std::uint8_t parity(std::uint32_t data) { return std::popcount(data) % 2 != 0 ? 0x10 : 0; }

TEST(Converter, GivesTheCodeOfEveryReading) {
  std::mt19937 random(31);
  std::vector<std::uint32_t> words{1, 0x7FFFFF, 0x800000, 0x800001, 0xFFFFFF};
  for (int i = 0; i < 100000; ++i) words.push_back(random() % 0xFFFFFF + 1);
  for (const std::uint32_t data : words) {
    converter_t ads1256{}, ad7193{};
    EXPECT_TRUE(converter_take(&ads1256, kAds1256, word(data).data()));
    EXPECT_TRUE(converter_take(&ad7193, kAd7193, word(data, parity(data)).data()));
    const auto value = static_cast<std::int32_t>(data);
    ASSERT_EQ(ads1256.code, data < 0x800000 ? value : value - 0x1000000) << "two's complement";
    ASSERT_EQ(ad7193.code, value - 0x800000) << "offset binary";
  }
}

TEST(Converter, AReadingOfTheAd7193WithAnErrorOrAFlippedBitIsRefused) {
  std::mt19937 random(32);
  for (int i = 0; i < 20000; ++i) {
    const std::uint32_t data = random() % 0xFFFFFF + 1;
    const std::uint8_t right = parity(data);
    for (const int wrong : {0x40, 0x20, 0x10, 0x01, 0x02, 0x04, 0x08}) {
      converter_t converter{};
      const auto status = static_cast<std::uint8_t>(right ^ wrong);
      ASSERT_FALSE(converter_take(&converter, kAd7193, word(data, status).data()))
          << std::hex << data << " with status " << int{status};
    }
    converter_t converter{};
    ASSERT_FALSE(converter_take(&converter, kAd7193, word(data ^ 1u << i % 24, right).data()));
  }
}

TEST(Converter, ALineOrAConverterThatStandsStillIsRefusedAndAnotherReadingAccepted) {
  for (const std::uint8_t kind : {kAd7193, kAds1256}) {
    converter_t converter{};
    const Bytes same = word(0x812345, parity(0x812345)), other = word(0x812346, parity(0x812346));
    for (int i = 1; i < CONVERTER_EQUAL_MAX; ++i)
      ASSERT_TRUE(converter_take(&converter, kind, same.data())) << i;
    for (int i = 0; i < 300; ++i) ASSERT_FALSE(converter_take(&converter, kind, same.data())) << i;
    EXPECT_TRUE(converter_take(&converter, kind, other.data()));
    EXPECT_TRUE(converter_take(&converter, kind, same.data()));
  }
  converter_t low{}, high{};
  EXPECT_FALSE(converter_take(&low, kAd7193, word(0, 0).data())) << "a line that is low";
  EXPECT_FALSE(converter_take(&high, kAd7193, word(0xFFFFFF, 0xFF).data())) << "one that is high";
}

TEST(Converter, TheAdcCodeIsTheVoltageRoundedDown) {
  std::mt19937 random(33);
  for (int i = 0; i < 100000; ++i) {
    const auto code = static_cast<std::int32_t>(random() % 0x1000000) - 0x800000;
    for (std::uint8_t bits = 8; bits <= 16; ++bits) {
      const std::int64_t shifted = std::int64_t{code} + 0x800000;
      ASSERT_EQ(converter_adc_code(code, bits), shifted / (std::int64_t{1} << (24 - bits)));
    }
  }
  EXPECT_EQ(converter_adc_code(-0x800000, 16), 0);
  EXPECT_EQ(converter_adc_code(0, 16), 0x8000);
  EXPECT_EQ(converter_adc_code(0x7FFFFF, 16), 0xFFFF);
}

// Gains of the data sheets: ADS1256 1 to 64, AD7193 1 and 8 to 128, both in powers of two.
TEST(Converter, ConfiguresEachGainThatItHasAndRefusesTheOthers) {
  for (std::uint8_t exponent = 0; exponent < 8; ++exponent) {
    converter_step_t step;
    EXPECT_EQ(converter_step(kAds1256, exponent, 0, &step), exponent <= 6) << int{exponent};
    EXPECT_EQ(converter_step(kAd7193, exponent, 0, &step), exponent == 0 || exponent >= 3);
  }
}

TEST(Converter, EveryBitThatIsComparedIsNeeded) {
  for (const std::uint8_t kind : {kAd7193, kAds1256}) {
    converter_step_t step;
    int compared = 0;
    std::uint8_t number = 0;
    for (; converter_step(kind, AXIS_FORCE_CONVERTER_GAIN_X64, number, &step); ++number) {
      ASSERT_LE(step.count, CONVERTER_BYTES);
      for (int i = 0; i < step.count; ++i)
        for (int bit = 0; bit < 8; ++bit) {
          Bytes received;
          std::copy(std::begin(step.wanted), std::end(step.wanted), received.begin());
          ASSERT_TRUE(converter_is_right(&step, received.data()));
          received[i] = static_cast<std::uint8_t>(received[i] ^ 1 << bit);
          const bool is_compared = (step.mask[i] >> bit & 1) != 0;
          EXPECT_EQ(converter_is_right(&step, received.data()), !is_compared);
          compared += is_compared;
        }
    }
    EXPECT_GE(number, 6);
    EXPECT_GE(compared, 4 + 24) << "the identity, and what was written";
    EXPECT_TRUE(step.count == 0) << "nothing after the last step";
  }
}

}  // namespace
