// Parts of random programs on an axis whose force sensor fails, against an oracle that sees the
// true force. The programs are valid mutations of the five examples. The oracle is written from
// docs/guide/cycles.md, firmware/cycle/sample.h and the pages of the protections; from the firmware
// it takes only what any client can read in each tick: phase, state, code of the force, DAC code.
//
//   CYCLE_PARTS=100000 build/release/tests/loop/test_loop --gtest_filter='CycleTruth.*'
//
// presses 100,000 parts and prints the table of docs/guide/cycles.md: for each failure of the
// sensor, how often a part was good whose true force was beyond a bound, and by how much.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "host/run/experiment.hpp"
#include "tests/firmware/unit/cycle_records.hpp"

namespace forceaxis::host {
namespace {

// The examples have 16 bits, 100 codes a newton, and an encoder count of 1 um.
constexpr double kCodesPerN = 100.0;
constexpr int kTop = 65535;
constexpr double kCountsPerCode = 0.02;  // speed of the axis in counts a tick and code
constexpr double kDriveMax_N = 1500;     // the drive stalls at this force
constexpr int kTicksMax = 15000;
constexpr int kNotBound = 1 << 30;

enum Failure { kHealthy, kEnd, kClipped, kOldForce, kOldPosition, kStuck, kJump, kDead, kFailures };
const char *const kNames[] = {"none",
                              "force beyond the range of the converter",
                              "amplifier that clips within the range",
                              "force that is old",
                              "position that is old",
                              "stuck code",
                              "jump of the zero",
                              "dead: one code, or an end of the range"};

struct Random {
  std::mt19937_64 engine;
  double real(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine);
  }
  int pick(int low, int high) { return std::uniform_int_distribution<int>(low, high)(engine); }
  bool chance(double p) { return real(0, 1) < p; }
};

// A record of a program with its parts.
struct Record {
  std::vector<std::uint32_t> words;
  const cycle_header_t *header() const {
    return reinterpret_cast<const cycle_header_t *>(words.data());
  }
  cycle_phase_t *phases() { return const_cast<cycle_phase_t *>(cycle_phases(header())); }
  cycle_element_t *elements() { return const_cast<cycle_element_t *>(cycle_elements(header())); }
  bool complete() {
    auto *bytes = reinterpret_cast<std::uint8_t *>(words.data());
    words.back() = Crc32(bytes, 4 * words.size() - 4);
    return cycle_program_check(words.data(), static_cast<std::uint32_t>(4 * words.size())).reason ==
           CYCLE_ACCEPTED;
  }
};

void mutate_phase(Random &random, cycle_phase_t &phase) {
  const auto scale = [&](std::uint32_t &value, double p, double low, double high) {
    if (random.chance(p))
      value = static_cast<std::uint32_t>(std::max(1.0, value * random.real(low, high)));
  };
  scale(phase.force_max_q8, 0.7, 0.7, 3);
  phase.force_max_q8 =
      std::min<std::uint32_t>(phase.force_max_q8, random.chance(0.1) ? 65535 : 64500);
  scale(phase.travel_max, 0.5, 0.8, 6);
  scale(phase.time_max, 0.5, 0.8, 6);
  if (phase.speed != 0) scale(phase.speed, 0.6, 0.6, 4);
  if (phase.slope != 0) scale(phase.slope, 0.5, 0.5, 6);
  if (phase.force != 0 && random.chance(0.4))
    phase.force =
        static_cast<std::int16_t>(std::clamp(phase.force * random.real(0.2, 1.3), 1.0, 1000.0));
  if (phase.action == CYCLE_PRESS && random.chance(0.1)) {  // moves on in contact instead
    phase.action = CYCLE_MOVE_BY;
    phase.force = 0;
    phase.slope = 0;
    phase.target = random.pick(-500, 1500);
    phase.speed = static_cast<std::uint32_t>(random.pick(200, 20000));
  } else if ((phase.action == CYCLE_PRESS || phase.action == CYCLE_MOVE_BY) &&
             random.chance(0.05)) {
    phase.action = CYCLE_WAIT;
    phase.force = 0;
    phase.slope = phase.speed = 0;
    phase.target = 0;
  }
  for (cycle_condition_t &end : phase.conditions) {
    if (end.when == CYCLE_REACHED && phase.action == CYCLE_WAIT)
      end = {CYCLE_TIME, end.next, end.count, 200};
    if (end.level == 0 || !random.chance(0.3)) continue;
    const double level = end.level * random.real(0.3, 1.2);
    end.level = static_cast<std::int32_t>(std::clamp(level, -1e9, 1e9));
    if (end.level == 0) end.level = 1;
  }
}

void mutate_element(Random &random, int phases, cycle_element_t &element) {
  const bool has_bounds = element.kind <= CYCLE_LAST;
  if (has_bounds && random.chance(0.8)) element.y_least = INT32_MIN;
  if (has_bounds && random.chance(0.5)) element.y_most = INT32_MAX;
  for (std::int32_t *bound : {&element.y_least, &element.y_most})
    if (has_bounds && *bound != INT32_MIN && *bound != INT32_MAX && random.chance(0.5))
      *bound = static_cast<std::int32_t>(std::clamp(*bound * random.real(0.5, 1.6), -2e9, 2e9));
  if (element.y_least > element.y_most) std::swap(element.y_least, element.y_most);
  if (random.chance(0.2))
    element.phases = static_cast<std::uint16_t>(1 << random.pick(0, phases - 1));
  // Most windows, envelopes and crossings become a peak: they fit only the part of the example.
  const bool is_special = element.kind >= CYCLE_WINDOW || element.kind == CYCLE_DIFFERENCE;
  if ((is_special || element.kind == CYCLE_AT) && random.chance(is_special ? 0.9 : 0.6)) {
    const std::uint16_t own = element.phases;
    element = cycle_element_t{};
    element.kind = static_cast<std::uint8_t>(random.pick(0, 2) == 0 ? CYCLE_LAST : CYCLE_PEAK);
    element.phases = own;
    element.x_least = -CYCLE_TRAVEL_MAX;
    element.x_most = CYCLE_TRAVEL_MAX;
    element.y_least = random.chance(0.7) ? INT32_MIN : random.pick(500, 20000);
    element.y_most = random.pick(4000, 60000);
    if (element.y_least > element.y_most) element.y_least = INT32_MIN;
  }
}

Record mutated(Random &random, const Record &base) {
  for (;;) {
    Record record = base;
    const int phases = base.header()->phases;
    for (int i = 0; i < phases; ++i) mutate_phase(random, record.phases()[i]);
    for (int i = 0; i < base.header()->elements; ++i)
      mutate_element(random, phases, record.elements()[i]);
    if (record.complete()) return record;
  }
}

// Turns of a press and of a phase that controls no force, which the examples do not have.
Record turns(Random &random) {
  cycle_phase_t press = wait_phase(CYCLE_END), other = press;
  press.force_max_q8 = other.force_max_q8 = static_cast<std::uint32_t>(random.pick(20000, 64500));
  press.travel_max = other.travel_max = CYCLE_TRAVEL_MAX;
  press.time_max = other.time_max = 10000;
  press.action = CYCLE_PRESS;
  press.force = static_cast<std::int16_t>(random.pick(30, 600));
  press.slope = static_cast<std::uint32_t>(random.pick(300, 9000));
  press.conditions[0] = {CYCLE_TIME, 1, 0,
                         random.chance(0.3) ? random.pick(1, 4) : random.pick(5, 300)};
  const int actions[] = {CYCLE_WAIT, CYCLE_OUTPUT, CYCLE_MOVE_BY, CYCLE_MOVE_BY};
  other.action = static_cast<std::uint8_t>(actions[random.pick(0, 3)]);
  if (other.action == CYCLE_OUTPUT) other.outputs_on = 1;
  if (other.action == CYCLE_MOVE_BY) {
    other.target = random.chance(0.5) ? random.pick(-20, 400) : random.pick(1000, 8000);
    other.speed = static_cast<std::uint32_t>(random.pick(1000, 20000));
  }
  const bool is_far = other.target > 400;
  const std::int32_t ticks = is_far               ? random.pick(60, 800)
                             : random.chance(0.5) ? 1
                                                  : random.pick(2, 60);
  other.conditions[0] = {CYCLE_TIME, 0, static_cast<std::uint16_t>(random.pick(1, is_far ? 2 : 60)),
                         ticks};
  other.conditions[1] = {CYCLE_TIME, CYCLE_END, 0, ticks};
  Record record{completed({}, {press, other}, [&](cycle_element_t &peak) {
    peak.y_most = random.chance(0.5) ? INT32_MAX : random.pick(5000, 60000);
  })};
  (void)record.complete();
  return record;
}

// A workpiece: soft from `place` on, stiff from `shoulder` on. Force in N over counts.
struct Workpiece {
  double place, soft, shoulder, stiff;
  double force(double x) const {
    const double depth = x - place;
    if (depth <= 0) return 0;
    return depth <= shoulder ? depth * soft : shoulder * soft + (depth - shoulder) * stiff;
  }
};

struct Protections {
  int railed_ms = 0, jump_q8 = 0, stuck_travel = 0, stuck_ms = 0;
  int disconnected_code = 0, disconnected_ms = 0, disconnected_travel = 0;
  int contact_travel = 0, approach_ms = 0, approach_travel = 0;
  bool watch_sensor() const { return railed_ms + jump_q8 + stuck_travel + disconnected_code != 0; }
  int ticks(int ms) const { return (3 * ms + 1) / 2; }
};

Protections drawn_protections(Random &random) {
  Protections p;
  const double watch = random.chance(0.7) ? 0.5 : 0;  // for each protection of the sensor
  if (random.chance(watch)) p.railed_ms = random.pick(1, 30);
  if (random.chance(watch)) p.jump_q8 = random.pick(1500, 20000);
  if (random.chance(watch)) {
    p.stuck_travel = random.pick(10, 60);
    p.stuck_ms = random.pick(50, 1000);
  }
  if (random.chance(watch)) {
    p.disconnected_code = random.pick(5, 100);
    p.disconnected_ms = random.pick(10, 300);
    p.disconnected_travel = random.pick(2, 60);
  }
  if (random.chance(0.5)) p.contact_travel = random.pick(300, 5000);
  if (random.chance(0.2)) p.approach_ms = random.pick(50, 1000);
  if (random.chance(0.2)) p.approach_travel = random.pick(100, 4000);
  return p;
}

// What the oracle sees of a tick.
struct Tick {
  double force_N, place;  // true
  int code, force_age, position_age, dac_code;
  int phase;  // that ran in this tick
};

struct Part {
  std::vector<Tick> ticks;
  int state = AXIS_CYCLE_STATE_IDLE, ended_by = 0, outcome = 0;
  double reference = 0;
  bool has_write = false;  // something that decides the part was changed while the cycle ran
};

class Axis {
 public:
  Axis(const Experiment &experiment, Random &random) : random_(random) {
    firmware_ = std::make_unique<fw_t>();
    const fw_config_t config{};
    fw_init(firmware_.get(), &config);
    for (const ObjectWrite &write : experiment.initial) set(write.object, write.raw);
    set(AXIS_OBJ_CONTROLWORD, 0);
  }

