// The test before the first motion, with the simulated plants in the loop: each fault of an axis is
// found and named, and no sound axis is refused.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "sim/hybrid/plant.hpp"
#include "sim/model/elements/adc.hpp"
#include "tests/support/poisoned.hpp"

namespace {

using forceaxis::sim::load_model;
using forceaxis::sim::Model;
using forceaxis::sim::Override;
using forceaxis::sim::Plant;
using forceaxis::sim::SensorCodes;

const std::string kModels = SIM_DIR "/models/";
constexpr int kPosition = AXIS_MODES_OF_OPERATION_PROFILE_POSITION;
constexpr int kEnabled = 0x27, kSwitchedOn = 0x23, kFaulty = 0x08, kStateBits = 0x6F;
constexpr int kTestTicks = 4500;  // 3 s, the most that a test may take

// A powered-up axis with first_motion_test on, around a plant whose codes may be altered on their
// way.
class Bench {
 public:
  explicit Bench(const std::string &model, std::vector<Override> overrides = {})
      : Bench(load_model(kModels + model, overrides)) {}

  explicit Bench(Model model) : plant_(std::make_shared<const Model>(std::move(model))) {
    fw_config_t config{};
    config.buses = 1;
    fw_init(&fw_, &config);
    Set(AXIS_OBJ_POSITION_GAIN, 256);
    Set(AXIS_OBJ_FORCE_GAIN, 256);
    for (const auto &adc : plant_.model().adc) {
      if (adc) Set(AXIS_OBJ_ADC_BITS, adc->bits);
    }
    if (const auto &adc = plant_.model().adc[0]) Set(AXIS_OBJ_FORCE_ZERO_CODE, adc->zero_code);
    Set(AXIS_OBJ_FIRST_MOTION_TEST, 1);
  }

  void Set(uint16_t object, int32_t value) {
    ASSERT_EQ(fw_object_write(&fw_, FW_SOURCE_LOCAL, object, value), FW_OK) << "object " << object;
  }
  int32_t Get(uint16_t object) const {
    int32_t value = 0;
    EXPECT_EQ(fw_object_read(&fw_, object, &value), FW_OK);
    return value;
  }

  void Tick(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) {
      codes_ = plant_.codes();
      if (alter) alter(codes_);
      const axis_inputs_t inputs{codes_.encoder, {codes_.adc[0], codes_.adc[1]}, din, 1, 0, 0, 0};
      fw_tick(&fw_, &inputs, &out_);
      // Whatever happens: a fault is off in its own tick.
      ASSERT_TRUE(Get(AXIS_OBJ_FAULT) == 0 || Off());
      largest_ = std::max(largest_, std::abs(int{out_.dac_code}));
      ++age_;
      plant_.step(std::clamp(out_.dac_code + offset, -2048, 2047), out_.amp_enable != 0);
    }
  }

  void Enable(int mode = kPosition) {
    Set(AXIS_OBJ_MODES_OF_OPERATION, mode);
    Tick(2);
    Set(AXIS_OBJ_CONTROLWORD, 0x06);
    Set(AXIS_OBJ_CONTROLWORD, 0x0F);
  }

  // Ticks until the test has ended one way or the other.
  int RunTest() {
    int ticks = 0;
    while (Running() && ticks < kTestTicks) {
      Tick();
      ++ticks;
      EXPECT_TRUE(!Running() || State() == kSwitchedOn);
    }
    EXPECT_FALSE(Running()) << "it must end";
    return ticks;
  }

  void ExpectFinding(int fault, int result, int code, const std::string &what) {
    EXPECT_EQ(Get(AXIS_OBJ_FAULT), fault) << what;
    EXPECT_EQ(Get(AXIS_OBJ_FIRST_MOTION_RESULT), result) << what;
    EXPECT_EQ(Get(AXIS_OBJ_ERROR_CODE), code) << what;
    EXPECT_EQ(State() & 0x4F, kFaulty) << what;
    EXPECT_TRUE(Off()) << what;
  }

