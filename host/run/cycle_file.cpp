#include "host/run/cycle_file.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include "firmware/port/host/firmware.hpp"
#include "host/run/cycle_conditions.hpp"
#include "sim/hybrid/mode.hpp"
#include "sim/model/elements/adc.hpp"
#include "sim/model/elements/encoder.hpp"
#include "sim/model/section.hpp"
#include "sim/model/text.hpp"
#include "sim/model/toml.hpp"

namespace forceaxis::host {
namespace {

using sim::Dimension;
using sim::Section;
using sim::Sign;

constexpr double kTicks = sim::kTickRateHz;
constexpr const char *kText = "expected a text in quotes";

// The names of all phases. They are read first, because phases, conditions and evaluation elements
// refer to phases by name.
struct Names {
  std::vector<std::string> phases;

  std::uint8_t find(Section &section, const char *key, const std::string &name) const {
    if (name == "end") return CYCLE_END;
    return static_cast<std::uint8_t>(index(section, key, name));
  }
  std::size_t index(Section &section, const char *key, const std::string &name) const {
    const auto found = std::find(phases.begin(), phases.end(), name);
    if (found == phases.end())
      section.fail(key, "expected a phase of this file, got " + sim::in_quotes(name) +
                            sim::suggestion(name, phases) + "; add this phase or correct its name");
    return static_cast<std::size_t>(found - phases.begin());
  }
};

std::int32_t raw_of(const std::vector<ObjectWrite> &initial, std::uint16_t object,
                    std::int32_t fallback) {
  for (const ObjectWrite &write : initial)
    if (write.object == object) fallback = write.raw;
  return fallback;
}

// Counts and codes for each SI unit of the model.
struct Scales {
  double counts_per_m = 0;
  double q8_per_N = 0;  // 1/256 count of measured force
  double rated_N = 0;
  double limit_N = 0;                            // force_limit
  double tare_band_q8 = 0;                       // 0: the axis has no tare
  double position_least = 0, position_most = 0;  // soft limits in counts from the reference
  double span = 0;  // largest travel between two soft limits, in counts
  // Ends of what the force sensor can show in compression and in tension, in 1/256 count; infinite
  // where the force 0 is at an end of the range of codes (firmware/cycle/sample.h).
  double most_q8 = std::numeric_limits<double>::infinity();
  double least_q8 = -std::numeric_limits<double>::infinity();

  Scales(const sim::Source &source, const sim::Model &model,
         const std::vector<ObjectWrite> &initial) {
    if (!model.encoder)
      source.fail("phase", "expected a model with an [encoder], got none; choose another model");
    bool is_force = false;
    if (model.adc[0])
      for (const sim::SignalInfo &signal : model.signal_list())
        is_force |= signal.name == model.adc[0]->signal && signal.dimension == Dimension::force;
    if (!is_force)
      source.fail("phase", "expected a model whose ADC 0 measures a force; choose another model");
    const auto &adc = *model.adc[0];
    counts_per_m = model.encoder->scale;
    const int sign = raw_of(initial, AXIS_OBJ_FORCE_SIGN, 1);
    q8_per_N = 256.0 * sign / (adc.per_count * (1 << (adc.bits - 8)));
    rated_N = 1e-3 * raw_of(initial, AXIS_OBJ_RATED_FORCE, 100000);
    if (counts_per_m < 0 || q8_per_N < 0)
      source.fail("phase",
                  "expected a model whose encoder counts up towards the workpiece and a "
                  "force_sign with which the reading rises with the force; change the "
                  "model or force_sign");
    limit_N = rated_N * raw_of(initial, AXIS_OBJ_FORCE_LIMIT, 1000) / 1000;
    tare_band_q8 = raw_of(initial, AXIS_OBJ_TARE_BAND, 0);
    position_least = raw_of(initial, AXIS_OBJ_POSITION_LIMIT_MIN, INT32_MIN);
    position_most = raw_of(initial, AXIS_OBJ_POSITION_LIMIT_MAX, INT32_MAX);
    span = std::min(position_most - position_least,
                    1.0 * raw_of(initial, AXIS_OBJ_POSITION_MAX, INT32_MAX) -
                        raw_of(initial, AXIS_OBJ_POSITION_MIN, INT32_MIN));
    set_ends(initial, sign);
    // In a program, the firmware expects positions, distances and speeds in user units.
    if (raw_of(initial, AXIS_OBJ_FEED, 0) != 0 || raw_of(initial, AXIS_OBJ_POLARITY, 0) != 0)
      source.fail("phase",
                  "expected an axis whose user unit is the encoder count; remove feed and polarity "
                  "from the experiment");
  }

  double force_max_q8() const { return std::isinf(most_q8) ? -least_q8 : most_q8; }

 private:
  void set_ends(const std::vector<ObjectWrite> &initial, int sign) {
    const int bits = raw_of(initial, AXIS_OBJ_ADC_BITS, 8);
    const int zero = raw_of(initial, AXIS_OBJ_FORCE_ZERO_CODE, 0);
    const double tare = raw_of(initial, AXIS_OBJ_FORCE_TARE, 0), step = 1 << (16 - bits);
    const double last = sign * step * ((1 << bits) - 1 - zero) - tare;
    const double first = -sign * step * zero - tare;
    if (sign > 0 || zero != 0) most_q8 = sign > 0 ? last : first;
    if (sign < 0 || zero != 0) least_q8 = sign > 0 ? first : last;
  }
};

// Returns the smallest number of ticks that last at least `time_s`. A time that is a whole number
// of ticks may have a rounding error.
double ticks_of(double time_s) { return std::ceil(time_s * kTicks - 1e-6); }

// Rounds a number of counts or codes, which has to be from `low` to `high`.
std::int64_t rounded(Section &section, const char *key, double value, double low, double high) {
  const double whole = std::nearbyint(value);
  if (!(whole >= low && whole <= high))
    section.fail(key, "expected a value of " + sim::number_text(low) + " to " +
                          sim::number_text(high) + " in counts of the axis, got " +
                          sim::number_text(value) + "; choose another value or another model");
  return static_cast<std::int64_t>(whole);
}

class Reader {
 public:
  Reader(Section &root, const Scales &scales, CycleProgram &program)
      : root_(root), scales_(scales), program_(program) {}

