// Co-simulation units: the loop of a plant and a firmware computes the codes of a run, in any
// number of instances, from any saved state; wrong steps and calls are refused in one line.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>

#include "firmware/objects/generated/axis_objects.h"
#include "host/fmu/codes.hpp"
#include "host/fmu/firmware_unit.hpp"
#include "host/fmu/instance.hpp"
#include "host/fmu/plant_unit.hpp"
#include "host/run/run.hpp"
#include "sim/model/elements/all.hpp"

namespace forceaxis::fmu {
namespace {

std::size_t place_of(const Unit &unit, const std::string &name) {
  for (std::size_t i = 0; i < unit.variables().size(); ++i)
    if (unit.variables()[i].name == name) return i;
  throw std::invalid_argument(name);
}

// The values that an experiment gives to the parameters of its model.
std::vector<sim::Override> set_of(const host::Experiment &experiment) {
  std::vector<sim::Override> found;
  for (const sim::Parameter &parameter : experiment.model->parameters)
    if (parameter.overridden) found.push_back({parameter.name, parameter.value});
  return found;
}

// The two units of an experiment, stepped in the order of forceaxis.
struct Loop {
  explicit Loop(const host::Experiment &experiment, std::vector<std::uint16_t> inputs = {})
      : plant(plant_unit(experiment.model->file, set_of(experiment),
                         static_cast<std::int32_t>(experiment.seed))),
        firmware(firmware_unit(
            {experiment, experiment.model->dac->bits,
             experiment.cycle ? experiment.cycle->record : std::vector<std::uint32_t>{},
             std::move(inputs)})) {
    for (const Code &code : kCodes)
      codes.emplace_back(place_of(*plant, code.name), place_of(*firmware, code.name));
    for (const char *name : {"dac_code", "amp_enable", "brake_release"})
      outputs.emplace_back(place_of(*firmware, name), place_of(*plant, name));
  }

  // Computes a tick and returns encoder, ADC 0, ADC 1, DAC and enable.
  std::vector<double> tick() {
    for (const auto &[from, to] : codes) firmware->set(to, plant->get(from));
    std::vector<double> row;
    for (const CodeIndex i : {kEncoder, kAdc0, kAdc1}) row.push_back(plant->get(codes[i].first));
    ++ticks_;
    firmware->advance(ticks_);
    for (const auto &[from, to] : outputs) plant->set(to, firmware->get(from));
    row.push_back(firmware->get(outputs[0].first));
    row.push_back(firmware->get(outputs[1].first));
    plant->advance(ticks_);
    return row;
  }
  std::vector<std::vector<double>> ticks(std::size_t count) {
    std::vector<std::vector<double>> rows;
    for (std::size_t i = 0; i < count; ++i) rows.push_back(tick());
    return rows;
  }