  int set(std::uint16_t object, std::int32_t value) {
    return fw_object_write(firmware_.get(), FW_SOURCE_LOCAL, object, value);
  }
  int read(std::uint16_t object) const {
    std::int32_t value = 0;
    (void)fw_object_read(firmware_.get(), object, &value);
    return value;
  }

  void protect(const Protections &p) {
    set(AXIS_OBJ_FORCE_RAILED_TIME, p.railed_ms);
    set(AXIS_OBJ_FORCE_JUMP_MAX, p.jump_q8);
    set(AXIS_OBJ_FORCE_STUCK_TRAVEL, p.stuck_travel);
    set(AXIS_OBJ_FORCE_STUCK_TIME, p.stuck_ms);
    set(AXIS_OBJ_FORCE_DISCONNECTED_CODE, p.disconnected_code);
    set(AXIS_OBJ_FORCE_DISCONNECTED_TIME, p.disconnected_ms);
    set(AXIS_OBJ_FORCE_DISCONNECTED_TRAVEL, p.disconnected_travel);
    set(AXIS_OBJ_CONTACT_TRAVEL_MAX, p.contact_travel);
    set(AXIS_OBJ_APPROACH_TIMEOUT, p.approach_ms);
    set(AXIS_OBJ_APPROACH_TRAVEL_MAX, p.approach_travel);
  }