  void read() {
    header_.magic = CYCLE_MAGIC;
    header_.version = CYCLE_VERSION;
    program_.title = root_.text("title", kText);
    read_name();
    header_.number = static_cast<std::uint32_t>(root_.integer("number"));
    program_.number = header_.number;
    if (const auto crc = root_.optional_text("bank_crc", kText)) header_.bank_crc = crc_of(*crc);
    read_zero();
    header_.outputs_keep = read_outputs(root_, "keep_outputs");
    read_compliance();
    root_.each("phase", [&](Section &section) { name_phase(section); });
    if (names_.phases.empty()) root_.fail("phase", "expected at least one [[phase]], got none");
    if (names_.phases.size() > CYCLE_PHASES_MAX)
      root_.fail("phase", "expected at most 16 phases, got " +
                              std::to_string(names_.phases.size()) + "; remove some");
    root_.each("phase", [&](Section &section) { read_phase(section); });
    root_.each("element", [&](Section &section) { read_element(section); });
    root_.finish();
    check_flow();
    check_elements();
    check_outputs();
    build();
  }

 private:
  std::uint32_t crc_of(const std::string &text) {
    std::size_t used = 0;
    unsigned long value = 0;
    try {
      value = std::stoul(text, &used, 16);
    } catch (const std::exception &) {
      used = 0;
    }
    if (used != text.size() || used != 8)
      root_.fail("bank_crc", "expected 8 hexadecimal digits, got " + sim::in_quotes(text) +
                                 "; give the CRC that `design_law` prints");
    return static_cast<std::uint32_t>(value);
  }

  void read_name() {
    const std::string name = root_.optional_text("name", kText).value_or("");
    if (name.size() > sizeof(header_.name))
      root_.fail("name", "expected at most 12 bytes, got " + std::to_string(name.size()) +
                             "; shorten the name, or give it in title");
    std::memcpy(header_.name, name.data(), name.size());
  }

  std::uint8_t read_outputs(Section &section, const char *key) {
    static const char *const kOutputs[] = {"output_1", "output_2", "output_3", "output_4"};
    int outputs = 0;
    if (!section.has(key)) return 0;
    for (const std::string &text : texts(section, key)) {
      const auto found = std::find(std::begin(kOutputs), std::end(kOutputs), text);
      if (found == std::end(kOutputs))
        section.fail(key, "expected output_1, output_2, output_3 or output_4, got " +
                              sim::in_quotes(text) + "; correct the name");
      outputs |= 1 << (found - std::begin(kOutputs));
    }
    return static_cast<std::uint8_t>(outputs);
  }

  // Adds the points of a table (firmware/cycle/table.h), with their units for each unit of the
  // file. Returns the number of points.
  std::uint8_t read_table(Section &section, const std::string &x_key, double x_per_unit,
                          const std::string &y_key, double y_per_unit) {
    const std::vector<double> x = section.numbers(x_key), y = section.numbers(y_key);
    if (x.size() < 2 || x.size() > 255 || x.size() != y.size())
      section.fail(y_key, "expected 2 to 255 points with one value of " + x_key + " and one of " +
                              y_key + " each; give lists of the same length");
    for (std::size_t i = 0; i < x.size(); ++i) {
      const cycle_point_t point{
          static_cast<std::int32_t>(rounded(section, x_key.c_str(), x[i] * x_per_unit,
                                            -CYCLE_TRAVEL_MAX, CYCLE_TRAVEL_MAX)),
          static_cast<std::int32_t>(rounded(section, y_key.c_str(), y[i] * y_per_unit,
                                            -CYCLE_TABLE_Y_MAX, CYCLE_TABLE_Y_MAX))};
      const std::int64_t step = i == 0 ? 1 : std::int64_t{point.x} - points_.back().x;
      if (step < 1 || step > CYCLE_TABLE_STEP_MAX)
        section.fail(x_key,
                     "expected values that rise by 1 to 524287 in counts of the axis or "
                     "ticks from one point to the next; sort them, or add points");
      points_.push_back(point);
    }
    return static_cast<std::uint8_t>(x.size());
  }

  static CyclePoints points_of(Section &section, const std::string &x_key,
                               const std::string &y_key) {
    const std::vector<double> x = section.numbers(x_key), y = section.numbers(y_key);
    CyclePoints points;
    for (std::size_t i = 0; i < x.size(); ++i) points.emplace_back(x[i], y[i]);
    return points;
  }

  void read_compliance() {
    const char *const force = "compliance_force", *const deflection = "compliance_deflection";
    if (!root_.has(force) && !root_.has(deflection)) return;
    header_.compliance =
        read_table(root_, force, scales_.q8_per_N, deflection, scales_.counts_per_m);
    program_.compliance = points_of(root_, force, deflection);
    if (std::max(-points_.front().x, points_.back().x) > CYCLE_FORCE_MAX_Q8)
      root_.fail(force, "expected forces within the range of the sensor; lower them");
    if (points_.size() > CYCLE_COMPLIANCE_MAX)
      root_.fail(force, "expected at most 16 points, got " + std::to_string(points_.size()) +
                            "; remove some");
    for (std::size_t i = 1; i < points_.size(); ++i)
      if (points_[i].y < points_[i - 1].y)
        root_.fail(deflection,
                   "expected a deflection that does not fall while the force rises; "
                   "correct the values");
  }