  bool Running() const { return Get(AXIS_OBJ_FIRST_MOTION_RESULT) == 1; }
  bool Passed() const { return Get(AXIS_OBJ_FIRST_MOTION_RESULT) == 2; }
  bool Off() const { return out_.dac_code == 0 && out_.amp_enable == 0 && out_.brake_release == 0; }
  int State() const { return Get(AXIS_OBJ_STATUSWORD) & kStateBits; }
  int Largest() const { return largest_; }
  int Encoder() const { return codes_.encoder; }
  const axis_outputs_t &out() const { return out_; }
  Plant &plant() { return plant_; }
  fw_t &fw() { return fw_; }

  std::function<void(SensorCodes &)> alter;
  int offset = 0;  // of the amplifier, in codes
  uint8_t din = AXIS_DIGITAL_INPUTS_ENABLE;

 private:
  fw_t fw_ = poisoned<fw_t>();
  Plant plant_;
  SensorCodes codes_;
  axis_outputs_t out_{};
  int largest_ = 0;
  int age_ = 0;
};

struct Finding {
  const char *name;
  std::vector<Override> overrides;
  std::function<void(Bench &)> prepare;
  int fault, result, code;
};

const std::vector<Override> kSigned{{"force_zero_code", 128.0}};

#define FOUND(NAME) AXIS_FAULT_##NAME, AXIS_FIRST_MOTION_RESULT_##NAME

// The laboratory's axis, each time with one thing wrong.
const std::vector<Finding> kFindings{
    {"encoder reversed", {{"encoder_scale", -157480.3}}, {}, FOUND(ENCODER_REVERSED), 0xFF0F},
    {"amplifier reversed", {{"k_preamp_cmd", -3.9}}, {}, FOUND(ENCODER_REVERSED), 0xFF0F},
    {"encoder dead", {{"encoder_scale", 1e-6}}, {}, FOUND(NO_MOTION), 0x7121},
    {"motor dead", {{"k_torque", 1e-9}}, {}, FOUND(NO_MOTION), 0x7121},
    {"force reading at its upper end",
     {},
     [](Bench &b) { b.alter = [](SensorCodes &c) { c.adc[0] = 255; }; },
     FOUND(FORCE_SENSOR_FAILED),
     0xFF0B},
    {"force reading at its lower end", kSigned,
     [](Bench &b) { b.alter = [](SensorCodes &c) { c.adc[0] = 0; }; }, FOUND(FORCE_SENSOR_FAILED),
     0xFF0B},
    {"force reading that jumps", kSigned,
     [](Bench &b) {
       b.alter = [n = 0](SensorCodes &c) mutable {
         if (n++ % 20 == 0) c.adc[0] = static_cast<uint16_t>(c.adc[0] + 40);
       };
     },
     FOUND(FORCE_SENSOR_FAILED), 0xFF0B},
    {"force reading with an offset out of contact", kSigned,
     [](Bench &b) { b.alter = [](SensorCodes &c) { c.adc[0] = 150; }; }, FOUND(FORCE_SENSOR_FAILED),
     0xFF0B},
    {"current at its upper end",
     {},
     [](Bench &b) { b.alter = [](SensorCodes &c) { c.adc[1] = 255; }; },
     FOUND(CURRENT_SENSOR_FAILED),
     0xFF0C},
    {"current that jumps",
     {},
     [](Bench &b) {
       b.alter = [n = 0](SensorCodes &c) mutable {
         if (n++ % 20 == 0) c.adc[1] = 20;
       };
     },
     FOUND(CURRENT_SENSOR_FAILED),
     0xFF0C},
    {"encoder that counts at a stand",
     {},
     [](Bench &b) { b.alter = [n = 0](SensorCodes &c) mutable { c.encoder += ++n; }; },
     FOUND(NOT_STANDING),
     0xFF0D},
    {"amplifier with an offset of 0.4 V",
     {},
     [](Bench &b) { b.offset = 80; },
     FOUND(AMPLIFIER_OFFSET),
     0xFF0E},
    // Ten times as many counts a metre: 100 codes are some 20 counts a tick.
    {"speed bound",
     {{"encoder_scale", 1574803.0}},
     [](Bench &b) { b.Set(AXIS_OBJ_FIRST_MOTION_COUNTS, 4096); },
     FOUND(RUNAWAY),
     0xFF10},
    {"no position gain",
     {},
     [](Bench &b) { b.Set(AXIS_OBJ_POSITION_GAIN, 0); },
     FOUND(POSITION_GAIN_ZERO),
     0xFF12},
};