  // The sensor fails from tick `at` of the cycle on.
  void fail(Failure failure, int at) {
    failure_ = failure;
    at_ = at;
    clip_ = static_cast<int>(zero_ + random_.real(20, 300) * kCodesPerN);
    period_ = random_.pick(2, 16);
    jump_ = static_cast<int>(random_.real(-400, 400) * kCodesPerN);
    const int ends[] = {zero_, kTop, 0, 0, random_.pick(0, kTop)};
    dead_ = ends[random_.pick(0, 4)];
  }

  void tick(int of_cycle) {
    const double force = workpiece.force(place_);
    const int right = std::clamp(static_cast<int>(std::floor(force * kCodesPerN + 0.5)) + zero_ +
                                     random_.pick(-noise_, noise_),
                                 0, kTop);
    const bool fails = of_cycle >= at_;
    const int since = of_cycle - at_;
    const auto counts = static_cast<std::int32_t>(std::floor(place_ + 0.5));
    inputs_.encoder_cnt = counts;
    inputs_.position_age = inputs_.force_age = 0;
    int code = right;
    if (fails) {
      const bool is_new = since % period_ == 0;
      if (failure_ == kClipped) code = std::min(right, clip_);
      if (failure_ == kOldForce && !is_new) {
        code = inputs_.adc_code[0];
        inputs_.force_age = static_cast<std::uint8_t>(since % period_);
      }
      if (failure_ == kOldPosition) {
        if (is_new) held_ = counts;
        inputs_.encoder_cnt = held_;
        inputs_.position_age = static_cast<std::uint8_t>(since % period_);
      }
      if (failure_ == kStuck) code = inputs_.adc_code[0];
      if (failure_ == kJump) code = std::clamp(right + jump_, 0, kTop);
      if (failure_ == kDead) code = dead_;
    } else {
      held_ = counts;
    }
    inputs_.adc_code[0] = static_cast<std::uint16_t>(code);
    last = {force,
            place_,
            code,
            inputs_.force_age,
            inputs_.position_age,
            0,
            read(AXIS_OBJ_CYCLE_PHASE)};
    fw_tick(firmware_.get(), &inputs_, &outputs_);
    last.dac_code = outputs_.dac_code;
    if (outputs_.amp_enable != 0 && (force < kDriveMax_N || outputs_.dac_code < 0))
      place_ += kCountsPerCode * outputs_.dac_code;
  }