  void read_zero() {
    static const char *const kZeros[] = {"touch", "force", "position"};
    static const std::set<std::string> kKeys[] = {{}, {"zero_force"}, {"zero_position"}};
    header_.zero = static_cast<std::uint8_t>(root_.choice("zero", "choose where travel 0 is"));
    only(root_, "this zero", {"zero_force", "zero_position"}, kKeys[header_.zero]);
    program_.zero = kZeros[header_.zero];
    if (header_.zero != CYCLE_ZERO_TOUCH)
      program_.zero_at = root_.optional_number("zero_" + program_.zero);
    if (header_.zero == CYCLE_ZERO_FORCE) {
      const double force = needed(root_, "zero_force", "zero = \"force\"");
      header_.zero_level = force_q8(root_, "zero_force", force);
      check_shown(root_, "zero_force", header_.zero_level);
      if (header_.zero_level == 0)
        root_.fail("zero_force", "expected at least 1/256 count of the axis; raise it");
    }
    if (header_.zero == CYCLE_ZERO_POSITION)
      header_.zero_level =
          counts(root_, "zero_position", needed(root_, "zero_position", "zero = \"position\""));
  }

  void name_phase(Section &section) {
    const std::string name = section.name();
    if (name == "end")
      section.fail("name", "expected a name other than the reserved end; rename this phase");
    if (std::find(names_.phases.begin(), names_.phases.end(), name) != names_.phases.end())
      section.fail("name", "expected a name that no other phase has, got " + sim::in_quotes(name) +
                               "; rename one of the phases");
    names_.phases.push_back(name);
  }

  double needed(Section &section, const char *key, const std::string &why) {
    const auto value = section.optional_number(key);
    if (!value) section.fail(key, "expected this key for " + why + "; add it");
    return *value;
  }

  // Refuses keys that the action of a phase, or the kind of an evaluation element, does not use.
  static void only(Section &section, const std::string &of, std::initializer_list<const char *> all,
                   const std::set<std::string> &used) {
    for (const char *key : all)
      if (section.has(key) && !used.contains(key))
        section.fail(key, "expected no such key for " + of + "; remove it");
  }

  std::int32_t counts(Section &section, const char *key, double metres) {
    return static_cast<std::int32_t>(
        rounded(section, key, metres * scales_.counts_per_m, -CYCLE_TRAVEL_MAX, CYCLE_TRAVEL_MAX));
  }
  std::int32_t force_q8(Section &section, const char *key, double newtons) {
    return static_cast<std::int32_t>(
        rounded(section, key, newtons * scales_.q8_per_N, -CYCLE_FORCE_MAX_Q8, CYCLE_FORCE_MAX_Q8));
  }
  // Refuses a force that no valid sample can show, because it is at or beyond the end of the range.
  void check_shown(Section &section, const char *key, double level_q8, double end_q8) {
    if (std::fabs(level_q8) < std::fabs(end_q8)) return;
    section.fail(key, "expected less than " +
                          sim::number_text(std::fabs(end_q8 / scales_.q8_per_N)) +
                          " N, the end of what the force sensor can show, got " +
                          sim::number_text(std::fabs(level_q8 / scales_.q8_per_N)) +
                          " N; lower it, or choose a sensor with a larger range");
  }
  void check_shown(Section &section, const char *key, double level_q8) {
    if (level_q8 > 0) check_shown(section, key, level_q8, scales_.most_q8);
    if (level_q8 < 0) check_shown(section, key, level_q8, scales_.least_q8);
  }

  // A magnitude of at least 1.
  std::uint32_t magnitude(Section &section, const char *key, double value, double high) {
    return static_cast<std::uint32_t>(rounded(section, key, std::fabs(value), 1, high));
  }

  void read_motion(Section &section, cycle_phase_t &phase, const std::string &action) {
    const bool is_move = action == "move";
    only_of_action(section, action, {is_move ? "position" : "distance", "speed"});
    const char *key = is_move ? "position" : "distance";
    phase.target = counts(section, key, needed(section, key, action));
    const double speed = needed(section, "speed", action) * scales_.counts_per_m;
    phase.speed = magnitude(section, "speed", speed, 3072000);
    check_place(section, key, phase);
  }

  // A target beyond the soft limits would be replaced by the limit.
  void check_place(Section &section, const char *key, const cycle_phase_t &phase) {
    const bool is_depth = phase.action == CYCLE_MOVE_TO_DEPTH;
    const double target = phase.target;
    if (phase.action == CYCLE_MOVE || (is_depth && header_.zero == CYCLE_ZERO_POSITION)) {
      const double place = target + (is_depth ? header_.zero_level : 0);
      if (place < scales_.position_least || place > scales_.position_most)
        section.fail(key,
                     "expected a place within position_limit_min and position_limit_max of the "
                     "axis; change it or these limits");
    } else if (std::fabs(target) > scales_.span) {
      section.fail(key, "expected at most the travel between the soft limits of the axis, " +
                            sim::number_text(scales_.span / scales_.counts_per_m) +
                            " m; lower it, or widen position_limit_min and _max or position_min "
                            "and _max");
    }
  }

  // Refuses the keys of other actions.
  static void only_of_action(Section &section, const std::string &action,
                             const std::set<std::string> &used) {
    only(section, action,
         {"position", "distance", "speed", "force", "slope", "over", "table_x", "table_force",
          "tare_time"},
         used);
  }

  // Refuses a force that the limits of the axis or of the phase do not allow.
  void check_force(Section &section, const char *key, double force, double force_max_N) {
    if (std::fabs(force) > scales_.limit_N * (1 + 1e-9))
      section.fail(key, "expected at most force_limit, " + sim::number_text(scales_.limit_N) +
                            " N, got " + sim::number_text(force) +
                            " N; lower it, or raise rated_force or force_limit");
    if (std::fabs(force) > force_max_N)
      section.fail("force_max", "expected at least the force of the phase, " +
                                    sim::number_text(std::fabs(force)) + " N, got " +
                                    sim::number_text(force_max_N) + " N; raise it");
  }