TEST(FirstMotion, EachFaultOfTheAxisIsFoundAndNamed) {
  for (const Finding &f : kFindings) {
    for (const int latency : {0, 1}) {
      Bench bench("laboratory.toml", f.overrides);
      if (f.prepare) f.prepare(bench);
      bench.Set(AXIS_OBJ_LATENCY_TICKS, latency);
      bench.Enable();
      bench.Tick();
      bench.RunTest();
      bench.ExpectFinding(f.fault, f.result, f.code, f.name);
      EXPECT_LE(bench.Largest(), 100) << f.name;
    }
  }
}

// Every model that has a drive and an encoder; each mode of operation in turn.
TEST(FirstMotion, EverySoundAxisPasses) {
  const int modes[] = {1, 3, 4, 6, 8, 9, 10, -1, -2, -3, -4, -5, -6, -7, -8};
  int tested = 0;
  for (const auto &entry : std::filesystem::directory_iterator(kModels)) {
    const std::string name = entry.path().filename();
    if (name == "thesis.toml") continue;
    const Model model = load_model(entry.path());
    if (!model.drive || !model.encoder) continue;
    for (const int latency : {0, 1}) {
      Bench bench(name);
      bench.Set(AXIS_OBJ_LATENCY_TICKS, latency);
      bench.Enable(modes[tested % std::size(modes)]);
      const int ticks = bench.RunTest();
      EXPECT_TRUE(bench.Passed()) << name << " fault " << bench.Get(AXIS_OBJ_FAULT) << " moved "
                                  << bench.Get(AXIS_OBJ_FIRST_MOTION_MOVED) << " code "
                                  << bench.Get(AXIS_OBJ_FIRST_MOTION_CODE_REACHED) << " force "
                                  << bench.Get(AXIS_OBJ_FIRST_MOTION_FORCE) << " ticks " << ticks;
      bench.Tick();
      EXPECT_EQ(bench.State(), bench.Passed() ? kEnabled : 0) << name;
    }
    ++tested;
  }
  EXPECT_GE(tested, 40);
}

// The measured values are those of the way out: 16 counts away from the workpiece.
TEST(FirstMotion, ReportsCountsAndCode) {
  Bench bench("laboratory.toml");
  bench.Enable();
  EXPECT_EQ(bench.State(), kSwitchedOn) << "no target is acted on yet";
  const int ticks = bench.RunTest();
  EXPECT_LT(ticks, 450) << "0.3 s";
  EXPECT_LE(bench.Get(AXIS_OBJ_FIRST_MOTION_MOVED), -16);
  EXPECT_GE(bench.Get(AXIS_OBJ_FIRST_MOTION_MOVED), -20);
  EXPECT_LT(bench.Get(AXIS_OBJ_FIRST_MOTION_CODE_REACHED), 0);
  EXPECT_LE(-bench.Get(AXIS_OBJ_FIRST_MOTION_CODE_REACHED), bench.Largest());
  bench.Tick(1500);
  EXPECT_NEAR(bench.Encoder(), -1575, 16) << "back where it was: 10 mm before the workpiece";
}

// A target written during the test acts after it, the new set-point of a controlword not at all.
TEST(FirstMotion, NoTargetActsDuringTheTest) {
  Bench bench("laboratory.toml");
  bench.Enable();
  bench.Set(AXIS_OBJ_TARGET_POSITION, -10000);
  bench.Set(AXIS_OBJ_CONTROLWORD, 0x1F);
  bench.RunTest();
  ASSERT_TRUE(bench.Passed());
  bench.Tick(1500);
  EXPECT_NEAR(bench.Encoder(), -1575, 16);
  EXPECT_EQ(bench.Get(AXIS_OBJ_STATUSWORD) & 0x1000, 0) << "not acknowledged";
  bench.Set(AXIS_OBJ_CONTROLWORD, 0x0F);
  bench.Set(AXIS_OBJ_CONTROLWORD, 0x1F);
  bench.Tick(6000);
  EXPECT_NEAR(bench.Encoder(), -10000, 20);
}