  // Enables the axis in mode -9, homed. Returns false if it does not come on.
  bool enable() {
    set(AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_CYCLE);
    for (int i = 0; i < 4; ++i) tick(-kNotBound);
    for (const int word : {6, 7, 15}) {
      set(AXIS_OBJ_CONTROLWORD, word);
      tick(-kNotBound);
    }
    firmware_->drive.homed = 1;
    return read(AXIS_OBJ_DRIVE_STATE) == AXIS_DRIVE_STATE_OPERATION_ENABLED;
  }

  Part press(const Record &record) {
    Part part;
    const void *words = record.words.data();
    (void)fw_select_program(firmware_.get(), words,
                            static_cast<std::uint32_t>(4 * record.words.size()));
    // The user unit is the encoder count, and the reference is at count 0.
    part.reference = record.header()->zero_level;
    set(AXIS_OBJ_CONTROLWORD, 31);
    for (int t = 0; t < kTicksMax; ++t) {
      part.state = read(AXIS_OBJ_CYCLE_STATE);
      if (part.state != AXIS_CYCLE_STATE_RUNNING) break;
      if (random_.chance(0.0003)) part.has_write |= write();
      tick(t);
      part.ticks.push_back(last);
    }
    if (part.state == AXIS_CYCLE_STATE_RUNNING) set(AXIS_OBJ_CONTROLWORD, 15);  // too long
    for (int t = 0; t < 3; ++t) tick(kNotBound);
    part.state = read(AXIS_OBJ_CYCLE_STATE);
    part.ended_by = read(AXIS_OBJ_CYCLE_ENDED_BY);
    part.outcome = read(AXIS_OBJ_CYCLE_OUTCOME);
    return part;
  }

  Workpiece workpiece{};
  Tick last{};
  int zero_ = 0, noise_ = 1;

 private:
  // Tries to change what decides the part. Returns true if a change was taken.
  bool write() {
    struct Try {
      std::uint16_t object;
      int value;
    };
    const Try tries[] = {{AXIS_OBJ_FORCE_TARE, random_.pick(-2000, 2000)},
                         {AXIS_OBJ_FORCE_SCALE, random_.pick(1, 9999999)},
                         {AXIS_OBJ_FORCE_ZERO_CODE, random_.pick(0, 20000)},
                         {AXIS_OBJ_ADC_BITS, random_.pick(8, 15)},
                         {AXIS_OBJ_CYCLE_AGE_MAX, random_.pick(4, 254)},
                         {AXIS_OBJ_FORCE_BANK, random_.pick(0, 2)},
                         {AXIS_OBJ_FORCE_GAIN, random_.pick(0, 65535)},
                         {AXIS_OBJ_FORCE_LIMIT, random_.pick(0, 1000)},
                         {AXIS_OBJ_VELOCITY_MAX, random_.pick(100, 100000)}};
    const Try &one = tries[random_.pick(0, 8)];
    const int before = read(one.object);
    return set(one.object, one.value) == FW_OK && read(one.object) != before;
  }