  void read_follow(Section &section, cycle_phase_t &phase, double force_max_N) {
    only_of_action(section, "follow", {"slope", "over", "table_x", "table_force"});
    const double per_mille = 1000 / scales_.rated_N;
    phase.over_travel = static_cast<std::uint8_t>(section.choice("over", "choose x of the table"));
    const double slope = needed(section, "slope", "follow");
    phase.slope = magnitude(section, "slope", slope * per_mille, 4294967295.0);
    phase.first = static_cast<std::uint16_t>(points_.size());
    phase.points =
        read_table(section, "table_x", phase.over_travel != 0 ? scales_.counts_per_m : kTicks,
                   "table_force", 256 * per_mille);
    const std::vector<double> forces = section.numbers("table_force");
    for (const double force : forces) check_force(section, "table_force", force, force_max_N);
    if (phase.over_travel != 0) return;
    if (points_[phase.first].x < 0)
      section.fail("table_x", "expected times of at least 0 s; correct the first one");
    for (std::size_t i = 1; i < forces.size(); ++i) {
      const std::size_t at = phase.first + i;
      const double ticks = points_[at].x - points_[at - 1].x;
      if (std::fabs(forces[i] - forces[i - 1]) * kTicks / ticks > slope * (1 + 1e-9))
        section.fail("slope",
                     "expected at least the slope of the table, " +
                         sim::number_text(std::fabs(forces[i] - forces[i - 1]) * kTicks / ticks) +
                         " N/s before point " + std::to_string(i) +
                         "; raise it, or make the table less steep");
    }
  }

  void read_tare(Section &section, cycle_phase_t &phase) {
    only_of_action(section, "tare", {"tare_time"});
    if (scales_.tare_band_q8 == 0)
      section.fail("do",
                   "expected an axis with a tare_band, which bounds the offset; set tare_band "
                   "in the experiment");
    phase.target =
        static_cast<std::int32_t>(std::max(1.0, ticks_of(needed(section, "tare_time", "tare"))));
    within(section, "tare_time", phase.target, phase.time_max, "time_max");
    has_tare_ = true;
  }

  void read_action(Section &section, cycle_phase_t &phase, double force_max_N) {
    const std::string action = section.text("do", kText);
    switch (phase.action) {
      case CYCLE_PRESS:
        return read_press(section, phase, force_max_N);
      case CYCLE_FOLLOW:
        return read_follow(section, phase, force_max_N);
      case CYCLE_TARE:
        return read_tare(section, phase);
      case CYCLE_WAIT:
      case CYCLE_OUTPUT:
        return only_of_action(section, action, {});
      default:
        return read_motion(section, phase, action);
    }
  }

  void read_phase_outputs(Section &section, cycle_phase_t &phase) {
    phase.outputs_on = read_outputs(section, "outputs_on");
    phase.outputs_off = read_outputs(section, "outputs_off");
    if ((phase.outputs_on & phase.outputs_off) != 0)
      section.fail("outputs_off",
                   "expected no output that outputs_on has; remove it from one list");
    if (phase.action == CYCLE_OUTPUT && (phase.outputs_on | phase.outputs_off) == 0)
      section.fail("outputs_on", "expected this key or outputs_off for output; add one");
  }

  void read_press(Section &section, cycle_phase_t &phase, double force_max_N) {
    only_of_action(section, "press", {"force", "slope"});
    const double force = needed(section, "force", "press");
    check_force(section, "force", force, force_max_N);
    const double per_mille = 1000 / scales_.rated_N;
    phase.force =
        static_cast<std::int16_t>(rounded(section, "force", force * per_mille, -32766, 32766));
    if (phase.force == 0)
      section.fail("force", "expected at least a thousandth of rated_force; raise it");
    const double slope = needed(section, "slope", "press") * per_mille;
    phase.slope = magnitude(section, "slope", slope, 4294967295.0);
  }

  void read_phase(Section &section) {
    cycle_phase_t phase{};
    CyclePhase &own = program_.phases.emplace_back();
    own.name = section.name();
    phase.action = static_cast<std::uint8_t>(section.choice("do", "choose what the phase does"));
    const double force_max = section.number("force_max"), travel_max = section.number("travel_max");
    phase.force_max_q8 =
        magnitude(section, "force_max", force_max * scales_.q8_per_N, CYCLE_FORCE_MAX_Q8);
    check_shown(section, "force_max", phase.force_max_q8, scales_.force_max_q8());
    phase.travel_max =
        magnitude(section, "travel_max", travel_max * scales_.counts_per_m, CYCLE_TRAVEL_MAX);
    phase.time_max = static_cast<std::uint32_t>(ticks_of(section.number("time_max")));
    const std::string reaction = section.optional_text("on_limit", kText).value_or("end");
    phase.reaction = names_.find(section, "on_limit", reaction);
    own.on_limit = reaction;
    own.tare_s = section.optional_number("tare_time");
    read_action(section, phase, force_max);
    read_phase_outputs(section, phase);
    std::size_t count = 0;
    section.each("end", [&](Section &end) {
      if (count == CYCLE_CONDITIONS)
        end.fail("when", "expected at most 4 conditions of a phase; remove some");
      phase.conditions[count++] = read_end(end, phase, own.ends.emplace_back());
    });
    if (count == 0)
      section.fail("end", "expected a condition that ends the phase, got none; add [[phase.end]]");
    read_stiffness(section, phase);
    check_ends(section, phase);
    phases_.push_back(phase);
  }

