#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <random>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/firmware/unit/axis_fixture.hpp"
#include "tests/firmware/unit/flash.hpp"
#include "tests/firmware/unit/store_fixture.hpp"
#include "tests/firmware/unit/wide.hpp"

namespace {

constexpr uint32_t kSeed = 7;
constexpr double kOne = 67108864.0;  // 2^26
constexpr int kBiggest = 1 << 30;
using Section = std::array<double, 5>;

struct Bank {
  double gain = 1.0;
  double integral_per_s = 0.0;
  double velocity_gain = 0.0;
  std::vector<Section> sections;
};

// The bank of the workpiece's antiresonance for 8 bits, and the one for 12.
const Bank kN8{4.37, 8.0, 0.0, {{1.394373, -2.718615, 1.362417, -1.741615, 0.779790}}};
const Bank kN60{6.08, 8.0, 0.0, {{5.790171, -11.321576, 5.681603, -1.556226, 0.706424}}};

struct Value {
  int object;
  int32_t raw;
};

int32_t Raw(double x, double scale) { return static_cast<int32_t>(std::lround(x * scale)); }

// The writes of a bank (1..4), its CRC last.
std::vector<Value> ValuesOf(int number, const Bank &bank) {
  std::array<int32_t, 15> coefficients{};
  for (size_t i = 0; i < bank.sections.size(); ++i) {
    for (size_t k = 0; k < 5; ++k) coefficients.at(i * 5 + k) = Raw(bank.sections[i][k], kOne);
  }
  std::vector<Value> values = {
      {AXIS_OBJ_BANK_SECTIONS_1 + number - 1, static_cast<int32_t>(bank.sections.size())},
      {AXIS_OBJ_BANK_GAIN_1 + number - 1, Raw(bank.gain, 256)},
      {AXIS_OBJ_BANK_VELOCITY_GAIN_1 + number - 1, Raw(bank.velocity_gain, 256)},
      {AXIS_OBJ_BANK_INTEGRAL_1 + number - 1, Raw(bank.integral_per_s, kOne / 1500)}};
  for (int i = 0; i < 15; ++i) {
    values.push_back({AXIS_OBJ_BANK_COEFFICIENT_1 + (number - 1) * 15 + i,
                      coefficients.at(static_cast<size_t>(i))});
  }
  Bytes bytes(4 * values.size());
  for (size_t i = 0; i < values.size(); ++i) {
    PutWord(bytes, 4 * i, static_cast<uint32_t>(values[i].raw));
  }
  values.push_back(
      {AXIS_OBJ_BANK_CRC_1 + number - 1, static_cast<int32_t>(Crc32(bytes.data(), bytes.size()))});
  return values;
}

class ForceLaw : public AxisFixture {
 protected:
  // Writes whatever may be written.
  void Fill(int number, const Bank &bank) {
    for (const Value &v : ValuesOf(number, bank)) Set(static_cast<uint16_t>(v.object), v.raw);
  }
  int StateOf(int number) {
    return Read(static_cast<uint16_t>(AXIS_OBJ_BANK_STATE_1 + number - 1));
  }
  void Use(int number, const Bank &bank) {
    Fill(number, bank);
    ASSERT_EQ(StateOf(number), AXIS_BANK_STATE_VALID);
    Set(AXIS_OBJ_FORCE_BANK, number);
  }
};

// A section that passes everything on, by coefficients that cancel, or none: the codes of today.
TEST_F(ForceLaw, ABankWithoutFilterAndIntegralIsTheThesisLaw) {
  std::mt19937 random(kSeed);
  for (int run = 0; run < 50; ++run) {
    PowerUp();
    const int gain = static_cast<int>(random() % 65536) >> (random() % 12);
    const int shift = static_cast<int>(random() % 20);
    const int setpoint = static_cast<int>(random() % 131073) - 65536;
    fw_t banked = fw_;
    for (fw_t *fw : {&fw_, &banked}) {
      fw_object_write(fw, FW_SOURCE_LOCAL, AXIS_OBJ_ADC_BITS, 16);
      fw_object_write(fw, FW_SOURCE_LOCAL, AXIS_OBJ_BUMP_DECAY_SHIFT, shift);
      fw_object_write(fw, FW_SOURCE_LOCAL, AXIS_OBJ_FORCE_SETPOINT, setpoint);
      fw_object_write(fw, FW_SOURCE_LOCAL, AXIS_OBJ_FORCE_GAIN, gain);
    }
    for (const Value &v : ValuesOf(3, {.gain = gain / 256.0, .sections = {}})) {
      fw_object_write(&banked, FW_SOURCE_LOCAL, static_cast<uint16_t>(v.object), v.raw);
    }
    if (gain == 0) continue;
    ASSERT_EQ(fw_object_write(&banked, FW_SOURCE_LOCAL, AXIS_OBJ_FORCE_BANK, 3), FW_OK) << gain;
    for (fw_t *fw : {&fw_, &banked}) {
      fw_object_write(fw, FW_SOURCE_LOCAL, AXIS_OBJ_MODE, AXIS_MODE_FORCE);
    }
    for (int t = 0; t < 400; ++t) {
      inputs_.adc_code[0] = static_cast<uint16_t>(random());
      axis_outputs_t other{};
      fw_tick(&banked, &inputs_, &other);
      ASSERT_EQ(Tick(), other.dac_code) << "gain " << gain << " setpoint " << setpoint;
    }
  }
}

// A bank with poles and zeros anywhere inside the unit circle, gain 1 at frequency 0.
Bank RandomBank(std::mt19937 &random) {
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  Bank bank;
  bank.gain = 0.05 + 6.0 * uniform(random) * uniform(random);
  bank.integral_per_s = (random() % 4 == 0) ? 0.0 : 30.0 * uniform(random);
  bank.velocity_gain = (random() % 2 == 0) ? 0.0 : 40.0 * uniform(random);
  for (size_t n = random() % 4; n > 0; --n) {
    std::array<std::array<double, 2>, 2> roots{};
    for (auto &polynomial : roots) {
      const double w = 2.0 * std::numbers::pi * (3.0 * std::pow(200.0, uniform(random))) / 1500.0;
      const double zeta = 0.03 + 0.9 * uniform(random);
      const double radius = std::exp(-zeta * w);
      polynomial = {-2.0 * radius * std::cos(w * std::sqrt(1.0 - zeta * zeta)), radius * radius};
    }
    const double scale = (1.0 + roots[1][0] + roots[1][1]) / (1.0 + roots[0][0] + roots[0][1]);
    if (scale > 12.0) continue;
    bank.sections.push_back(
        {scale, scale * roots[0][0], scale * roots[0][1], roots[1][0], roots[1][1]});
    for (const double c : bank.sections.back()) {
      if (std::fabs(c) > 15.9) {
        bank.sections.pop_back();
        break;
      }
    }
  }
  return bank;
}

// The law of force_law.h in doubles, with the coefficients as written.
class Reference {
 public:
  Reference(const force_bank_t &bank, double error) : bank_(bank) {
    for (auto &s : state_) s = {error, error, error, error};
  }
  double Step(double error, int velocity, bool touching, bool up, bool down) {
    double y = error;
    for (size_t i = 0; i < bank_.sections; ++i) {
      const auto &c = bank_.coefficient_q26[i];
      auto &s = state_[i];
      const double out = (c[0] * y + c[1] * s[0] + c[2] * s[1] - c[3] * s[2] - c[4] * s[3]) / kOne;
      s = {y, s[0], out, s[2]};
      y = out;
    }
    const double p = bank_.gain_q8 / 256.0 * y;
    if (touching && (p > 0 ? up : down)) {
      integral_ = std::clamp(integral_ + bank_.integral_q26 / kOne * p, -2049.0, 2048.0);
    }
    return p + integral_ - bank_.velocity_gain_q8 / 256.0 * velocity;
  }