  Random &random_;
  std::unique_ptr<fw_t> firmware_;
  axis_inputs_t inputs_{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
  axis_outputs_t outputs_{};
  double place_ = 0;
  Failure failure_ = kHealthy;
  int at_ = kNotBound, clip_ = kTop, period_ = 1, jump_ = 0, dead_ = 0;
  std::int32_t held_ = 0;
};

// The oracle. `zero` is the code without a force, `zero_code` and `age_max` are parameters of the
// axis, `contact` is contact_force in codes.
struct Oracle {
  const Record &record;
  const Part &part;
  const Protections &protections;
  int zero, zero_code, age_max, contact;

  const cycle_phase_t &phase(const Tick &t) const { return cycle_phases(record.header())[t.phase]; }
  bool touches(const Tick &t) const { return std::abs(t.code - zero) > contact; }
  static bool is_press(int action) { return action == CYCLE_PRESS || action == CYCLE_FOLLOW; }

  // An element names the phase, it measures a force or moves by it, or it ends on force.
  bool is_judged(int number) const {
    const cycle_header_t *header = record.header();
    for (int i = 0; i < header->elements; ++i)
      if ((cycle_elements(header)[i].phases >> number & 1) != 0) return true;
    const cycle_phase_t &phase = cycle_phases(header)[number];
    if (phase.action == CYCLE_APPROACH || phase.action == CYCLE_TARE || is_press(phase.action))
      return true;
    for (const cycle_condition_t &end : phase.conditions)
      for (const int when : {CYCLE_FORCE_ABOVE, CYCLE_FORCE_BELOW, CYCLE_CONTACT, CYCLE_LOST,
                             CYCLE_STIFFNESS_ABOVE, CYCLE_STIFFNESS_BELOW})
        if (end.when == when) return true;
    return false;
  }

  // Why the part must not be good, from the samples; empty: nothing forbids it.
  std::string defect() const {
    for (const Tick &t : part.ticks) {
      if (t.code >= kTop || (t.code == 0 && zero_code != 0)) return "a code at an end of the range";
      if ((t.force_age > age_max || t.position_age > age_max) && is_judged(t.phase))
        return "an old sample in a judged phase";
    }
    if (part.has_write) return "a change of the reading in a running cycle";
    for (const auto &check : {jump(), stuck(), disconnected(), travel(), approach()})
      if (!check.empty()) return check;
    return {};
  }

  std::string jump() const {
    if (protections.jump_q8 == 0) return {};
    for (std::size_t i = 4; i < part.ticks.size(); ++i)
      if (std::abs(part.ticks[i].code - part.ticks[i - 1].code) > protections.jump_q8)
        return "a jump of the code";
    return {};
  }

  double speed(std::size_t from, std::size_t to) const {
    double most = 0;
    for (std::size_t i = from + 1; i <= to; ++i)
      most = std::max(most, std::abs(part.ticks[i].place - part.ticks[i - 1].place));
    return most;
  }

  // In contact the axis moves by more than the travel within the time while the code stays. The
  // firmware looks at every fourth tick, in windows that follow each other, so that a travel of
  // four times the bound is beyond what it may miss.
  std::string stuck() const {
    if (protections.stuck_travel == 0) return {};
    const int window = protections.ticks(protections.stuck_ms) - 8;
    std::size_t begin = 4;
    for (std::size_t i = 5; i < part.ticks.size(); ++i) {
      const Tick &now = part.ticks[i];
      if (now.code != part.ticks[i - 1].code || !touches(now)) begin = i;
      for (int lag : {16, 40, 100, 250, 600}) {
        if (lag > window || i < begin + 8 + static_cast<std::size_t>(lag)) continue;
        const std::size_t from = i - static_cast<std::size_t>(lag);
        const double moved = std::abs(now.place - part.ticks[from].place);
        if (moved > 4 * protections.stuck_travel &&
            moved > 4 * protections.stuck_travel + 16 * speed(from, i))
          return "a stuck code";
      }
    }
    return {};
  }