  // Refuses conditions of which none ends the phase, or that the action or a limit prevents.
  void check_ends(Section &section, const cycle_phase_t &phase) {
    bool is_reached = false, is_uncounted = false;
    for (const cycle_condition_t &end : phase.conditions) {
      is_reached |= end.when == CYCLE_REACHED;
      is_uncounted |= end.when != CYCLE_NEVER && end.count == 0;
    }
    if (!is_uncounted)
      section.fail("end",
                   "expected a condition without a count, because the others end the phase a "
                   "limited number of times; add one, or remove a count");
    if (phase.action == CYCLE_TARE && !is_reached)
      section.fail("end",
                   "expected a condition reached, which ends the phase with its offset; add "
                   "it");
    if (is_reached) check_reached(section, phase);
  }

  void check_reached(Section &section, const cycle_phase_t &phase) {
    if (phase.action == CYCLE_WAIT)
      section.fail("end", "expected no condition reached for wait, which has no target; use time");
    if (phase.action == CYCLE_FOLLOW) {
      const std::int32_t last = points_[phase.first + std::size_t{phase.points} - 1].x;
      within(section, "table_x", last, phase.over_travel != 0 ? phase.travel_max : phase.time_max,
             phase.over_travel != 0 ? "travel_max" : "time_max");
    }
    if (phase.action != CYCLE_MOVE_BY && phase.action != CYCLE_APPROACH) return;
    const double distance = std::fabs(1.0 * phase.target);
    within(section, "distance", static_cast<std::int64_t>(distance), phase.travel_max,
           "travel_max");
    if (distance / phase.speed * kTicks > phase.time_max)
      section.fail("time_max", "expected at least the time of the distance at this speed, " +
                                   sim::number_text(distance / phase.speed) +
                                   " s; raise it or the speed");
  }

  static bool is_stiffness(int when) {
    return when == CYCLE_STIFFNESS_ABOVE || when == CYCLE_STIFFNESS_BELOW;
  }

  void read_stiffness(Section &section, cycle_phase_t &phase) {
    const bool is_used = std::any_of(std::begin(phase.conditions), std::end(phase.conditions),
                                     [](const auto &end) { return is_stiffness(end.when); });
    if (!is_used) {
      only(section, "a phase without a condition of stiffness", {"stiffness_travel"}, {});
      return;
    }
    const double travel = needed(section, "stiffness_travel", "a condition of stiffness");
    phase.stiffness_travel = static_cast<std::uint16_t>(
        magnitude(section, "stiffness_travel", travel * scales_.counts_per_m, 65535));
    within(section, "stiffness_travel", phase.stiffness_travel, phase.travel_max, "travel_max");
  }

  std::int32_t read_inputs(Section &section) {
    static const std::pair<const char *, int> kInputs[] = {
        {"enable", AXIS_DIGITAL_INPUTS_ENABLE},
        {"limit_pos", AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE},
        {"limit_neg", AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE},
        {"index", AXIS_DIGITAL_INPUTS_INDEX},
        {"home", AXIS_DIGITAL_INPUTS_HOME}};
    std::int32_t mask = 0;
    for (const std::string &text : texts(section, "inputs")) {
      const auto found = std::find_if(std::begin(kInputs), std::end(kInputs),
                                      [&](const auto &input) { return text == input.first; });
      if (found == std::end(kInputs))
        section.fail("inputs", "expected enable, limit_pos, limit_neg, index or home, got " +
                                   sim::in_quotes(text) + "; correct the name");
      mask |= found->second;
    }
    return mask;
  }

  // A condition that one of the limits of its phase prevents would never be met.
  void within(Section &section, const char *key, std::int64_t level, std::int64_t limit,
              const char *limit_key) {
    if (level > limit)
      section.fail(key, std::string("expected a value within ") + limit_key +
                            " of the phase, which ends it before; lower the value or raise the "
                            "limit");
  }

  // Refuses a key that the condition does not use, and asks for one that it needs.
  static void expect_key(Section &section, const char *key, bool is_needed) {
    if (section.has(key) != is_needed)
      section.fail(key, is_needed
                            ? std::string("expected this key for the condition; add it")
                            : std::string("expected no ") + key + " for this condition; remove it");
  }

  cycle_condition_t read_end(Section &section, const cycle_phase_t &phase, CycleEnd &own) {
    const CycleCondition &kind =
        kCycleConditions[section.choice("when", "choose what ends the phase")];
    cycle_condition_t end{};
    end.when = kind.code;
    own.when = kind.name;
    own.next = section.text("next", kText);
    end.next = names_.find(section, "next", own.next);
    end.count = static_cast<std::uint16_t>(section.integer("count"));
    expect_key(section, "value", kind.value.has_value());
    expect_key(section, "inputs", kind.inputs);
    if (kind.inputs) end.level = read_inputs(section);
    if (kind.value) {
      end.level = read_level(section, end.when, phase);
      own.value = section.value("value", *kind.value, Sign::any);
      own.unit = sim::unit_of(*kind.value);
    }
    return end;
  }