 private:
  force_bank_t bank_;
  std::array<std::array<double, 4>, 3> state_{};
  double integral_ = 0.0;
};

TEST_F(ForceLaw, CodesAreThoseOfDoublePrecision) {
  const char *begin = std::getenv("FORCEAXIS_LAW_SEED");
  const auto seed = (begin == nullptr) ? kSeed : static_cast<uint32_t>(std::atoll(begin));
  std::mt19937 random(seed);
  int64_t banks = 0;
  int64_t ticks = 0;
  int64_t apart = 0;
  // tests/firmware/proof runs many more of them.
  const char *wanted = std::getenv("FORCEAXIS_LAW_BANKS");
  const int64_t most = (wanted == nullptr) ? 2500 : std::atoll(wanted);
  while (banks < most) {
    PowerUp();
    const int bits = 8 + static_cast<int>(random() % 9);
    Set(AXIS_OBJ_ADC_BITS, bits);
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Fill(1, RandomBank(random));
    if (StateOf(1) != AXIS_BANK_STATE_VALID) continue;  // most of those are too steep
    ++banks;
    Set(AXIS_OBJ_FORCE_BANK, 1);
    const int setpoint = static_cast<int>(random() % 40000);
    Set(AXIS_OBJ_FORCE_SETPOINT, setpoint);
    Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
    const int highest = (1 << bits) - 1;
    int level = static_cast<int>(random() % static_cast<unsigned>(highest));
    int32_t place = static_cast<int32_t>(random() % 1000);
    inputs_.encoder_cnt = place;
    const auto reading = [&] { return level * (1 << (16 - bits)); };
    Reference reference(fw_.axis.law.bank, 0.0);
    for (int t = 0; t < 400; ++t, ++ticks) {
      if (random() % 50 == 0) level = static_cast<int>(random() % static_cast<unsigned>(highest));
      level = std::clamp(level + static_cast<int>(random() % 7) - 3, 0, highest);
      const int velocity = (t == 0) ? 0 : static_cast<int>(random() % 9) - 4;
      place += velocity;
      inputs_.encoder_cnt = place;
      const bool limited = Read(AXIS_OBJ_LIMIT_REASON) != AXIS_LIMIT_REASON_NONE;
      const int before = Read(AXIS_OBJ_COMMAND_CODE);
      const double error = (setpoint - reading()) / 256.0;
      if (t == 0) reference = Reference(fw_.axis.law.bank, error);
      const double exact =
          reference.Step(error, velocity, std::abs(reading()) > Read(AXIS_OBJ_CONTACT_FORCE),
                         !(limited && before > 0), !(limited && before < 0));
      const int code = TickForce(static_cast<uint16_t>(level));
      const double rounded = std::floor(std::clamp(exact, -2048.0, 2047.0) + 0.5);
      apart += std::fabs(rounded - code) > 1.0 ? 1 : 0;
    }
  }
  EXPECT_GE(ticks, 1000000);
  EXPECT_LT(apart, ticks / 1000) << "FORCEAXIS_LAW_SEED=" << seed;
}

// A section against the same sums in 128 bits, with the largest coefficients and signals there are.
TEST_F(ForceLaw, SumsOfExtremeSectionsDoNotOverflow) {
  std::mt19937 random(kSeed);
  const auto extreme = [&random](int most) {
    const int choice = static_cast<int>(random() % 4);
    const auto other = static_cast<int32_t>(random()) >> (random() % 31);
    return choice == 0 ? most : choice == 1 ? -most : std::clamp(other, -most, most);
  };
  for (int i = 0; i < 20000; ++i) {
    force_law_t law{};
    law.bank.sections = 3;
    law.bank.gain_q8 = 65535;
    law.bank.integral_q26 = 67108864;
    law.bank.velocity_gain_q8 = 65535;
    std::array<std::array<Wide, 5>, 3> state{};  // x1, x2, y1, y2, remainder
    for (size_t k = 0; k < 3; ++k) {
      for (int &c : law.bank.coefficient_q26[k]) c = extreme(kBiggest);
      auto &s = law.sections[k];
      s = {{extreme(kBiggest), extreme(kBiggest)},
           {extreme(kBiggest), extreme(kBiggest)},
           static_cast<uint32_t>(random() % 67108864)};
      state[k] = {s.x[0], s.x[1], s.y[0], s.y[1], s.remainder_q26};
    }
    for (int t = 0; t < 10; ++t) {
      const int error = extreme(INT32_MAX);
      const int velocity = extreme(INT32_MAX);
      Wide y = Clamp(Wide{error} * 256, -kBiggest, kBiggest);
      for (size_t k = 0; k < 3; ++k) {
        const auto &c = law.bank.coefficient_q26[k];
        auto &s = state[k];
        const Wide sum = c[0] * y + c[1] * s[0] + c[2] * s[1] - c[3] * s[2] - c[4] * s[3] + s[4];
        const Wide floor = FloorDivide(sum, TwoTo(26));
        const Wide out = Clamp(floor, -kBiggest, kBiggest);
        s = {y, s[0], out, s[2], out == floor ? sum - floor * TwoTo(26) : 0};
        y = out;
      }
      const Wide integral = law.integral_q16 * TwoTo(26) + law.integral_remainder_q26;
      const Wide p = Clamp(FloorDivide(Wide{65535} * y, 256), -kBiggest, kBiggest);
      const Wide grown = integral + p * TwoTo(26);
      const Wide kept = Clamp(FloorDivide(grown, TwoTo(26)), -2049 * 65536, 2048 * 65536);
      const Wide exact = p + kept - Wide{65535} * velocity * 256;
      const int32_t code = force_law_step(&law, error, velocity, {false, true, true});
      ASSERT_EQ(static_cast<int32_t>(kept), law.integral_q16);
      ASSERT_EQ(code, static_cast<int32_t>(Clamp(exact, -2049 * 65536, 2048 * 65536)));
    }
  }
}

// Without an error every section comes to rest, and the code is 0.
TEST_F(ForceLaw, NoBankCyclesWithoutAnError) {
  std::mt19937 random(kSeed);
  int32_t worst = 0;
  for (int banks = 0; banks < 300;) {
    PowerUp();
    Set(AXIS_OBJ_ADC_BITS, 16);
    Bank bank = RandomBank(random);
    bank.integral_per_s = 0.0;
    bank.gain = 2.0;
    Fill(1, bank);
    if (StateOf(1) != AXIS_BANK_STATE_VALID || bank.sections.empty()) continue;
    ++banks;
    Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
    Set(AXIS_OBJ_FORCE_BANK, 1);
    Set(AXIS_OBJ_FORCE_SETPOINT, 0);
    Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
    for (int t = 0; t < 20; ++t) TickForce(static_cast<uint16_t>(random()));
    for (int t = 0; t < 80000; ++t) TickForce(0);
    for (size_t k = 0; k < bank.sections.size(); ++k) {
      const force_section_t &s = fw_.axis.law.sections[k];
      for (const int32_t signal : {s.x[0], s.x[1], s.y[0], s.y[1]}) {
        worst = std::max(worst, std::abs(signal));
      }
    }
    ASSERT_EQ(outputs_.dac_code, 0);
  }
  EXPECT_LE(worst, 64);  // 1/1024 count, whatever the poles
}

TEST_F(ForceLaw, WhatCannotBeALawIsNamed) {
  EXPECT_EQ(StateOf(1), AXIS_BANK_STATE_EMPTY);
  Fill(1, kN8);
  EXPECT_EQ(StateOf(1), AXIS_BANK_STATE_VALID);
  Fill(1, kN60);  // 42 codes for each of its own on 8 bits
  EXPECT_EQ(StateOf(1), AXIS_BANK_STATE_HF_GAIN);
  EXPECT_EQ(Write(AXIS_OBJ_FORCE_BANK, 1), FW_ERROR_STATE);
  Set(AXIS_OBJ_ADC_BITS, 12);
  EXPECT_EQ(StateOf(1), AXIS_BANK_STATE_VALID);
  Set(AXIS_OBJ_FORCE_BANK, 1);
  EXPECT_EQ(Write(AXIS_OBJ_ADC_BITS, 8), FW_ERROR_RANGE);  // not with this law
  EXPECT_EQ(Write(AXIS_OBJ_ADC_BITS, 10), FW_OK);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_BANK), 1);

  const auto with = [](Section section) { return Bank{.sections = {section}}; };
  for (const auto &[a1, a2, stable] :
       std::vector<std::tuple<double, double, bool>>{{0.0, 0.999, true},
                                                     {0.0, 1.0, false},
                                                     {0.0, -1.0, false},
                                                     {1.9, 0.905, true},
                                                     {1.9, 0.9, false},
                                                     {-1.9, 0.9, false},
                                                     {-1.0, 0.0, false},
                                                     {0.0, -0.999, true}}) {
    Fill(2, with({0.01, 0.0, 0.0, a1, a2}));
    EXPECT_EQ(StateOf(2), stable ? AXIS_BANK_STATE_VALID : AXIS_BANK_STATE_UNSTABLE)
        << a1 << " " << a2;
  }
  Fill(2, with({0.5, -0.5, 0.0, 0.0, 0.0}));
  EXPECT_EQ(StateOf(2), AXIS_BANK_STATE_WRONG_SIGN);
  Fill(2, with({15.0, -14.5, 0.0, 0.0, 0.0}));  // the first code of a step, 15; the highest, 29.5
  EXPECT_EQ(StateOf(2), AXIS_BANK_STATE_VALID) << "in 10 bits";
  Fill(2, {.gain = 4.2, .sections = {{15.0, -0.5, -14.0, 0.0, 0.0}}});  // 15 by b0, 1.5 at z = -1
  EXPECT_EQ(StateOf(2), AXIS_BANK_STATE_HF_GAIN) << "by b0";
}