// Once passed it is not repeated, until what the readings mean is changed.
TEST(FirstMotion, IsRunOnce) {
  Bench bench("laboratory.toml");
  bench.Enable();
  bench.RunTest();
  ASSERT_TRUE(bench.Passed());
  bench.Tick();
  bench.Set(AXIS_OBJ_CONTROLWORD, 0);
  bench.Tick(300);
  bench.Enable();
  EXPECT_EQ(bench.State(), kEnabled);
  const std::pair<uint16_t, int> changes[] = {{AXIS_OBJ_FORCE_SIGN, -1},
                                              {AXIS_OBJ_FORCE_ZERO_CODE, 1},
                                              {AXIS_OBJ_ADC_BITS, 9},
                                              {AXIS_OBJ_FIRST_MOTION_TEST, 0}};
  for (const auto &[object, value] : changes) {
    Bench again("laboratory.toml");
    again.Enable();
    again.RunTest();
    ASSERT_TRUE(again.Passed());
    again.Tick();
    again.Set(AXIS_OBJ_CONTROLWORD, 0);
    again.Tick(300);
    const int before = again.Get(object);
    again.Set(object, value);
    EXPECT_EQ(again.Get(AXIS_OBJ_FIRST_MOTION_RESULT), AXIS_FIRST_MOTION_RESULT_NOT_RUN);
    again.Set(object, before);
    again.Enable();
    EXPECT_TRUE(again.Running()) << "object " << object;
  }
}

// Each stop in each phase of the test: off in the next tick, no fault, and the test comes again.
TEST(FirstMotion, StopsActAtOnce) {
  struct Stop {
    const char *name;
    std::function<void(Bench &)> act;
    int state;
  };
  const std::vector<Stop> stops{
      {"disable voltage", [](Bench &b) { b.Set(AXIS_OBJ_CONTROLWORD, 0); }, 0x40},
      {"quick stop", [](Bench &b) { b.Set(AXIS_OBJ_CONTROLWORD, 0x02); }, 0x40},
      {"disable operation", [](Bench &b) { b.Set(AXIS_OBJ_CONTROLWORD, 0x07); }, 0x23},
      {"shutdown", [](Bench &b) { b.Set(AXIS_OBJ_CONTROLWORD, 0x06); }, 0x21},
      {"native mode", [](Bench &b) { b.Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED); }, 0x40},
      {"halt", [](Bench &b) { b.Set(AXIS_OBJ_CONTROLWORD, 0x10F); }, 0x23},
      {"owner lost, quick stop",
       [](Bench &b) {
         b.Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, 3);
         cia402_owner_lost(&b.fw().drive, &b.fw().axis, AXIS_FAULT_SOURCE_LOST);
       },
       0x40},
  };
  for (const Stop &stop : stops) {
    for (const int phase :
         {FIRST_MOTION_STANDING, FIRST_MOTION_ZERO, FIRST_MOTION_OUT, FIRST_MOTION_BACK}) {
      Bench bench("laboratory.toml");
      bench.Enable();
      while (bench.fw().drive.guards.first_motion.phase != phase) bench.Tick();
      bench.Tick(3);
      ASSERT_EQ(bench.fw().drive.guards.first_motion.phase, phase);
      stop.act(bench);
      bench.Tick();
      EXPECT_TRUE(bench.Off()) << stop.name << ", phase " << phase;
      bench.Tick(200);
      EXPECT_TRUE(bench.Off()) << stop.name << ", phase " << phase;
      EXPECT_EQ(bench.State(), stop.state) << stop.name << ", phase " << phase;
      EXPECT_EQ(bench.Get(AXIS_OBJ_FAULT), 0) << stop.name;
      bench.Set(AXIS_OBJ_CONTROLWORD, 0);
      bench.Tick(600);
      bench.Enable();
      bench.RunTest();
      EXPECT_TRUE(bench.Passed()) << stop.name << ", phase " << phase;
    }
  }
}