  std::int32_t read_level(Section &section, int when, const cycle_phase_t &phase) {
    const auto value = [&](Dimension dimension, Sign sign) {
      return section.value("value", dimension, sign);
    };
    switch (when) {
      case CYCLE_TIME: {
        const double ticks = std::max(1.0, ticks_of(value(Dimension::time, Sign::positive)));
        const auto level = static_cast<std::int32_t>(rounded(section, "value", ticks, 1, 1e9));
        within(section, "value", level, phase.time_max, "time_max");
        return level;
      }
      case CYCLE_FORCE_ABOVE:
      case CYCLE_FORCE_BELOW: {
        const std::int32_t level = force_q8(section, "value", value(Dimension::force, Sign::any));
        // An offset of a tare, of up to tare_band, moves the level against the limit.
        within(section, "value", when == CYCLE_FORCE_ABOVE ? level : -level,
               phase.force_max_q8 + band(), "force_max");
        if (when == CYCLE_FORCE_ABOVE ? level > 0 : level < 0) check_shown(section, "value", level);
        return level;
      }
      case CYCLE_TRAVEL_ABOVE: {
        const double travel = value(Dimension::length, Sign::positive) * scales_.counts_per_m;
        const std::uint32_t level = magnitude(section, "value", travel, CYCLE_TRAVEL_MAX);
        within(section, "value", level, phase.travel_max, "travel_max");
        return static_cast<std::int32_t>(level);
      }
      case CYCLE_STIFFNESS_ABOVE:
      case CYCLE_STIFFNESS_BELOW: {
        const double per_count = scales_.q8_per_N / scales_.counts_per_m * 65536;
        return static_cast<std::int32_t>(rounded(section, "value",
                                                 value(Dimension::stiffness, Sign::any) * per_count,
                                                 -2147483648.0, 2147483647.0));
      }
      default:
        return counts(section, "value", value(Dimension::length, Sign::any));
    }
  }

  std::vector<std::string> texts(Section &section, const char *key) {
    const toml::node &node = section.require(key, "a list of texts");
    const toml::array *list = node.as_array();
    std::vector<std::string> all;
    for (std::size_t i = 0; list != nullptr && i < list->size(); ++i) {
      const auto text = (*list)[i].value<std::string>();
      if (!text) section.fail(key, kText);
      all.push_back(*text);
    }
    if (all.empty()) section.fail(key, "expected a list of texts that is not empty; add a text");
    return all;
  }

  std::uint8_t read_sides(Section &section, const char *key) {
    static const char *const kSides[] = {"left", "right", "bottom", "top"};
    int sides = 0;
    for (const std::string &text : texts(section, key)) {
      const auto found = std::find(std::begin(kSides), std::end(kSides), text);
      if (found == std::end(kSides))
        section.fail(key, "expected left, right, bottom or top, got " + sim::in_quotes(text) +
                              "; correct the name");
      sides |= 1 << (found - std::begin(kSides));
    }
    return static_cast<std::uint8_t>(sides);
  }

  struct Axis {
    Dimension dimension;
    double per_unit;  // counts or ticks for each m or s
  };

  static std::optional<double> optional_value(Section &section, const char *key,
                                              Dimension dimension) {
    return section.optional_value(key, dimension, Sign::any);
  }

  std::int32_t x_value(Section &section, const char *key, const Axis &x) {
    return static_cast<std::int32_t>(
        rounded(section, key, section.value(key, x.dimension, Sign::any) * x.per_unit,
                -CYCLE_TRAVEL_MAX, CYCLE_TRAVEL_MAX));
  }

  void read_range(Section &section, cycle_element_t &element, const Axis &x) {
    std::int32_t from = -CYCLE_TRAVEL_MAX, to = CYCLE_TRAVEL_MAX;
    if (section.has("from")) from = x_value(section, "from", x);
    if (section.has("to")) to = x_value(section, "to", x);
    if (from > to) section.fail("to", "expected at least the value of from; exchange them");
    element.x_least = from;
    element.x_most = to;
  }

  // Bounds of the value in units of the firmware, `per_unit` of them for each unit of `dimension`.
  void read_bounds(Section &section, cycle_element_t &element, Dimension dimension,
                   double per_unit) {
    double least = -std::numeric_limits<double>::infinity(), most = -least;
    if (section.has("least")) least = section.value("least", dimension, Sign::any) * per_unit;
    if (section.has("most")) most = section.value("most", dimension, Sign::any) * per_unit;
    if (least > most) section.fail("most", "expected at least the value of least; exchange them");
    const auto bound = [](double value) {
      return static_cast<std::int32_t>(std::clamp(value, -2147483648.0, 2147483647.0));
    };
    element.y_least = bound(std::ceil(least - 1e-6));
    element.y_most = bound(std::floor(most + 1e-6));
  }

  void read_crossing(Section &section, cycle_element_t &element, const Axis &x, bool two) {
    const bool of_force = section.choice("of", "choose what crosses the level") == 1;
    const char *const kLevels[] = {"level", "level_2"};
    for (int i = 0; i < (two ? 2 : 1); ++i) {
      if (!section.has(kLevels[i]))
        section.fail(kLevels[i], "expected this level of the element; add it");
      const std::int32_t level =
          of_force ? force_q8(section, kLevels[i],
                              section.value(kLevels[i], Dimension::force, Sign::any))
                   : x_value(section, kLevels[i], x);
      (i == 0 ? element.level : element.level_2) = level;
    }
    element.of_force = of_force ? 1 : 0;
    element.direction =
        static_cast<std::uint8_t>(section.choice("direction", "choose the direction") + 1);
    element.ordinal = static_cast<std::uint8_t>(section.integer("ordinal"));
  }

  std::uint8_t read_curve(Section &section, const std::string &side, const Axis &x) {
    const std::vector<double> at = section.numbers(side + "_x");
    const std::vector<double> forces = section.numbers(side + "_force");
    if (at.size() < 2 || at.size() > 255 || at.size() != forces.size())
      section.fail(side + "_force",
                   "expected 2 to 255 points with one x and one force each; "
                   "give lists of the same length");
    std::vector<cycle_point_t> points;
    for (std::size_t i = 0; i < at.size(); ++i) {
      const auto place = rounded(section, (side + "_x").c_str(), at[i] * x.per_unit,
                                 -CYCLE_TRAVEL_MAX, CYCLE_TRAVEL_MAX);
      points.push_back({static_cast<std::int32_t>(place),
                        force_q8(section, (side + "_force").c_str(), forces[i])});
    }
    points_.insert(points_.end(), points.begin(), points.end());
    return static_cast<std::uint8_t>(points.size());
  }