// A bank is written elsewhere than where the law is; one written in part is none.
TEST_F(ForceLaw, ATornBankLeavesTheOldOne) {
  Use(1, kN8);
  StartForce();
  const std::vector<Value> values = ValuesOf(2, {.gain = 3.0, .sections = kN8.sections});
  for (const Value &v : ValuesOf(1, kN8)) {
    EXPECT_EQ(Write(static_cast<uint16_t>(v.object), v.raw), FW_ERROR_STATE) << v.object;
  }
  for (size_t cut = 0; cut < values.size(); ++cut) {
    const fw_t before = fw_;
    bool whole = true;
    for (size_t i = 0; i < values.size(); ++i) {
      if (i != cut) Set(static_cast<uint16_t>(values[i].object), values[i].raw);
      whole = whole && (i != cut || values[i].raw == 0);
    }
    EXPECT_EQ(Write(AXIS_OBJ_FORCE_BANK, 2) == FW_OK, whole) << "without value " << cut;
    if (!whole) {
      EXPECT_EQ(StateOf(2), AXIS_BANK_STATE_WRONG_CRC);
      EXPECT_EQ(Read(AXIS_OBJ_FORCE_BANK), 1);
      EXPECT_EQ(fw_.axis.law.bank.gain_q8, before.axis.law.bank.gain_q8);
    }
    fw_ = before;
  }
}