// A fault from outside is off in the next tick too, though the reaction would be a ramp.
TEST(FirstMotion, AFaultFromOutsideHasNoRamp) {
  Bench bench("laboratory.toml");
  bench.Set(AXIS_OBJ_FAULT_REACTION_OPTION, 2);
  bench.Enable();
  while (bench.fw().drive.guards.first_motion.phase != FIRST_MOTION_OUT) bench.Tick();
  bench.Tick(20);
  cia402_owner_lost(&bench.fw().drive, &bench.fw().axis, AXIS_FAULT_SOURCE_LOST);
  bench.Tick();
  EXPECT_TRUE(bench.Off());
  EXPECT_EQ(bench.Get(AXIS_OBJ_FAULT), AXIS_FAULT_SOURCE_LOST);
  EXPECT_EQ(bench.Get(AXIS_OBJ_FIRST_MOTION_RESULT), AXIS_FIRST_MOTION_RESULT_NOT_RUN);
}

// On a limit that forbids the way away from the workpiece the axis goes the other way; one that
// forbids the way back ends it.
TEST(FirstMotion, AtALimitItGoesTheOtherWay) {
  for (const int latency : {0, 1}) {
    Bench negative("laboratory.toml");
    negative.Set(AXIS_OBJ_LATENCY_TICKS, latency);
    negative.din = AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE;
    negative.Enable();
    negative.RunTest();
    EXPECT_TRUE(negative.Passed()) << negative.Get(AXIS_OBJ_FAULT);
    EXPECT_GE(negative.Get(AXIS_OBJ_FIRST_MOTION_MOVED), 16);

    Bench positive("laboratory.toml");
    positive.Set(AXIS_OBJ_LATENCY_TICKS, latency);
    positive.din = AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE;
    positive.Enable();
    positive.RunTest();
    EXPECT_TRUE(positive.Passed()) << positive.Get(AXIS_OBJ_FAULT);
    EXPECT_LE(positive.Get(AXIS_OBJ_FIRST_MOTION_MOVED), -16);

    Bench soft("laboratory.toml");
    soft.Set(AXIS_OBJ_LATENCY_TICKS, latency);
    soft.Set(AXIS_OBJ_POSITION_MIN, -1000);  // it stands at -1575
    soft.Enable();
    soft.RunTest();
    EXPECT_TRUE(soft.Passed()) << soft.Get(AXIS_OBJ_FAULT);
    EXPECT_GE(soft.Get(AXIS_OBJ_FIRST_MOTION_MOVED), 16);

    // A reversed encoder is found this way round, too.
    Bench reversed("laboratory.toml", {{"encoder_scale", -157480.3}});
    reversed.Set(AXIS_OBJ_LATENCY_TICKS, latency);
    reversed.din = AXIS_DIGITAL_INPUTS_ENABLE | AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE;
    reversed.Enable();
    reversed.RunTest();
    EXPECT_EQ(reversed.Get(AXIS_OBJ_FAULT), AXIS_FAULT_ENCODER_REVERSED);
  }
}

// The laboratory's axis with a slide that holds it where it is, pressed 0.2 mm (22 N, 9 counts)
// into the workpiece.
Model InContact(std::vector<Override> overrides, double depth_m = 0.0002) {
  static const std::filesystem::path file = std::filesystem::path(testing::TempDir()) /
                                            ("first_motion_" + std::to_string(getpid()) + ".toml");
  std::ifstream in(kModels + "laboratory.toml");
  std::string text{std::istreambuf_iterator<char>(in), {}};
  const std::string shared = "\"thesis.toml\"";
  text.replace(text.find(shared), shared.size(), "\"" + kModels + "thesis.toml\"");
  text +=
      "\n[[friction]]\nname = \"gib\"\nbetween = [\"robot\", \"ground\"]\n"
      "coulomb = 60\nstiction = 80\n";
  std::ofstream(file) << text;
  overrides.insert(overrides.end(), {{"approach", -depth_m}, {"force_zero_code", 128.0}});
  Model model = load_model(file, overrides);
  std::filesystem::remove(file);
  return model;
}

// Encoder and amplifier reversed agree with each other; the workpiece contradicts.
const std::vector<Override> kBothReversed{{"k_preamp_cmd", -3.9}, {"encoder_scale", -157480.3}};