  std::unique_ptr<Unit> plant, firmware;
  std::vector<std::pair<std::size_t, std::size_t>> codes, outputs;
  double ticks_ = 0;
};

host::Experiment load(const std::string &name, double duration_s) {
  std::vector<std::string> overrides{"experiment.duration_s=" + std::to_string(duration_s)};
  return host::load_experiment(SIM_DIR "/experiments/" + name + ".toml", overrides);
}

struct Case {
  const char *experiment;
  double duration_s;
};
void PrintTo(const Case &c, std::ostream *out) { *out << c.experiment; }

class UnitsOf : public testing::TestWithParam<Case> {};

TEST_P(UnitsOf, TheLoopComputesTheCodesOfTheRun) {
  const host::Experiment experiment = load(GetParam().experiment, GetParam().duration_s);
  const host::RunResult run = host::run(experiment);
  Loop loop(experiment);
  for (const host::TickRecord &record : run.records) {
    const std::vector<double> expected{
        static_cast<double>(record.encoder_cnt), static_cast<double>(record.adc0_code),
        static_cast<double>(record.adc1_code), static_cast<double>(record.dac_code),
        static_cast<double>(record.out & 1)};
    ASSERT_EQ(loop.tick(), expected) << "tick " << record.tick;
  }
}

// A P law, a general law, later writes, a profile, homing with switches and index, a cycle, a
// sensor that samples at a rate of its own, and a loop in which the contact is lost again and
// again.
INSTANTIATE_TEST_SUITE_P(Experiments, UnitsOf,
                         testing::Values(Case{"contact", 1.5}, Case{"hold_biquad_12bit", 1.5},
                                         Case{"force_step", 10}, Case{"press_hold_retract", 3},
                                         Case{"move", 1.5}, Case{"homing", 3}, Case{"press_fit", 3},
                                         Case{"fig2_3_sampled", 1.5}, Case{"full_axis", 1.5},
                                         Case{"limit_cycle", 1.5}, Case{"nl_noise", 1.5}));

TEST(Units, AStateIsRestoredCompletely) {
  const host::Experiment experiment = load("press_fit", 4);
  Loop loop(experiment);
  loop.ticks(1200);
  const auto plant = loop.plant->state();
  const auto firmware = loop.firmware->state();
  const auto first = loop.ticks(1500);
  for (int repetition = 0; repetition < 2; ++repetition) {
    loop.plant->restore(*plant);
    loop.firmware->restore(*firmware);
    loop.ticks_ = 1200;
    EXPECT_EQ(loop.ticks(1500), first);
  }
}

TEST(Units, AResetUnitAndASecondUnitAreNew) {
  const host::Experiment experiment = load("force_step", 10);
  Loop one(experiment), two(experiment);
  const auto first = one.ticks(1500);
  one.firmware->set(place_of(*one.firmware, "axis.force_gain"), 1.5);
  one.plant->set(place_of(*one.plant, "model.m_r1"), 90.0);
  one.ticks(10);
  EXPECT_EQ(two.ticks(1500), first);
  one.plant->reset();
  one.firmware->reset();
  one.ticks_ = 0;
  EXPECT_EQ(one.firmware->get(place_of(*one.firmware, "axis.force_gain")),
            two.firmware->get(place_of(*two.firmware, "axis.force_gain")));
  EXPECT_EQ(one.ticks(1500), first);
}

TEST(Units, AParameterOfTheModelHasItsEffectAndAWrongOneIsRefused) {
  const host::Experiment experiment = load("contact", 1);
  const std::vector<std::string> overrides{"experiment.duration_s=1", "m_r1=90"};
  const host::RunResult run =
      host::run(host::load_experiment(SIM_DIR "/experiments/contact.toml", overrides));
  Loop loop(experiment);
  const std::size_t mass = place_of(*loop.plant, "model.m_r1");
  loop.plant->set(mass, -1.0);
  EXPECT_THROW(loop.plant->initialise(), sim::InputError);
  loop.plant->set(mass, 90.0);
  loop.plant->initialise();
  for (const host::TickRecord &record : run.records)
    ASSERT_EQ(loop.tick()[0], static_cast<double>(record.encoder_cnt)) << record.tick;
}

TEST(Units, AnImpulseChangesTheVelocityByImpulseOverMass) {
  const auto plant = plant_unit(SIM_DIR "/models/axis_contact.toml", {}, 0);
  plant->initialise();
  const std::size_t impulse = place_of(*plant, "impulse.workpiece");
  const std::size_t velocity = place_of(*plant, "workpiece.velocity");
  plant->set(impulse, 0.066);  // N s on 6.6 kg
  plant->advance(1);
  plant->set(impulse, 0.0);
  // In one tick the fixture of 412,700 N/m turns the phase by 250 rad/s / 1500 Hz = 0.167.
  EXPECT_NEAR(plant->get(velocity), 0.01 * std::cos(std::sqrt(412700 / 6.6) / 1500), 2e-5);
}

TEST(Units, AWriteThatTheFirmwareRefusesLeavesTheValue) {
  Loop loop(load("contact", 1));
  Unit &firmware = *loop.firmware;
  const std::size_t bits = place_of(firmware, "axis.adc_bits");
  const std::size_t gain = place_of(firmware, "axis.force_gain");
  loop.ticks(2);  // mode force is active, so objects of a disabled axis are refused
  EXPECT_THROW(firmware.set(bits, 12), ValueRefused);
  EXPECT_EQ(firmware.get(bits), 8);
  EXPECT_THROW(firmware.set(gain, 300.0), ValueRefused);
  EXPECT_EQ(firmware.get(gain), 5.0);
  EXPECT_THROW(firmware.set(place_of(firmware, "adc0_code"), 65536), ValueRefused);
  firmware.set(gain, 2.5);
  EXPECT_EQ(firmware.get(gain), 2.5);
}

// An importer sets all inputs at each communication point, although the firmware changes `mode`
// after a fault.
TEST(Units, AnInputThatIsSetAgainStartsNothing) {
  Loop loop(load("contact", 1), {AXIS_OBJ_MODE});
  Unit &firmware = *loop.firmware;
  const std::size_t mode = place_of(firmware, "axis.mode");
  EXPECT_EQ(firmware.variables()[mode].role, Role::input);
  const double force = firmware.get(mode);
  loop.ticks(10);
  firmware.set(place_of(firmware, "enable"), 0);
  firmware.advance(11);
  EXPECT_NE(firmware.get(place_of(firmware, "axis.fault")), 0);
  ASSERT_EQ(firmware.get(mode), 0);
  firmware.set(place_of(firmware, "enable"), 1);
  firmware.set(place_of(firmware, "axis.fault_reset"), 1);
  firmware.set(mode, force);
  firmware.advance(12);
  EXPECT_EQ(firmware.get(place_of(firmware, "axis.fault")), 0);
  EXPECT_EQ(firmware.get(mode), 0);
  firmware.set(mode, 0);
  firmware.set(mode, force);
  EXPECT_EQ(firmware.get(mode), force);
}

// The experiment starts the axis by itself, so the 0 that stops it is not a new value of the input.
TEST(Units, AStopAlwaysActs) {
  for (const bool is_input : {false, true}) {
    std::vector<std::uint16_t> inputs;
    if (is_input) inputs = {AXIS_OBJ_MODE, AXIS_OBJ_CONTROLWORD};
    for (const char *stop : {"axis.mode", "drive.controlword"}) {
      Loop loop(load("press_hold_retract", 3), inputs);
      Unit &firmware = *loop.firmware;
      const std::size_t enable = place_of(firmware, "amp_enable");
      loop.ticks(1500);
      ASSERT_EQ(firmware.get(enable), 1) << stop;
      firmware.set(place_of(firmware, stop), 0);
      loop.ticks(1500);
      EXPECT_EQ(firmware.get(enable), 0) << stop << is_input;
    }
  }
}

constexpr double kTick = 1.0 / 1500;

// The time in ticks after a first step.
double after(double step_s) {
  TickClock clock;
  clock.advance(0, step_s);
  return clock.now();
}

TEST(TickClock, AStepEndsAtATickIfItIsOneButForRounding) {
  EXPECT_EQ(after(kTick), 1);
  EXPECT_EQ(after(0.002), 3);
  EXPECT_EQ(after(1.0), 1500);
  EXPECT_EQ(after(666666e-9), 1);  // cut to ns
  EXPECT_EQ(after(666667e-9), 1);  // rounded to ns
  EXPECT_EQ(after(0.5 * kTick), 0.5);
  EXPECT_EQ(after(0.001), 1.5);
  EXPECT_NEAR(after(1.00001 * kTick), 1.00001, 1e-12);
  for (const double step_s : {0.0, -kTick, 1e9, std::nan(""), HUGE_VAL})
    EXPECT_THROW(after(step_s), StepRefused) << step_s;
  TickClock clock;
  clock.advance(0, kTick);
  for (const double point_s : {0.0, 0.4 * kTick, 2 * kTick, -kTick, 1.0, std::nan("")})
    EXPECT_THROW(clock.advance(point_s, kTick), StepRefused) << point_s;
  EXPECT_THROW(clock.advance(0.99 * kTick, 0.01 * kTick), StepRefused);  // a step made twice
  clock.advance(kTick, 0.01 * kTick);
}

// Importers add the step up, multiply it, or count in ns; the error of the sum is not the unit's.
TEST(TickClock, PointsAreRoundedFarFromTheStart) {
  TickClock added(0.1), multiplied(0.1), tenths(0.1);
  double point_s = 0.1;
  for (int tick = 1; tick <= 1'000'000; ++tick) {
    added.advance(point_s, kTick);
    multiplied.advance(0.1 + (tick - 1) / 1500.0, tick / 1500.0 - (tick - 1) / 1500.0);
    ASSERT_EQ(added.now(), tick);
    ASSERT_EQ(multiplied.now(), tick);
    point_s += kTick;
  }
  EXPECT_NEAR(added.time_s(), 0.1 + 1e6 / 1500, 1e-9);
  for (int k = 1; k <= 300'000; ++k) {
    tenths.advance(0.1 + (k - 1) / 15000.0, 1 / 15000.0);
    ASSERT_EQ(tenths.now() == std::floor(tenths.now()), k % 10 == 0) << k;
  }
}

// A step of 666,667 ns is too long by half a millionth: the tick that this gains comes once.
TEST(TickClock, NanosecondsGetATickInEachStepUntilTheyAreHalfATickApart) {
  TickClock clock;
  std::vector<std::int64_t> doubled;
  for (std::int64_t k = 0; k < 1'500'000; ++k) {
    const double before = clock.now();
    clock.advance(static_cast<double>(k * 666'667) * 1e-9, 666'667e-9);
    if (clock.now() - before == 2)
      doubled.push_back(k);
    else
      ASSERT_EQ(clock.now() - before, 1) << k;
  }
  ASSERT_EQ(doubled.size(), 1U);
  EXPECT_NEAR(static_cast<double>(doubled[0]), 1e6, 2);
}

// Half a tick is no whole number of nanoseconds. An importer cuts or rounds each point.
TEST(TickClock, APointInNanosecondsThatIsATickIsThisTick) {
  for (const std::int64_t more : {0, 1500, 2999}) {
    TickClock clock;
    const auto point_ns = [more](std::int64_t k) { return (k * 1'000'000'000 + more) / 3000; };
    for (std::int64_t k = 0; k < 100'000; ++k) {
      clock.advance(static_cast<double>(point_ns(k)) * 1e-9,
                    static_cast<double>(point_ns(k + 1) - point_ns(k)) * 1e-9);
      ASSERT_EQ(clock.now() == std::floor(clock.now()), k % 2 == 1) << k;
    }
  }
}

// Steps of any length.

// Communication points of a unit: steps below, at and above a tick, in any order.
std::vector<double> drawn_points(unsigned seed, double end) {
  std::mt19937 draw(seed);
  const double lengths[] = {1.5, 0.15, 1.05, 1.0, 3.0, 0.5, 1e-5, 0.97, 40.0};
  std::vector<double> points{0};
  while (points.back() < end) {
    const double next = points.back() + lengths[draw() % std::size(lengths)];
    points.push_back(draw() % 4 == 0 ? std::ceil(next) : next);
  }
  return points;
}

TEST(AnyStep, TheFirmwareComputesEachTickOnceAndHoldsItsOutputs) {
  const host::Experiment experiment = load("press_fit", 3);
  const host::RunResult run = host::run(experiment);
  for (unsigned seed = 0; seed < 20; ++seed) {
    Loop held(experiment), ticked(experiment);
    Unit &unit = *held.firmware, &oracle = *ticked.firmware;
    const std::size_t dac = place_of(unit, "dac_code"), count = place_of(unit, "axis.tick_count");
    const std::vector<double> points = drawn_points(seed, 3000);
    std::size_t tick = 0;  // next tick of the oracle
    for (std::size_t i = 1; i < points.size(); ++i) {
      // The codes of the run, as an importer has them at the communication point.
      const auto at = static_cast<std::size_t>(points[i - 1]);
      if (at >= run.records.size()) break;
      for (Unit *one : {&unit, &oracle}) {
        one->set(kEncoder, run.records[at].encoder_cnt);
        one->set(kAdc0, run.records[at].adc0_code);
      }
      unit.advance(points[i]);
      for (; static_cast<double>(tick) < points[i]; ++tick)
        oracle.advance(static_cast<double>(tick) + 1);
      ASSERT_EQ(unit.get(dac), oracle.get(dac)) << seed << " at " << points[i];
      ASSERT_EQ(unit.get(count), oracle.get(count)) << seed << " at " << points[i];
    }
    EXPECT_GT(tick, 2500U);
  }
}

// At a tick, the plant has the doubles of a plant that is stepped from tick to tick.
TEST(AnyStep, PartsOfATickLeaveTheDoublesOfTheTicks) {
  for (const char *name : {"contact", "nl_noise", "full_axis", "fig2_3_sampled", "press_fit"}) {
    const host::Experiment experiment = load(name, 1);
    const host::RunResult run = host::run(experiment);
    Loop parts(experiment), whole(experiment);
    parts.plant->initialise();
    whole.plant->initialise();
    const std::vector<double> points = drawn_points(7, 1400);
    std::vector<double> cuts = points;
    for (std::size_t tick = 0; tick < 1400; ++tick) cuts.push_back(static_cast<double>(tick));
    std::sort(cuts.begin(), cuts.end());
    for (std::size_t i = 1; i < cuts.size() && cuts[i] < 1400; ++i) {
      const host::TickRecord &record = run.records[static_cast<std::size_t>(cuts[i - 1])];
      for (Unit *plant : {parts.plant.get(), whole.plant.get()}) {
        plant->set(0, record.dac_code);
        plant->set(1, record.out & 1);
        plant->set(2, (record.out >> 1) & 1);
      }
      parts.plant->advance(cuts[i]);
      if (cuts[i] != std::floor(cuts[i]) || cuts[i] == cuts[i - 1]) continue;
      whole.plant->advance(cuts[i]);
      for (std::size_t v = 3; v < parts.plant->variables().size() - 1; ++v)
        ASSERT_EQ(parts.plant->get(v), whole.plant->get(v))
            << name << " " << parts.plant->variables()[v].name << " at " << cuts[i];
    }
  }
}

// The simulator with four steps in a tick has mode matrices of its own. The code changes within
// ticks, while the contact opens and closes.
TEST(AnyStep, ThePlantIsExactWithinATick) {
  for (const char *file : {"axis_contact", "full_axis"}) {
    auto model = std::make_shared<const sim::Model>(
        sim::load_model(SIM_DIR "/models/" + std::string(file) + ".toml"));
    sim::Plant fine(std::make_shared<sim::ModeCache>(model, 4));
    const auto unit = plant_unit(model->file, {}, 0);
    unit->initialise();
    unit->set(1, 1);
    unit->set(2, 1);
    std::mt19937 draw(3);
    std::vector<double> largest(fine.signal_names().size()), error(largest.size());
    for (int quarter = 0; quarter < 6000; ++quarter) {
      const int code =
          quarter % 7 == 0 ? static_cast<int>(draw() % 1600) - 600 : static_cast<int>(unit->get(0));
      unit->set(0, code);
      fine.step(code, true, true);
      unit->advance(0.25 * (quarter + 1));
      for (std::size_t i = 0; i < largest.size(); ++i) {
        const double expected = fine.signal_at(i);
        const double got = unit->get(place_of(*unit, fine.signal_names()[i]));
        largest[i] = std::max(largest[i], std::abs(expected));
        error[i] = std::max(error[i], std::abs(got - expected));
      }
    }
    EXPECT_GT(fine.crossings(), 20) << file;
    for (std::size_t i = 0; i < largest.size(); ++i)
      EXPECT_LE(error[i], 1e-9 * largest[i]) << file << " " << fine.signal_names()[i];
  }
}

class Calls : public testing::Test {
 protected:
  void SetUp() override {
    const auto *test = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::path(testing::TempDir()) / ("units_" + std::string(test->name()));
    std::filesystem::create_directories(folder_);
    std::filesystem::copy_file(SIM_DIR "/models/axis_contact.toml", folder_ / "model.toml",
                               std::filesystem::copy_options::overwrite_existing);
    std::ofstream(folder_ / "forceaxis.unit")
        << "kind = \"plant\"\ntoken = \"t\"\n"
           "model = \"model.toml\"\nseed = 0\nset = { m_w = 3.3 }\n";
  }
  std::unique_ptr<Instance> instance() {
    return std::make_unique<Instance>(
        folder_, "t", [this](Status, const std::string &line) { log_.push_back(line); });
  }
  // The line of the log since the last call, which must be one.
  std::string line() {
    EXPECT_EQ(log_.size(), 1U);
    const std::string text = log_.empty() ? "" : log_.back();
    EXPECT_EQ(text.find('\n'), std::string::npos);
    log_.clear();
    return text;
  }

  std::filesystem::path folder_;
  std::vector<std::string> log_;
};

TEST_F(Calls, ARefusedStepChangesNothing) {
  const auto unit = instance();
  EXPECT_EQ(unit->step(0, 1.0 / 1500), Status::error);
  EXPECT_EQ(line(), "step: expected an instance that is initialized");
  EXPECT_EQ(unit->enter_initialization(), Status::ok);
  EXPECT_EQ(unit->exit_initialization(), Status::ok);
  EXPECT_EQ(unit->step(0, 0.0), Status::error);
  EXPECT_EQ(line(), "step size: expected above 0 s and at most 666666.6666666666 s, got 0 s");
  EXPECT_EQ(unit->time_s(), 0);
  EXPECT_EQ(unit->set(0, of(Type::int32), 2048), Status::ok);
  EXPECT_EQ(unit->step(0, 1.0 / 1500), Status::error);
  EXPECT_EQ(line(), "dac_code: expected a code from -2048 to 2047, got 2048");
  EXPECT_EQ(unit->set(0, of(Type::int32), 100), Status::ok);
  EXPECT_EQ(unit->step(0, 0.002), Status::ok);
  EXPECT_EQ(unit->time_s(), 0.002);
  EXPECT_EQ(unit->step(0, 0.002), Status::error);
  EXPECT_EQ(line(),
            "communication point: expected 0.002 s, got 0 s; continue where the last step has "
            "ended");
}

TEST_F(Calls, WrongReferencesAndTypesAreRefused) {
  const auto unit = instance();
  double value = 0;
  EXPECT_EQ(unit->get(100000, of(Type::real), value), Status::error);
  EXPECT_NE(line().find("value reference 100000: expected one of 0 to "), std::string::npos);
  EXPECT_EQ(unit->get(0, of(Type::real), value), Status::error);
  EXPECT_EQ(line(), "value reference 0: dac_code is an integer; use the function of this type");
  EXPECT_EQ(unit->set(1, of(Type::int32), 1), Status::error);
  EXPECT_EQ(line(), "value reference 1: amp_enable is a Boolean; use the function of this type");
  const std::size_t first_output = 5;  // after three inputs of the firmware and two impulses
  EXPECT_EQ(unit->set(first_output, of(Type::int32), 1), Status::error);
  EXPECT_EQ(line(), "encoder_cnt: an output cannot be set");
  EXPECT_EQ(unit->set(3, of(Type::real), std::nan("")), Status::discard);
  EXPECT_EQ(line(), "impulse.robot: expected a finite number");
}

TEST_F(Calls, AFixedParameterIsFixedAfterTheInitialization) {
  const auto unit = instance();
  const auto plain = plant_unit(folder_ / "model.toml", {}, 0);
  const auto mass = static_cast<std::uint32_t>(place_of(*plain, "model.m_w"));
  double value = 0;
  EXPECT_EQ(unit->get(mass, of(Type::real), value), Status::ok);
  EXPECT_EQ(value, 3.3);  // from `set` of forceaxis.unit
  EXPECT_EQ(unit->enter_initialization(), Status::ok);
  EXPECT_EQ(unit->set(mass, of(Type::real), 5), Status::ok);
  EXPECT_EQ(unit->exit_initialization(), Status::ok);
  EXPECT_EQ(unit->set(mass, of(Type::real), 6), Status::error);
  EXPECT_EQ(line(), "model.m_w: a fixed parameter cannot be set after the initialization");
  EXPECT_EQ(unit->reset(), Status::ok);
  EXPECT_EQ(unit->get(mass, of(Type::real), value), Status::ok);
  EXPECT_EQ(value, 3.3);
}

TEST_F(Calls, AStateBelongsToItsInstance) {
  const auto one = instance(), two = instance();
  for (Instance *unit : {one.get(), two.get()}) {
    EXPECT_EQ(unit->set_start(0.5), Status::ok);
    EXPECT_EQ(unit->enter_initialization(), Status::ok);
    EXPECT_EQ(unit->exit_initialization(), Status::ok);
    EXPECT_EQ(unit->step(0.5, 0.002), Status::ok);
  }
  void *state = nullptr;
  EXPECT_EQ(one->save(state), Status::ok);
  EXPECT_EQ(one->step(0.502, 0.002), Status::ok);
  EXPECT_EQ(two->restore(state), Status::error);
  EXPECT_EQ(line(), "state: expected a state that this instance has saved");
  EXPECT_EQ(one->restore(state), Status::ok);
  EXPECT_EQ(one->step(0.502, 0.002), Status::ok);
  void *const handle = state;
  EXPECT_EQ(one->save(state), Status::ok);
  EXPECT_EQ(state, handle);
  EXPECT_EQ(one->forget(state), Status::ok);
  EXPECT_EQ(state, nullptr);
  EXPECT_EQ(one->restore(handle), Status::error);
  EXPECT_EQ(line(), "state: expected a state that this instance has saved");
  EXPECT_EQ(one->forget(state), Status::ok);
}

TEST_F(Calls, FilesOfDifferentUnitsAreRefused) {
  EXPECT_THROW(Instance(folder_, "other", {}), sim::InputError);
  std::ofstream(folder_ / "forceaxis.unit")
      << "kind = \"plant\"\ntoken = \"t\"\nmodel = 3\nseed = 0\nset = {}\n";
  EXPECT_THROW(Instance(folder_, "t", {}), sim::InputError);
  EXPECT_THROW(Instance(folder_ / "absent", "t", {}), sim::InputError);
}

}  // namespace
}  // namespace forceaxis::fmu