// Written over an older design, torn at every byte: never something in between in force.
TEST_F(ForceLaw, ABankTornAtAnyByteIsNotSelected) {
  Use(1, kN8);
  StartForce();
  const std::vector<Value> old_values =
      ValuesOf(2, {.gain = 1.5, .integral_per_s = 3.0, .sections = {{0.3, 0.2, 0.0, -0.5, 0.0}}});
  const std::vector<Value> values = ValuesOf(2, {.gain = 3.0, .sections = kN8.sections});
  for (const Value &v : old_values) Set(static_cast<uint16_t>(v.object), v.raw);
  ASSERT_EQ(StateOf(2), AXIS_BANK_STATE_VALID);
  const fw_t before = fw_;
  for (size_t tear = 0; tear <= 4 * values.size(); ++tear) {
    fw_ = before;
    bool is_old = true;
    bool is_new = true;
    for (size_t i = 0; i < values.size(); ++i) {
      const size_t bytes = std::min(tear - std::min(tear, 4 * i), size_t{4});
      const auto mask = static_cast<uint32_t>((uint64_t{1} << (8 * bytes)) - 1);
      const auto raw = static_cast<int32_t>((static_cast<uint32_t>(values[i].raw) & mask) |
                                            (static_cast<uint32_t>(old_values[i].raw) & ~mask));
      // What is out of range is refused, and the old value stays.
      const bool taken = Write(static_cast<uint16_t>(values[i].object), raw) == FW_OK;
      is_old = is_old && (!taken || raw == old_values[i].raw);
      is_new = is_new && taken && raw == values[i].raw;
    }
    EXPECT_EQ(Write(AXIS_OBJ_FORCE_BANK, 2) == FW_OK, is_old || is_new) << "after byte " << tear;
    const int32_t gain = is_new ? 768 : (is_old ? 384 : 1119);
    EXPECT_EQ(fw_.axis.law.bank.gain_q8, gain) << "after byte " << tear;
  }
}

