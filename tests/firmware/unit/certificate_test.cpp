// Certificates: what each is of, and how the force law is restricted without one that fits.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <set>
#include <vector>

#include "tests/firmware/unit/cia402_fixture.hpp"
#include "tests/firmware/unit/flash.hpp"
#include "tests/firmware/unit/store_fixture.hpp"

namespace {

uint32_t CrcOf(const std::vector<uint32_t> &words) {
  Bytes bytes(4 * words.size());
  for (size_t i = 0; i < words.size(); ++i) PutWord(bytes, 4 * i, words[i]);
  return Crc32(bytes.data(), bytes.size());
}

TEST(Certificate, TheHashIsOfItsFiveParts) {
  const certificate_t certificate = certificate_of(0x12345678, 12, 2500000);
  const uint32_t law = CrcOf({FORCE_LAW_VERSION, AXIS_LAW_SIGNATURE});
  EXPECT_EQ(certificate.hash,
            CrcOf({0x12345678, 12, 2500000, FORCE_LAW_VERSION, AXIS_LAW_SIGNATURE}));
  EXPECT_EQ(certificate.parts,
            0x78u | 12u << 8 | (CrcOf({2500000}) & 0xFF) << 16 | (law & 0xFF) << 24);
  EXPECT_EQ((std::set<uint32_t>{certificate.hash, certificate_of(0x12345679, 12, 2500000).hash,
                                certificate_of(0x12345678, 8, 2500000).hash,
                                certificate_of(0x12345678, 12, 2500001).hash})
                .size(),
            4u);
}

// An axis in contact that holds still: a reading of 40 counts, 1000 per mille.
class Certified : public Drive {
 protected:
  static uint16_t At(int first, int bank) { return static_cast<uint16_t>(first + bank - 1); }

  // A bank of gain 5 alone, by its number 1 to 4.
  void WriteBank(int bank) {
    Set(At(AXIS_OBJ_BANK_GAIN_1, bank), 5 * 256);
    std::vector<uint32_t> words(19);
    words[1] = 5 * 256;
    Set(At(AXIS_OBJ_BANK_CRC_1, bank), static_cast<int32_t>(CrcOf(words)));
    ASSERT_EQ(Read(At(AXIS_OBJ_BANK_STATE_1, bank)), AXIS_BANK_STATE_VALID);
  }
  void Certify(int bank, int adc_bits = 8, uint32_t force_scale = 2500000) {
    const auto crc = static_cast<uint32_t>(Read(At(AXIS_OBJ_BANK_CRC_1, bank)));
    const certificate_t c = certificate_of(crc, static_cast<uint8_t>(adc_bits), force_scale);
    Set(At(AXIS_OBJ_CERTIFICATE_HASH_1, bank), static_cast<int32_t>(c.hash));
    Set(At(AXIS_OBJ_CERTIFICATE_PARTS_1, bank), static_cast<int32_t>(c.parts));
  }
  int StateOf(int bank) { return Read(At(AXIS_OBJ_CERTIFICATE_STATE_1, bank)); }

  void PressFor(int mode, int target) {
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_FORCE_SLOPE, 1000000);
    stuck_ = true;
    wall_ = -80;
    Enable(mode);
    Set(AXIS_OBJ_TARGET_FORCE, target);
    Tick(100);
  }
  static constexpr int kWarning = 0x80;
};

TEST_F(Certified, TheStateSaysWhichPartDoesNotFit) {
  WriteBank(2);
  EXPECT_EQ(StateOf(2), AXIS_CERTIFICATE_STATE_NONE);
  Certify(2);
  EXPECT_EQ(StateOf(2), AXIS_CERTIFICATE_STATE_FITS);
  EXPECT_EQ(StateOf(1), AXIS_CERTIFICATE_STATE_NONE);
  Set(AXIS_OBJ_ADC_BITS, 12);
  EXPECT_EQ(StateOf(2), AXIS_CERTIFICATE_STATE_OTHER_ADC);
  Set(AXIS_OBJ_ADC_BITS, 8);
  EXPECT_EQ(StateOf(2), AXIS_CERTIFICATE_STATE_FITS);
  Set(AXIS_OBJ_FORCE_SCALE, 2400000);
  EXPECT_EQ(StateOf(2), AXIS_CERTIFICATE_STATE_OTHER_SCALE);
  Set(AXIS_OBJ_FORCE_SCALE, 2500000);
  Set(AXIS_OBJ_BANK_CRC_2, Read(AXIS_OBJ_BANK_CRC_2) ^ 1);
  EXPECT_EQ(StateOf(2), AXIS_CERTIFICATE_STATE_OTHER_BANK);
  Set(AXIS_OBJ_BANK_CRC_2, Read(AXIS_OBJ_BANK_CRC_2) ^ 1);
  const int32_t parts = Read(AXIS_OBJ_CERTIFICATE_PARTS_2);
  Set(AXIS_OBJ_CERTIFICATE_HASH_2, Read(AXIS_OBJ_CERTIFICATE_HASH_2) ^ 1);
  EXPECT_EQ(StateOf(2), AXIS_CERTIFICATE_STATE_WRONG_HASH);
  Set(AXIS_OBJ_CERTIFICATE_PARTS_2, parts ^ 0x01000000);
  EXPECT_EQ(StateOf(2), AXIS_CERTIFICATE_STATE_OTHER_LAW);
}