  void read_envelope(Section &section, cycle_element_t &element, CycleElement &own, const Axis &x) {
    for (const char *key : {"least", "most"})
      if (section.has(key))
        section.fail(key,
                     "expected no such key for an envelope, whose curves are the bounds; "
                     "remove it");
    element.first = static_cast<std::uint16_t>(points_.size());
    element.lower = read_curve(section, "lower", x);
    element.upper = read_curve(section, "upper", x);
    own.lower = points_of(section, "lower_x", "lower_force");
    own.upper = points_of(section, "upper_x", "upper_force");
    const auto begin = points_.begin() + element.first;
    const auto middle = begin + element.lower;
    if (!section.has("from")) element.x_least = std::max(begin->x, middle->x);
    if (!section.has("to")) element.x_most = std::min((middle - 1)->x, points_.back().x);
  }

  void read_window(Section &section, cycle_element_t &element) {
    for (const char *key : {"from", "to", "least", "most"})
      if (!section.has(key))
        section.fail(key, "expected all of from, to, least and most of a window; add this key");
    element.enters = read_sides(section, "enters");
    if (section.has("leaves")) element.leaves = read_sides(section, "leaves");
  }

  void read_element(Section &section) {
    if (elements_.size() == CYCLE_ELEMENTS_MAX)
      section.fail("name", "expected at most 16 elements; remove some");
    cycle_element_t element{};
    CycleElement own;
    own.name = section.name();
    for (const CycleElement &other : program_.elements)
      if (other.name == own.name)
        section.fail("name", "expected a name that no other element has, got " +
                                 sim::in_quotes(own.name) + "; rename one of the elements");
    element.kind = static_cast<std::uint8_t>(section.choice("kind", "choose a kind of element"));
    own.kind = section.text("kind", kText);
    element.over_time = static_cast<std::uint8_t>(section.choice("over", "choose x of the curve"));
    own.over = element.over_time != 0 ? "time" : "travel";
    own.phases = texts(section, "phases");
    for (const std::string &phase : own.phases)
      element.phases =
          static_cast<std::uint16_t>(element.phases | 1U << names_.index(section, "phases", phase));
    const Axis x = element.over_time != 0 ? Axis{Dimension::time, kTicks}
                                          : Axis{Dimension::length, scales_.counts_per_m};
    static const std::map<std::string, std::set<std::string>> kOwn = {
        {"at", {"of", "level", "direction", "ordinal"}},
        {"difference", {"of", "level", "level_2", "direction", "ordinal"}},
        {"window", {"enters", "leaves"}},
        {"envelope", {"lower_x", "lower_force", "upper_x", "upper_force"}}};
    const auto found = kOwn.find(own.kind);
    only(section, own.kind,
         {"of", "level", "level_2", "direction", "ordinal", "enters", "leaves", "lower_x",
          "lower_force", "upper_x", "upper_force"},
         found == kOwn.end() ? std::set<std::string>{} : found->second);
    read_range(section, element, x);
    own.x_from = optional_value(section, "from", x.dimension);
    own.x_to = optional_value(section, "to", x.dimension);
    read_kind(section, element, own, x);
    program_.elements.push_back(std::move(own));
    elements_.push_back(element);
  }

  // The quantity of a value, and how many units of the firmware one SI unit has.
  std::pair<Dimension, double> quantity_of(const cycle_element_t &element, const Axis &x) const {
    if (element.of_force != 0) return {x.dimension, x.per_unit};
    if (element.kind != CYCLE_WORK) return {Dimension::force, scales_.q8_per_N};
    return {element.over_time != 0 ? Dimension::impulse : Dimension::energy,
            scales_.q8_per_N / 256 * x.per_unit};
  }

  void read_kind(Section &section, cycle_element_t &element, CycleElement &own, const Axis &x) {
    const bool is_window = element.kind == CYCLE_WINDOW;
    if (element.kind == CYCLE_AT || element.kind == CYCLE_DIFFERENCE)
      read_crossing(section, element, x, element.kind == CYCLE_DIFFERENCE);
    if (is_window) read_window(section, element);
    const auto [dimension, per_unit] = quantity_of(element, x);
    if (element.kind == CYCLE_ENVELOPE)
      read_envelope(section, element, own, x);
    else
      read_bounds(section, element, dimension, per_unit);
    own.of = element.of_force != 0 ? "force" : "x";
    own.level =
        optional_value(section, "level", element.of_force != 0 ? Dimension::force : x.dimension);
    own.least = optional_value(section, "least", dimension);
    own.most = optional_value(section, "most", dimension);
    own.unit = is_window ? "" : std::string(sim::unit_of(dimension));
    own.per_value = is_window ? 1.0 : 1.0 / per_unit;
  }

  // Transitions from a phase to the next one: all of them; only those that are not caused by an
  // exceeded limit; of the latter, only those without a count.
  enum class Ways { all, intended, uncounted };

  std::set<std::size_t> next_of(std::size_t phase, Ways ways) const {
    std::set<std::size_t> next;
    for (const cycle_condition_t &end : phases_[phase].conditions)
      if (end.when != CYCLE_NEVER && end.next != CYCLE_END &&
          (ways != Ways::uncounted || end.count == 0))
        next.insert(end.next);
    if (ways == Ways::all && phases_[phase].reaction != CYCLE_END)
      next.insert(phases_[phase].reaction);
    return next;
  }

  std::set<std::size_t> reached_from(std::set<std::size_t> start, Ways ways) const {
    std::vector<std::size_t> open(start.begin(), start.end());
    while (!open.empty()) {
      const std::size_t phase = open.back();
      open.pop_back();
      for (const std::size_t next : next_of(phase, ways))
        if (start.insert(next).second) open.push_back(next);
    }
    return start;
  }