// In contact, with an error and an integral: the code goes on from where it was.
TEST_F(ForceLaw, ABankIsTakenOverWithoutABump) {
  Use(1, kN8);
  Fill(2, {.gain = 2.0, .integral_per_s = 4.0, .sections = {{0.3, 0.2, 0.0, -0.5, 0.0}}});
  Set(AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 8);
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  for (int t = 0; t < 300; ++t) TickForce(25);
  for (const int next : {2, 0, 1}) {
    const int integral = Read(AXIS_OBJ_FORCE_INTEGRAL);
    const int code = outputs_.dac_code;
    Set(AXIS_OBJ_FORCE_GAIN, 3 * 256);
    Set(AXIS_OBJ_FORCE_BANK, next);
    EXPECT_EQ(TickForce(25), code) << "to bank " << next;
    if (next == 2) {
      EXPECT_NEAR(Read(AXIS_OBJ_FORCE_INTEGRAL), integral, 65536);
    }
    for (int t = 0; t < 20; ++t) {
      const int before = outputs_.dac_code;
      EXPECT_LE(std::abs(TickForce(25) - before), 1);
    }
  }
}

TEST_F(ForceLaw, TheIntegralWorksInContactOnlyAndNotAgainstALimit) {
  Use(1, {.gain = 1.0, .integral_per_s = 15.0, .sections = {}});
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_FORCE_SETPOINT, 100 * 256);
  Set(AXIS_OBJ_OUTPUT_LIMIT, 110);
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  for (int t = 0; t < 50; ++t) EXPECT_EQ(TickForce(2), 98);  // contact_force is 2 counts
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_INTEGRAL), 0);
  for (int t = 0; t < 100; ++t) TickForce(50);  // 0.01 of 50 codes a tick
  EXPECT_EQ(outputs_.dac_code, 100);
  for (int t = 0; t < 100; ++t) TickForce(50);
  EXPECT_EQ(outputs_.dac_code, 110);
  EXPECT_EQ(Read(AXIS_OBJ_LIMIT_REASON), AXIS_LIMIT_REASON_OUTPUT_LIMIT);
  EXPECT_NEAR(Read(AXIS_OBJ_FORCE_INTEGRAL), 60 * 65536, 65536);  // and no further
  EXPECT_EQ(TickForce(130), 30);  // back at once: only what the limit allowed is there
  for (int t = 0; t < 10; ++t) TickForce(130);
  EXPECT_LT(outputs_.dac_code, 30);
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  Tick();
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  EXPECT_EQ(TickForce(2), 98);  // begins without it
}