TEST_F(Certified, WithoutOneForceAndOutputAreReduced) {
  for (const int mode : {kTq, kCst}) {
    for (const bool certified : {false, true}) {
      PowerUp();
      WriteBank(3);
      if (certified) Certify(3);
      Set(AXIS_OBJ_FORCE_BANK, 3);
      PressFor(mode, 1000);
      EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), certified ? 1000 : 500);
      EXPECT_EQ(Status() & kLimit, certified ? 0 : kLimit);
      EXPECT_EQ(Status() & kWarning, certified ? 0 : kWarning);
      Set(AXIS_OBJ_TARGET_FORCE, 400);
      Tick(10);
      EXPECT_EQ(Status() & kLimit, 0);
      EXPECT_EQ(Status() & kWarning, certified ? 0 : kWarning) << "also within its bounds";
      // The reading is 255 counts: the law asks for -5 x (255 - 16) codes.
      wall_ = -1000;
      Tick(10);
      EXPECT_EQ(outputs_.dac_code, certified ? -5 * (255 - 16) : -512);
      EXPECT_EQ(Status() & kLimit, certified ? 0 : kLimit);
      EXPECT_EQ(Read(AXIS_OBJ_OUTPUT_LIMIT), 2048) << "the user's own";
      Set(AXIS_OBJ_OUTPUT_LIMIT, 100);
      Tick(10);
      EXPECT_EQ(outputs_.dac_code, -100) << "the smaller one counts";
    }
  }
}

TEST_F(Certified, TheBoundsAreObjects) {
  WriteBank(1);
  Set(AXIS_OBJ_FORCE_BANK, 1);
  Set(AXIS_OBJ_FORCE_LIMIT, 800);
  Set(AXIS_OBJ_UNCERTIFIED_FORCE, 250);
  Set(AXIS_OBJ_UNCERTIFIED_OUTPUT, 77);
  PressFor(kTq, 1000);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), 200);
  wall_ = -1000;
  Tick(10);
  EXPECT_EQ(outputs_.dac_code, -77);
  Certify(1);
  Tick(10);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), 800) << "in force at once";
  EXPECT_EQ(outputs_.dac_code, -5 * (255 - 32));
  EXPECT_EQ(Status() & kWarning, kWarning) << "saturated reading and target";
}

// Every mode that controls force, in newtons, in counts or by a spring: half of force_limit, 20
// counts of the reading, and 100 codes, with the warning; not a mode that does not.
TEST_F(Certified, EveryModeThatControlsForceIsReduced) {
  for (const bool certified : {false, true}) {
    PowerUp();
    WriteBank(1);
    Set(AXIS_OBJ_FORCE_BANK, 1);
    Set(AXIS_OBJ_UNCERTIFIED_OUTPUT, 100);
    Set(AXIS_OBJ_STIFFNESS, 65536);
    Set(AXIS_OBJ_DAMPING, 50 * 256);
    Set(AXIS_OBJ_FORCE_SETPOINT, 200 * 256);
    if (certified) Certify(1);
    for (const int mode : {-1, -6, -7, -8}) {
      PressFor(mode, 0);
      Set(AXIS_OBJ_TARGET_POSITION, 5000);
      Set(AXIS_OBJ_TARGET_VELOCITY, 30000);
      Tick(3000);
      const int demand = Read(AXIS_OBJ_FORCE_DEMAND);
      EXPECT_EQ(demand, certified ? (mode == -1 ? 5000 : 1000) : 500) << mode;
      const int code = 5 * (demand * 40 / 1000 - 40);  // the reading is 40 counts
      EXPECT_EQ(outputs_.dac_code, certified ? code : std::max(code, -100)) << mode;
      EXPECT_EQ(Status() & kWarning, certified ? 0 : kWarning) << mode;
      Control(0);
      Tick();
    }
  }
}

TEST_F(Certified, ForceGainAloneNeedsNoneUnlessItIsRequired) {
  PressFor(kTq, 1000);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), 1000);
  EXPECT_EQ(Status() & kWarning, 0);
  Set(AXIS_OBJ_CERTIFICATE_REQUIRED, 1);
  Tick(100);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_DEMAND), 500);
  EXPECT_EQ(Status() & kWarning, kWarning);
  Control(0);
  Tick();
  EXPECT_EQ(Status() & kWarning, 0) << "only while it is controlled";
}

TEST(CertificateStore, AStoredCertificateIsInForceAfterPowerUp) {
  Flash flash;
  Axis axis(flash.memory());
  std::vector<uint32_t> words(19);
  words[1] = 256;
  ASSERT_EQ(axis.Write(AXIS_OBJ_BANK_GAIN_1, 256), FW_OK);
  ASSERT_EQ(axis.Write(AXIS_OBJ_BANK_CRC_1, static_cast<int32_t>(CrcOf(words))), FW_OK);
  const certificate_t c = certificate_of(CrcOf(words), 8, 2500000);
  ASSERT_EQ(axis.Write(AXIS_OBJ_CERTIFICATE_HASH_1, static_cast<int32_t>(c.hash)), FW_OK);
  ASSERT_EQ(axis.Write(AXIS_OBJ_CERTIFICATE_MS_1, 1940), FW_OK);
  ASSERT_EQ(axis.Write(AXIS_OBJ_FORCE_BANK, 1), FW_OK);
  axis.Save();
  Axis next(flash.memory());
  EXPECT_EQ(next.Read(AXIS_OBJ_CERTIFICATE_STATE_1), AXIS_CERTIFICATE_STATE_FITS);
  EXPECT_EQ(next.Read(AXIS_OBJ_CERTIFICATE_MS_1), 1940);
  EXPECT_EQ(next.fw().drive.uncertified, 0);
  ASSERT_EQ(next.Write(AXIS_OBJ_FORCE_SCALE, 2400000), FW_OK);
  next.Save();
  Axis other(flash.memory());
  EXPECT_EQ(other.fw().drive.uncertified, 1) << "no longer the sensor that it was made for";
  EXPECT_EQ(other.fw().drive.force_bounds.most, 500);
}

}  // namespace