  void check_flow() {
    const auto reached = reached_from({0}, Ways::all);
    for (std::size_t i = 0; i < phases_.size(); ++i) {
      const std::string key = "phase[" + std::to_string(i) + "]";
      if (!reached.contains(i))
        root_.fail(key, "expected a phase that another one leads to, but nothing leads to " +
                            names_.phases[i] + "; name it in `next` or `on_limit`, or remove it");
      if (reached_from(next_of(i, Ways::uncounted), Ways::uncounted).contains(i))
        root_.fail(key, "expected a cycle that ends, but " + names_.phases[i] +
                            " follows itself without end; give a condition of the loop a count");
    }
  }

  // The offset that a tare may find, by which forces differ from what a limit bounds.
  std::int64_t band() const {
    return has_tare_ ? static_cast<std::int64_t>(scales_.tare_band_q8) : 0;
  }

  void check_elements() {
    const auto intended = reached_from({0}, Ways::intended);
    for (std::size_t i = 0; i < elements_.size(); ++i) {
      const cycle_element_t &element = elements_[i];
      const std::string key = "element[" + std::to_string(i) + "]";
      if (!cycle_element_is_valid(&element, points_.data(),
                                  static_cast<std::uint16_t>(points_.size())))
        root_.fail(key, "expected curves that rise in x and cover from and to; correct " +
                            program_.elements[i].name);
      std::int64_t force_most = 0, time_most = 0;
      for (const std::size_t phase : intended)
        if ((element.phases >> phase & 1) != 0) {
          force_most = std::max<std::int64_t>(force_most, phases_[phase].force_max_q8);
          time_most += phases_[phase].time_max;
        }
      if (force_most == 0)
        root_.fail(key + ".phases",
                   "expected a phase that a good part passes, but only a limit that "
                   "is exceeded leads to these; add a phase, or remove the element");
      check_forces(key, element, force_most + band());
      if (element.over_time != 0 && element.x_least > time_most)
        root_.fail(key + ".from", "expected at most the time_max of the phases of the element, " +
                                      sim::number_text(static_cast<double>(time_most) / kTicks) +
                                      " s together; lower it");
    }
  }

  // Refuses a bound or level of an evaluation element beyond force_max of its phases, because no
  // good part has such a force.
  void check_forces(const std::string &key, const cycle_element_t &element, std::int64_t most) {
    const auto beyond = [&](const char *of, const char *what) {
      root_.fail(key + of, std::string("expected a ") + what +
                               " within force_max of the phases of the element, because no good "
                               "part has a force beyond it; lower it, or raise force_max");
    };
    if (element.of_force != 0) {
      if (std::abs(element.level) > most) beyond(".level", "level");
      if (std::abs(element.level_2) > most) beyond(".level_2", "level");
      return;
    }
    static const std::set<int> kForces = {CYCLE_PEAK, CYCLE_VALLEY, CYCLE_LAST, CYCLE_AT,
                                          CYCLE_WINDOW};
    if (!kForces.contains(element.kind)) return;
    if (element.y_least > most) beyond(".least", "force");
    if (element.y_most < -most) beyond(".most", "force");
  }

  void check_outputs() {
    int on = 0;
    for (const cycle_phase_t &phase : phases_) on |= phase.outputs_on;
    if ((header_.outputs_keep & ~on) != 0)
      root_.fail("keep_outputs",
                 "expected outputs that a phase switches on; add outputs_on to a "
                 "phase, or remove the output");
  }

  void build() {
    header_.phases = static_cast<std::uint8_t>(phases_.size());
    header_.elements = static_cast<std::uint8_t>(elements_.size());
    header_.points = static_cast<std::uint16_t>(points_.size());
    std::vector<std::uint8_t> bytes;
    const auto add = [&bytes](const void *from, std::size_t count) {
      const auto *begin = static_cast<const std::uint8_t *>(from);
      bytes.insert(bytes.end(), begin, begin + count);
    };
    const std::size_t size = sizeof(header_) + phases_.size() * sizeof(cycle_phase_t) +
                             elements_.size() * sizeof(cycle_element_t) +
                             points_.size() * sizeof(cycle_point_t) + 4;
    if (size > CYCLE_PROGRAM_BYTES_MAX)
      root_.fail("element", "expected a program of at most 4096 bytes, got " +
                                std::to_string(size) +
                                "; remove points of tables and envelopes, or phases");
    header_.size = static_cast<std::uint16_t>(size);
    add(&header_, sizeof(header_));
    add(phases_.data(), phases_.size() * sizeof(cycle_phase_t));
    add(elements_.data(), elements_.size() * sizeof(cycle_element_t));
    add(points_.data(), points_.size() * sizeof(cycle_point_t));
    std::uint32_t crc = UINT32_MAX;
    for (const std::uint8_t byte : bytes) crc = fx_crc32(crc, byte);
    crc = ~crc;
    add(&crc, sizeof(crc));
    program_.record.resize(bytes.size() / 4);
    std::memcpy(program_.record.data(), bytes.data(), bytes.size());
  }

  Section &root_;
  const Scales &scales_;
  CycleProgram &program_;
  Names names_;
  cycle_header_t header_{};
  std::vector<cycle_phase_t> phases_;
  std::vector<cycle_element_t> elements_;
  std::vector<cycle_point_t> points_;
  bool has_tare_ = false;
};

}  // namespace

static_assert(std::endian::native == std::endian::little, "the record has the lowest byte first");

CycleProgram read_cycle(const std::filesystem::path &file, const sim::Model &model,
                        const std::vector<ObjectWrite> &initial) {
  const toml::table table = sim::parse_toml(file.string());
  sim::Source source{file.string(), {}};
  Section root(source, table, "", kCycleFormat);
  const Scales scales(source, model, initial);
  CycleProgram program;
  program.file = file;
  Reader(root, scales, program).read();
  return program;
}

}  // namespace forceaxis::host