// A limit that a fitted drive reports stops the integral from the next tick on, as a limit of the
// DAC code does, and does not stop it from going back.
TEST_F(ForceLaw, TheIntegralDoesNotGrowAgainstALimitOfTheDrive) {
  Use(1, {.gain = 1.0, .integral_per_s = 15.0, .sections = {}});
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_FORCE_SETPOINT, 100 * 256);
  inputs_.drive = AXIS_DRIVE_REPORT_FITTED;
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  for (int t = 0; t < 100; ++t) TickForce(50);  // the drive is not on yet
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_INTEGRAL), 0);
  inputs_.drive = AXIS_DRIVE_REPORT_FITTED | AXIS_DRIVE_REPORT_ON;
  for (int t = 0; t < 100; ++t) TickForce(50);  // 0.01 of 50 codes a tick
  EXPECT_NEAR(Read(AXIS_OBJ_FORCE_INTEGRAL), 50 * 65536, 65536);
  inputs_.drive |= AXIS_DRIVE_REPORT_LIMIT;
  TickForce(50);
  const int frozen = Read(AXIS_OBJ_FORCE_INTEGRAL);
  for (int t = 0; t < 500; ++t) TickForce(50);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_INTEGRAL), frozen);
  for (int t = 0; t < 10; ++t) TickForce(120);
  EXPECT_NEAR(Read(AXIS_OBJ_FORCE_INTEGRAL), frozen - 2 * 65536, 13200);  // 0.01 of -20 a tick
  inputs_.drive = AXIS_DRIVE_REPORT_FITTED | AXIS_DRIVE_REPORT_ON;
  for (int t = 0; t < 50; ++t) TickForce(50);
  EXPECT_GT(Read(AXIS_OBJ_FORCE_INTEGRAL), frozen);
}