  std::string disconnected() const {
    if (protections.disconnected_code == 0) return {};
    const int ticks = protections.ticks(protections.disconnected_ms) + 8;
    double least = 0, most = 0;
    int lasted = 0;
    for (std::size_t i = 4; i < part.ticks.size(); ++i) {
      const Tick &t = part.ticks[i];
      if (touches(t) || std::abs(t.dac_code) < protections.disconnected_code) lasted = 0;
      least = lasted == 0 ? t.place : std::min(least, t.place);
      most = lasted == 0 ? t.place : std::max(most, t.place);
      if (most - least > protections.disconnected_travel - 1) {
        lasted = 0;
        least = most = t.place;
      }
      const bool is_met = !touches(t) && std::abs(t.dac_code) >= protections.disconnected_code;
      lasted = is_met ? lasted + 1 : 0;
      if (lasted > ticks) return "a sensor that is disconnected";
    }
    return {};
  }

  // From the first contact of the cycle, onward and in contact.
  std::string travel() const {
    if (protections.contact_travel == 0) return {};
    int touching = 0;
    std::optional<double> first;
    int direction = 0;
    for (std::size_t i = 0; i < part.ticks.size(); ++i) {
      const Tick &t = part.ticks[i];
      touching = touches(t) ? touching + 1 : 0;
      if (!first && touching == 5) first = t.place, direction = t.code > zero ? 1 : -1;
      if (first && touching >= 5 && i + 1 < part.ticks.size() &&
          direction * (t.place - *first) > protections.contact_travel + 8 * 41)
        return "a travel in contact beyond its bound";
    }
    return {};
  }

  // The phases that press without contact, together.
  std::string approach() const {
    int ticks = 0, sign = 0;
    double moved = 0;
    for (std::size_t i = 1; i < part.ticks.size(); ++i) {
      const Tick &t = part.ticks[i];
      if (touches(t)) ticks = 0, moved = 0;
      if (!is_press(phase(t).action) || touches(t)) continue;
      const int own = phase(t).force > 0 ? 1 : -1;
      if (phase(t).action == CYCLE_FOLLOW || own != sign) ticks = 0, moved = 0, sign = own;
      ++ticks;
      moved += t.place - part.ticks[i - 1].place;
      if (protections.approach_ms != 0 && ticks > protections.ticks(protections.approach_ms) + 12)
        return "an approach that takes too long";
      if (protections.approach_travel != 0 &&
          std::abs(moved) > protections.approach_travel + 12 * 41)
        return "an approach that goes too far";
    }
    return {};
  }

  // True depth 0: a force, a contact, or the reference.
  std::optional<double> true_zero() const {
    const cycle_header_t *header = record.header();
    if (header->zero == CYCLE_ZERO_POSITION) return part.reference;
    for (const Tick &t : part.ticks) {
      const double codes = t.force_N * kCodesPerN;
      if (header->zero == CYCLE_ZERO_TOUCH ? codes > contact : codes >= header->zero_level)
        return t.place;
    }
    return std::nullopt;
  }

  // By how many units of its value a true value is beyond the bounds of an element, negative
  // within them, with the distance to the nearer one; nothing where the oracle does not know.
  // `force` is the error of a force that it permits a healthy sensor, in codes.
  struct Judgement {
    double beyond, tolerance;
    bool is_force;
  };
  std::optional<Judgement> judge(const cycle_element_t &element) const {
    const bool all_x = element.x_least == -CYCLE_TRAVEL_MAX && element.x_most == CYCLE_TRAVEL_MAX;
    const double infinite = std::numeric_limits<double>::infinity();
    double value = element.kind == CYCLE_VALLEY ? infinite : -infinite;
    double tolerance = 4;
    bool found = false;
    const bool is_extreme = element.kind == CYCLE_PEAK || element.kind == CYCLE_VALLEY;
    if (!(all_x && (is_extreme || element.kind == CYCLE_LAST)) && element.kind != CYCLE_AT)
      return std::nullopt;
    if (element.kind == CYCLE_AT && (element.of_force == 0 || element.ordinal != 1 ||
                                     element.direction != CYCLE_RISING || element.over_time != 0))
      return std::nullopt;
    const auto zero_at = true_zero();
    bool zeroed = record.header()->zero == CYCLE_ZERO_POSITION;
    const Tick *before = nullptr;
    for (const Tick &t : part.ticks) {
      if (zero_at && t.place == *zero_at && !zeroed) zeroed = true, before = nullptr;
      if ((element.phases >> t.phase & 1) == 0) {
        before = nullptr;
        continue;
      }
      const double codes = t.force_N * kCodesPerN;
      if (element.kind == CYCLE_PEAK) value = std::max(value, codes), found = true;
      if (element.kind == CYCLE_VALLEY) value = std::min(value, codes), found = true;
      if (element.kind == CYCLE_LAST) value = codes, found = true;
      if (element.kind == CYCLE_AT && !found && zeroed && before != nullptr && zero_at) {
        const double from = before->force_N * kCodesPerN;
        if (from < element.level && codes >= element.level) {
          const double share = (element.level - from) / (codes - from);
          value = before->place + share * (t.place - before->place) - *zero_at;
          tolerance = 3 + 2 * std::abs(t.place - before->place);
          found = true;
        }
        // A level that the noise of the reading may or may not cross decides nothing.
        if (std::abs(codes - element.level) < 4 && t.place <= before->place) return std::nullopt;
      }
      before = &t;
    }
    if (!found) return std::nullopt;
    const double beyond = std::max(value - element.y_most, element.y_least - value);
    return Judgement{beyond, tolerance, element.kind != CYCLE_AT};
  }