// What the contact shows at once: the force sign, or that the axis goes the wrong way.
TEST(FirstMotion, InContactTheForceSignIsJudgedAtOnce) {
  struct Case {
    const char *name;
    std::vector<Override> overrides;
    int sign, fault;
  };
  const Case cases[] = {
      {"sound", {}, 1, AXIS_FAULT_NONE},
      {"force sign", {}, -1, AXIS_FAULT_FORCE_REVERSED},
      {"force cable", {{"force_per_count", -2.5}}, 1, AXIS_FAULT_FORCE_REVERSED},
      {"both reversed", kBothReversed, 1, AXIS_FAULT_FORCE_REVERSED},
      {"amplifier reversed", {{"k_preamp_cmd", -3.9}}, 1, AXIS_FAULT_ENCODER_REVERSED},
      // The force changes, the count does not.
      {"encoder dead", {{"k_preamp_cmd", -3.9}, {"encoder_scale", 1e-6}}, 1, AXIS_FAULT_NO_MOTION},
  };
  for (const Case &c : cases) {
    for (const int latency : {0, 1}) {
      Bench bench(InContact(c.overrides));
      bench.Set(AXIS_OBJ_LATENCY_TICKS, latency);
      bench.Set(AXIS_OBJ_FORCE_SIGN, c.sign);
      bench.Tick(6000);  // the workpiece has rung down
      bench.Enable();
      bench.RunTest();
      EXPECT_EQ(bench.Get(AXIS_OBJ_FAULT), c.fault) << c.name;
      EXPECT_EQ(bench.Passed(), c.fault == AXIS_FAULT_NONE) << c.name;
      EXPECT_LT(bench.plant().signal("sensor.spring_force"), 60.0) << c.name;
      if (bench.Passed()) {
        EXPECT_LT(bench.Get(AXIS_OBJ_FIRST_MOTION_FORCE), -512) << "two counts less";
        EXPECT_EQ(bench.fw().drive.guards.first_motion.phase, FIRST_MOTION_DONE)
            << "no watch is needed";
      }
    }
  }
}

// A pad so soft that 0.2 mm change the reading by less than contact_force: 4 N, a code or two.
TEST(FirstMotion, ASoftContactIsJudgedByItsLastCode) {
  for (const int sign : {1, -1}) {
    Bench bench(InContact({{"k_s", 20000.0}}, 0.0006));
    bench.Set(AXIS_OBJ_FIRST_MOTION_COUNTS, 32);
    bench.Set(AXIS_OBJ_FORCE_SIGN, sign);
    bench.Tick(6000);
    bench.Enable();
    bench.RunTest();
    EXPECT_EQ(bench.Get(AXIS_OBJ_FAULT), sign > 0 ? AXIS_FAULT_NONE : AXIS_FAULT_FORCE_REVERSED);
    const int change = -sign * bench.Get(AXIS_OBJ_FIRST_MOTION_FORCE);
    EXPECT_GE(change, 256);
    EXPECT_LE(change, 512);
    EXPECT_EQ(bench.fw().drive.guards.first_motion.phase,
              sign > 0 ? FIRST_MOTION_WATCHING : FIRST_MOTION_OPEN);
  }
}