// Ticks force mode once in contact and returns the code.
int PressOnce(fw_t &fw) {
  fw_object_write(&fw, FW_SOURCE_LOCAL, AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  fw_object_write(&fw, FW_SOURCE_LOCAL, AXIS_OBJ_FORCE_GAIN, 5 * 256);
  fw_object_write(&fw, FW_SOURCE_LOCAL, AXIS_OBJ_FORCE_SETPOINT, 30 * 256);
  fw_object_write(&fw, FW_SOURCE_LOCAL, AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  const axis_inputs_t inputs{0, {20, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
  axis_outputs_t outputs{};
  fw_tick(&fw, &inputs, &outputs);
  return outputs.dac_code;
}

TEST(ForceLawStore, AStoredBankIsInForceAfterPowerUp) {
  Flash flash;
  Axis axis(flash.memory());
  for (const Value &v : ValuesOf(4, {.gain = 3.0, .sections = {}})) {
    ASSERT_EQ(axis.Write(static_cast<uint16_t>(v.object), v.raw), FW_OK);
  }
  ASSERT_EQ(axis.Write(AXIS_OBJ_FORCE_BANK, 4), FW_OK);
  axis.Save();
  Axis next(flash.memory());
  EXPECT_EQ(next.Read(AXIS_OBJ_BANK_STATE_4), AXIS_BANK_STATE_VALID);
  EXPECT_EQ(next.Read(AXIS_OBJ_FORCE_BANK), 4);
  EXPECT_EQ(PressOnce(next.fw()), 30);
}

// Another law than the one that was selected would be worse than none.
TEST(ForceLawStore, AStoredBankThatDoesNotPassPutsOutNothing) {
  Flash flash;
  Axis axis(flash.memory());
  for (const Value &v : ValuesOf(1, {.gain = 3.0, .sections = {}})) {
    ASSERT_EQ(axis.Write(static_cast<uint16_t>(v.object), v.raw), FW_OK);
  }
  ASSERT_EQ(axis.Write(AXIS_OBJ_FORCE_BANK, 1), FW_OK);
  axis.fw().banks.params.bank_gain[0] ^= 1;  // a bit that fell over
  axis.Save();
  Axis next(flash.memory());
  EXPECT_EQ(next.Read(AXIS_OBJ_BANK_STATE_1), AXIS_BANK_STATE_WRONG_CRC);
  EXPECT_EQ(next.Read(AXIS_OBJ_FORCE_BANK), 1);
  EXPECT_EQ(next.State(), AXIS_STORE_STATE_FAILED);
  EXPECT_EQ(PressOnce(next.fw()), 0);
  ASSERT_EQ(next.Write(AXIS_OBJ_FORCE_BANK, 0), FW_OK);
  EXPECT_EQ(PressOnce(next.fw()), 50);
}

TEST_F(ForceLaw, VelocityIsDamped) {
  Use(1, {.gain = 1.0, .velocity_gain = 2.5, .sections = {}});
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_FORCE_SETPOINT, 100 * 256);
  Set(AXIS_OBJ_MODE, AXIS_MODE_FORCE);
  EXPECT_EQ(TickForce(50), 50);
  EXPECT_EQ(TickPosition(4), 40);
  EXPECT_EQ(TickPosition(0), 60);
}

}  // namespace