  // Largest error of a true force beyond the bounds of an element, in N; 0: none beyond 5 codes.
  double true_error_N() const {
    double error = 0;
    for (int i = 0; i < record.header()->elements; ++i) {
      const auto found = judge(cycle_elements(record.header())[i]);
      if (found && found->is_force && found->beyond > 5)
        error = std::max(error, found->beyond / kCodesPerN);
    }
    for (const Tick &t : part.ticks) {
      const double over = t.force_N * kCodesPerN - phase(t).force_max_q8;
      if (over > 5) error = std::max(error, over / kCodesPerN);
    }
    return error;
  }

  // What the true force says about a part of a healthy sensor: 1 good, -1 not good, 0 not known.
  int verdict() const {
    if (part.ended_by == 0 || part.state == AXIS_CYCLE_STATE_ABORTED) return 0;
    std::size_t begin = 0;
    for (std::size_t i = 0; i < part.ticks.size(); ++i) {
      const Tick &t = part.ticks[i];
      if (i > 0 && t.phase != part.ticks[i - 1].phase) begin = i;
      const cycle_phase_t &own = phase(t);
      const double travel = std::abs(t.place - part.ticks[begin > 0 ? begin - 1 : 0].place);
      if (t.force_N * kCodesPerN > own.force_max_q8 - 4.0 || travel > own.travel_max - 3.0 ||
          i + 2 - begin >= own.time_max || t.code + 4 >= kTop)
        return 0;
    }
    bool known = true;
    for (int i = 0; i < record.header()->elements; ++i) {
      const auto found = judge(cycle_elements(record.header())[i]);
      if (!found) continue;
      if (found->beyond > found->tolerance) return -1;
      known = known && found->beyond < -found->tolerance;
    }
    return known ? 1 : 0;
  }
};

struct Row {
  long parts = 0, good = 0, wrong = 0;
  double error_N = 0;
};

TEST(CycleTruth, NoPartIsGoodOnSamplesThatAreNotValid) {
  std::vector<Experiment> experiments;
  for (const char *name : {"press_fit", "spring_test", "snap_fit", "leak_plug", "polishing"})
    experiments.push_back(
        load_experiment(std::string(SIM_DIR "/experiments/") + name + ".toml", {}));
  const char *wanted = std::getenv("CYCLE_PARTS");
  const long parts = wanted == nullptr ? 1500 : std::strtol(wanted, nullptr, 10);
  // without and with protections of the sensor
  std::array<std::array<Row, 2>, kFailures> rows{};
  long ticks = 0, touching = 0, known_good = 0, known_bad = 0, forbidden = 0, refused = 0;
  for (long number = 0; number < parts; ++number) {
    SCOPED_TRACE("part " + std::to_string(number));
    Random random{std::mt19937_64(static_cast<std::uint64_t>(number))};
    const Experiment &experiment = experiments[static_cast<std::size_t>(
        random.pick(0, static_cast<int>(experiments.size()) - 1))];
    const Record record =
        random.chance(0.3) ? turns(random) : mutated(random, {experiment.cycle->record});
    const auto failure = static_cast<Failure>(random.pick(0, kFailures - 1));
    const Protections protections = drawn_protections(random);
    Axis axis(experiment, random);
    axis.protect(protections);
    // A sensor whose zero is within the range has less of it for the force.
    const bool near_end = failure == kEnd || random.chance(0.4);
    const int zero_code = !near_end ? 0 : random.pick(1, random.chance(0.5) ? 30000 : 8000);
    axis.set(AXIS_OBJ_FORCE_ZERO_CODE, zero_code);
    axis.set(AXIS_OBJ_TARE_BAND, 65536);
    const int tare = random.chance(0.2) ? random.pick(0, 60) : 0;
    axis.set(AXIS_OBJ_FORCE_TARE, tare);
    axis.zero_ = zero_code + tare;
    const double stiff = random.chance(0.3) ? random.real(0.5, 3.5) : random.real(0.05, 0.5);
    axis.workpiece = {random.real(300, 5000), random.real(0.005, 0.08), random.real(500, 6000),
                      stiff};
    if (failure != kHealthy && failure != kEnd) axis.fail(failure, random.pick(0, 3500));
    ASSERT_TRUE(axis.enable());
    const Part part = axis.press(record);
    Row &row = rows[failure][protections.watch_sensor() ? 1 : 0];

    const double contact = axis.read(AXIS_OBJ_CONTACT_FORCE);
    // The end of the reading less the tare: a program that needs more does not start.
    double most = 0;
    for (int i = 0; i < record.header()->phases; ++i) {
      const cycle_phase_t &phase = cycle_phases(record.header())[i];
      most = std::max<double>(most, phase.force_max_q8);
      for (const cycle_condition_t &end : phase.conditions)
        if (end.when == CYCLE_FORCE_ABOVE) most = std::max<double>(most, end.level);
    }
    if (record.header()->zero == CYCLE_ZERO_FORCE)
      most = std::max<double>(most, record.header()->zero_level);
    const bool fits = most < kTop - axis.zero_;
    ASSERT_EQ(part.state == AXIS_CYCLE_STATE_BEYOND_SENSOR, !fits) << most;
    if (!fits) {
      ++refused;

      continue;
    }
    ++row.parts;
    ASSERT_TRUE(part.state == AXIS_CYCLE_STATE_GOOD || part.state == AXIS_CYCLE_STATE_BAD ||
                part.state == AXIS_CYCLE_STATE_ABORTED)
        << part.state;
    for (const Tick &t : part.ticks) {
      ++ticks;
      touching += t.force_N > 0 ? 1 : 0;
    }
    const bool is_good = part.state == AXIS_CYCLE_STATE_GOOD;
    const Oracle oracle{
        record, part, protections, axis.zero_, zero_code, 3, static_cast<int>(contact)};
    const std::string defect = oracle.defect();
    forbidden += defect.empty() ? 0 : 1;
    ASSERT_FALSE(is_good && !defect.empty()) << kNames[failure] << ": " << defect;
    row.good += is_good ? 1 : 0;
    const double error = oracle.true_error_N();
    if (is_good && error > 0) {
      ++row.wrong;
      row.error_N = std::max(row.error_N, error);
    }
    if (failure != kHealthy || !defect.empty()) continue;
    // Windows, envelopes and what else the oracle does not compute may refuse a part.
    const int verdict = oracle.verdict();
    known_good += verdict > 0 && is_good ? 1 : 0;
    known_bad += verdict < 0 ? 1 : 0;
    ASSERT_FALSE(verdict < 0 && is_good);
    bool all_known = true;
    for (int i = 0; i < record.header()->elements; ++i)
      all_known = all_known && oracle.judge(cycle_elements(record.header())[i]).has_value();
    ASSERT_FALSE(verdict > 0 && all_known && !is_good) << part.outcome;
  }
  EXPECT_GE(3 * touching, ticks) << "in contact for a third of the ticks";
  const long healthy = rows[kHealthy][0].parts + rows[kHealthy][1].parts;
  EXPECT_GT(20 * known_good, healthy);
  EXPECT_GT(40 * known_bad, healthy);
  EXPECT_GT(10 * forbidden, parts);
  EXPECT_GT(10 * (parts - refused), parts);
  std::printf("parts %ld, refused at the start %ld, ticks %ld, in contact %.1f %%, forbidden %ld\n",
              parts, refused, ticks,
              100.0 * static_cast<double>(touching) / static_cast<double>(ticks), forbidden);
  std::printf(
      "| failure of the sensor | 2230h | parts | good | of these beyond a bound | largest, N |\n"
      "| --- | --- | --- | --- | --- | --- |\n");
  for (std::size_t i = 0; i < kFailures; ++i)
    for (const bool on : {false, true}) {
      const Row &row = rows[i][on ? 1 : 0];
      std::printf(
          "| %s | %s | %ld | %ld | %ld (%.2g %%) | %.3g |\n", kNames[i], on ? "some on" : "off",
          row.parts, row.good, row.wrong,
          100.0 * static_cast<double>(row.wrong) / std::max(1.0, static_cast<double>(row.good)),
          row.error_N);
    }
}

}  // namespace
}  // namespace forceaxis::host