// Out of contact the first touch shows it: off in the tick whose reading falls below zero.
TEST(FirstMotion, TheFirstTouchShowsAReversedForceSign) {
  for (const int mode : {3, 4, 9, 10, -1}) {
    for (const int sign : {1, -1}) {
      Bench bench("laboratory.toml", kSigned);
      bench.Set(AXIS_OBJ_FORCE_SIGN, sign);
      bench.Enable(mode);
      bench.RunTest();
      ASSERT_TRUE(bench.Passed());
      EXPECT_EQ(bench.fw().drive.guards.first_motion.phase, FIRST_MOTION_WATCHING);
      bench.Set(AXIS_OBJ_TARGET_VELOCITY, 2000);
      bench.Set(AXIS_OBJ_APPROACH_VELOCITY_MAX, 2000);
      bench.Set(AXIS_OBJ_TARGET_FORCE, 200);
      bench.Set(AXIS_OBJ_FORCE_SETPOINT, 10 * 256);
      bench.Set(AXIS_OBJ_FORCE_GAIN, 2 * 256);
      int reading = 0;
      for (int i = 0;
           i < 6000 && bench.fw().drive.guards.first_motion.phase == FIRST_MOTION_WATCHING; ++i) {
        bench.Tick();
        reading = bench.Get(AXIS_OBJ_FORCE);
      }
      ASSERT_NE(bench.fw().drive.guards.first_motion.phase, FIRST_MOTION_WATCHING)
          << "mode " << mode;
      if (sign > 0) {
        EXPECT_EQ(bench.Get(AXIS_OBJ_FAULT), 0) << "mode " << mode;
        EXPECT_GT(reading, 512);
        bench.Tick(300);
        EXPECT_EQ(bench.Get(AXIS_OBJ_FAULT), 0) << "mode " << mode;
      } else {
        bench.ExpectFinding(FOUND(FORCE_REVERSED), 0xFF11, "mode " + std::to_string(mode));
        EXPECT_LT(reading, -512);
        EXPECT_GT(reading, -2048) << "within a tick or two of the touch";
      }
    }
  }
}

// Each bound alone.
TEST(FirstMotion, BoundsHold) {
  Bench code("laboratory.toml", {{"encoder_scale", 1e-6}});
  code.Set(AXIS_OBJ_FIRST_MOTION_CODE, 30);
  code.Enable();
  const int ticks = code.RunTest();
  EXPECT_EQ(code.Get(AXIS_OBJ_FAULT), AXIS_FAULT_NO_MOTION);
  EXPECT_EQ(code.Largest(), 30);
  EXPECT_EQ(code.Get(AXIS_OBJ_FIRST_MOTION_CODE_REACHED), -30);
  EXPECT_LE(ticks, 64 + 90 + 2 * 30 + 300 + 4) << "time";

  // 1000 times as many counts a metre: the first tick of motion is further than eight times 2
  // counts.
  Bench travel("laboratory.toml", {{"encoder_scale", 157480300.0}});
  travel.Set(AXIS_OBJ_FIRST_MOTION_SPEED, 2048);
  travel.Set(AXIS_OBJ_FIRST_MOTION_COUNTS, 2);
  travel.Enable();
  travel.RunTest();
  EXPECT_EQ(travel.Get(AXIS_OBJ_FAULT), AXIS_FAULT_RUNAWAY);
  EXPECT_LT(std::abs(travel.Get(AXIS_OBJ_VELOCITY)), 2048);

  Bench speed("laboratory.toml", {{"encoder_scale", 1574803.0}});
  speed.Set(AXIS_OBJ_FIRST_MOTION_COUNTS, 4096);
  speed.Enable();
  while (speed.Running() || speed.Get(AXIS_OBJ_FAULT) == 0) {
    ASSERT_LE(std::abs(speed.Get(AXIS_OBJ_VELOCITY)), 16) << "not one tick beyond the bound";
    speed.Tick();
  }
  EXPECT_EQ(speed.Get(AXIS_OBJ_FAULT), AXIS_FAULT_RUNAWAY);
}

// The bounds hold on the way back, too.
TEST(FirstMotion, ARunawayOnTheWayBackIsOffInItsTick) {
  for (const int jump : {20, -20}) {
    Bench bench("laboratory.toml");
    bench.Enable();
    while (bench.fw().drive.guards.first_motion.phase != FIRST_MOTION_BACK) bench.Tick();
    bench.Tick(2);
    ASSERT_EQ(bench.out().amp_enable, 1);
    bench.alter = [jump](SensorCodes &c) { c.encoder += jump; };
    bench.Tick();
    bench.ExpectFinding(FOUND(RUNAWAY), 0xFF10, "20 counts in a tick");
  }
}

// A reading that falls while the axis leaves a workpiece that holds it is no reversed sign.
TEST(FirstMotion, PullingIsNoReversedForce) {
  Bench bench("laboratory.toml", kSigned);
  bench.Enable(3);
  bench.RunTest();
  ASSERT_TRUE(bench.Passed());
  bench.Set(AXIS_OBJ_TARGET_VELOCITY, -3000);
  bench.Tick(600);
  bench.alter = [](SensorCodes &c) { c.adc[0] = 100; };
  bench.Tick(600);
  EXPECT_LT(bench.Get(AXIS_OBJ_VELOCITY_ACTUAL), -2500);
  EXPECT_EQ(bench.Get(AXIS_OBJ_FAULT), 0);
  EXPECT_EQ(bench.fw().drive.guards.first_motion.phase, FIRST_MOTION_WATCHING);
}

// Modes that move by the position law are refused without its gain, others are not.
TEST(FirstMotion, ModesThatNeedAPositionGain) {
  const int with[] = {1, 3, 4, 6, 8, 9, 10, -4, -5};
  const int without[] = {0, -1, -2, -3, -6, -7, -8};
  for (const int mode : with) {
    Bench bench("laboratory.toml");
    bench.Set(AXIS_OBJ_POSITION_GAIN, 0);
    bench.Enable(mode);
    bench.Tick();
    bench.ExpectFinding(FOUND(POSITION_GAIN_ZERO), 0xFF12, "mode " + std::to_string(mode));
    EXPECT_EQ(bench.Largest(), 0);
  }
  for (const int mode : {-1, -6, -7, -8}) {
    Bench bench("laboratory.toml");
    bench.Set(AXIS_OBJ_POSITION_GAIN, 0);
    bench.Set(AXIS_OBJ_TOUCH_VELOCITY_MAX, 3000);
    bench.Enable(mode);
    bench.Tick();
    bench.ExpectFinding(FOUND(POSITION_GAIN_ZERO), 0xFF12, "bounded " + std::to_string(mode));
  }
  for (const int mode : without) {
    Bench bench("laboratory.toml");
    bench.Set(AXIS_OBJ_POSITION_GAIN, 0);
    bench.Enable(mode);
    bench.RunTest();
    EXPECT_TRUE(bench.Passed()) << mode;
    // Also when it is changed to one that does.
    bench.Tick(20);
    bench.Set(AXIS_OBJ_MODES_OF_OPERATION, kPosition);
    bench.Tick(600);
    bench.ExpectFinding(FOUND(POSITION_GAIN_ZERO), 0xFF12, "changed");
  }
  Bench off("laboratory.toml");
  off.Set(AXIS_OBJ_FIRST_MOTION_TEST, 0);
  off.Set(AXIS_OBJ_POSITION_GAIN, 0);
  off.Enable();
  off.Tick(100);
  EXPECT_EQ(off.Get(AXIS_OBJ_FAULT), 0) << "the option is off";
  EXPECT_EQ(off.Get(AXIS_OBJ_FIRST_MOTION_RESULT), AXIS_FIRST_MOTION_RESULT_NOT_RUN);
}

// The port itself moves the axis as it likes.
TEST(FirstMotion, NativeModesOfThePortAreExempt) {
  Bench bench("laboratory.toml");
  bench.Set(AXIS_OBJ_OPEN_LOOP_CODE, -50);
  bench.Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  bench.Tick();
  EXPECT_EQ(bench.State(), kEnabled);
  EXPECT_EQ(bench.out().amp_enable, 1);
  EXPECT_EQ(bench.Get(AXIS_OBJ_FIRST_MOTION_RESULT), AXIS_FIRST_MOTION_RESULT_NOT_RUN);
  EXPECT_EQ(bench.Get(AXIS_OBJ_OPEN_LOOP_CODE), -50);
}

// The user's code in open loop is overridden during the test, and begins without a step after it.
TEST(FirstMotion, OpenLoopBeginsWithoutAStep) {
  Bench bench("laboratory.toml");
  bench.Set(AXIS_OBJ_OPEN_LOOP_CODE, -400);
  bench.Enable(-2);
  while (bench.Running()) {
    EXPECT_EQ(bench.Get(AXIS_OBJ_OPEN_LOOP_CODE), -400);
    bench.Tick();
  }
  ASSERT_TRUE(bench.Passed());
  int before = bench.out().dac_code;
  for (int i = 0; i < 1000; ++i) {
    bench.Tick();
    EXPECT_LT(std::abs(bench.out().dac_code - before), 60) << "tick " << i;
    before = bench.out().dac_code;
  }
  EXPECT_EQ(before, -400);
}

}  // namespace
