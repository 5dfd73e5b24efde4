#include "host/run/cycle_check.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <set>
#include <string>

#include "sim/model/text.hpp"

namespace forceaxis::host {
namespace {

using Phases = std::set<std::size_t>;

class Checker {
 public:
  Checker(const CycleProgram &program, const CycleCode &code, const CycleScales &scales,
          const CyclePlace &root)
      : program_(program), code_(code), scales_(scales), root_(root) {
    for (std::size_t i = 0; i < code.phases.size(); ++i)
      if (code.phases[i].action == CYCLE_TARE) tared_.insert(i);
    tared_ = reached_from(tared_, Ways::all);
  }

  void check() const {
    check_header();
    for (std::size_t i = 0; i < code_.phases.size(); ++i)
      check(program_.phases[i], code_.phases[i], root_.at("phase", i));
    check_flow();
    const Phases intended = reached_from({0}, Ways::intended);
    for (std::size_t i = 0; i < code_.elements.size(); ++i)
      check(code_.elements[i], intended, program_.elements[i].name, root_.at("element", i));
    int on = 0;
    for (const cycle_phase_t &phase : code_.phases) on |= phase.outputs_on;
    if ((code_.header.outputs_keep & ~on) != 0)
      root_.fail("keep_outputs",
                 "expected outputs that a phase switches on; add outputs_on to a "
                 "phase, or remove the output");
  }

 private:
  void check_header() const {
    if (program_.zero_force) {
      check_shown(root_, "zero_force", code_.header.zero_level);
      if (code_.header.zero_level == 0)
        root_.fail("zero_force",
                   "expected a force of at least 1/256 force count of the axis; raise this force");
    }
    const std::size_t size = code_.header.compliance;
    if (size == 0) return;
    const auto &points = code_.points;
    if (std::max(-points.front().x, points[size - 1].x) > CYCLE_FORCE_MAX_Q8)
      root_.fail("compliance_force", "expected forces within the range of the sensor; lower them");
    if (size > CYCLE_COMPLIANCE_MAX)
      root_.fail("compliance_force",
                 "expected at most 16 points, got " + std::to_string(size) + "; remove some");
    for (std::size_t i = 1; i < size; ++i)
      if (points[i].y < points[i - 1].y)
        root_.fail("compliance_deflection",
                   "expected a deflection that does not fall while the force rises; "
                   "correct the values");
  }

  // Refuses a force at or beyond the end of the sensor's range, because no valid sample can have
  // this force.
  void check_shown(const CyclePlace &place, const char *key, double level_q8, double end_q8) const {
    if (std::fabs(level_q8) < std::fabs(end_q8)) return;
    place.fail(key, "expected less than " + sim::number_text(std::fabs(end_q8 / scales_.q8_per_N)) +
                        " N, the end of what the force sensor can show, got " +
                        sim::number_text(std::fabs(level_q8 / scales_.q8_per_N)) +
                        " N; lower it, or choose a sensor with a larger range");
  }
  void check_shown(const CyclePlace &place, const char *key, double level_q8) const {
    if (level_q8 > 0) check_shown(place, key, level_q8, scales_.most_q8);
    if (level_q8 < 0) check_shown(place, key, level_q8, scales_.least_q8);
  }

  // Refuses the value of a condition if it exceeds a limit of the phase, because the limit would be
  // reached first.
  static void within(const CyclePlace &place, const char *key, std::int64_t value,
                     std::int64_t limit, std::string_view limit_key) {
    if (value > limit)
      place.fail(key, "expected a value within " + std::string(limit_key) +
                          " of the phase, because this limit ends the phase before; lower the "
                          "value or raise the limit");
  }
  std::int64_t limit_of(const cycle_phase_t &phase, std::string_view key) const {
    if (key == "force_max") return force_most(phase);
    return key == "time_max" ? phase.time_max : phase.travel_max;
  }
  // Returns the largest possible force of a phase less the offset of a tare. This offset may be up
  // to tare_band.
  std::int64_t force_most(const cycle_phase_t &phase) const {
    const bool is_tared = tared_.contains(static_cast<std::size_t>(&phase - code_.phases.data()));
    return phase.force_max_q8 + (is_tared ? static_cast<std::int64_t>(scales_.tare_band_q8) : 0);
  }

  void check(const CyclePhase &phase, const cycle_phase_t &code, const CyclePlace &place) const {
    check_shown(place, "force_max", code.force_max_q8, scales_.force_max_q8());
    if (phase.position || phase.distance)
      check_place(place, phase.position ? "position" : "distance", code);
    if (phase.force) check_press(phase, code, place);
    if (!phase.table_x.empty()) check_table(phase, code, place);
    if (phase.tare_s) check_tare(code, place);
    check_outputs(code, place);
    for (std::size_t i = 0; i < phase.ends.size(); ++i)
      check(phase.ends[i], code.conditions[i], code, place.at("end", i));
    within(place, "stiffness_travel", code.stiffness_travel, code.travel_max, "travel_max");
    check_ends(code, place);
  }

  // Refuses a target position beyond a soft limit, because the axis would replace the target by
  // this limit.
  void check_place(const CyclePlace &place, const char *key, const cycle_phase_t &phase) const {
    const bool is_depth = phase.action == CYCLE_MOVE_TO_DEPTH;
    const double target = phase.target;
    if (phase.action == CYCLE_MOVE || (is_depth && code_.header.zero == CYCLE_ZERO_POSITION)) {
      const double at = target + (is_depth ? code_.header.zero_level : 0);
      if (at < scales_.position_least || at > scales_.position_most)
        place.fail(key,
                   "expected a target position within position_limit_min and position_limit_max "
                   "of the axis; change the target or these limits");
    } else if (std::fabs(target) > scales_.span) {
      place.fail(key, "expected at most the travel between the soft limits of the axis, " +
                          sim::number_text(scales_.span / scales_.counts_per_m) +
                          " m; lower it, or widen position_limit_min and _max or position_min "
                          "and _max");
    }
  }

  // Refuses a force that the limits of the axis or of the phase do not allow.
  void check_force(const CyclePlace &place, const char *key, double force, double force_max) const {
    if (std::fabs(force) > scales_.limit_N * (1 + 1e-9))
      place.fail(key, "expected at most force_limit, " + sim::number_text(scales_.limit_N) +
                          " N, got " + sim::number_text(force) +
                          " N; lower it, or raise rated_force or force_limit");
    if (std::fabs(force) > force_max)
      place.fail("force_max", "expected at least the force of the phase, " +
                                  sim::number_text(std::fabs(force)) + " N, got " +
                                  sim::number_text(force_max) + " N; raise it");
  }

  void check_press(const CyclePhase &phase, const cycle_phase_t &code,
                   const CyclePlace &place) const {
    check_force(place, "force", *phase.force, phase.force_max);
    if (code.force == 0)
      place.fail("force", "expected at least a thousandth of rated_force; raise it");
  }

  void check_table(const CyclePhase &phase, const cycle_phase_t &code,
                   const CyclePlace &place) const {
    const std::vector<double> &forces = phase.table_force;
    for (const double force : forces) check_force(place, "table_force", force, phase.force_max);
    if (code.over_travel != 0) return;
    const cycle_point_t *const points = &code_.points[code.first];
    if (points[0].x < 0)
      place.fail("table_x", "expected times of at least 0 s; correct the first one");
    for (std::size_t i = 1; i < forces.size(); ++i) {
      const double ticks = points[i].x - points[i - 1].x;
      const double slope = std::fabs(forces[i] - forces[i - 1]) * scales_.ticks_per_s / ticks;
      if (slope > *phase.slope * (1 + 1e-9))
        place.fail("slope", "expected at least the slope of the table, " + sim::number_text(slope) +
                                " N/s before point " + std::to_string(i) +
                                "; raise it, or make the table less steep");
    }
  }

  void check_tare(const cycle_phase_t &code, const CyclePlace &place) const {
    if (scales_.tare_band_q8 == 0)
      place.fail("do",
                 "expected an axis with a tare_band, which bounds the offset; set tare_band "
                 "in the experiment");
    within(place, "tare_time", code.target, code.time_max, "time_max");
  }

  static void check_outputs(const cycle_phase_t &code, const CyclePlace &place) {
    if ((code.outputs_on & code.outputs_off) != 0)
      place.fail("outputs_off",
                 "expected no output that is also in outputs_on; remove it from one list");
    if (code.action == CYCLE_OUTPUT && (code.outputs_on | code.outputs_off) == 0)
      place.fail("outputs_on",
                 "expected outputs_on or outputs_off for the action output; add one of these keys");
  }

  // Refuses a condition that can never be fulfilled, because of a limit of its phase or because of
  // the range of the force sensor.
  void check(const CycleEnd &end, const cycle_condition_t &code, const cycle_phase_t &phase,
             const CyclePlace &place) const {
    const CycleKind &row = end.when.row();
    if (row.limit.empty()) return;
    const std::int64_t level = std::int64_t{row.direction} * code.level;
    within(place, "value", level, limit_of(phase, row.limit), row.limit);
    if (row.value == sim::Dimension::force && level > 0) check_shown(place, "value", code.level);
  }

  // Refuses the conditions of a phase if none of them ends the phase, or if the action or a limit
  // prevents one of them.
  void check_ends(const cycle_phase_t &phase, const CyclePlace &place) const {
    bool is_reached = false, is_uncounted = false;
    for (const cycle_condition_t &end : phase.conditions) {
      is_reached |= end.when == CYCLE_REACHED;
      is_uncounted |= end.when != CYCLE_NEVER && end.count == 0;
    }
    if (!is_uncounted)
      place.fail("end",
                 "expected a condition without a count, because conditions with a count end "
                 "the phase a limited number of times; add such a condition, or remove a count");
    if (phase.action == CYCLE_TARE && !is_reached)
      place.fail(
          "end",
          "expected a condition reached, because it ends the phase with the measured offset; "
          "add this condition");
    if (is_reached) check_reached(phase, place);
  }

  void check_reached(const cycle_phase_t &phase, const CyclePlace &place) const {
    if (phase.action == CYCLE_WAIT)
      place.fail("end",
                 "expected no condition reached for wait, because wait has no target; use the "
                 "condition time");
    if (phase.action == CYCLE_FOLLOW) {
      const std::string_view key = phase.over_travel != 0 ? "travel_max" : "time_max";
      within(place, "table_x", code_.points[phase.first + std::size_t{phase.points} - 1].x,
             limit_of(phase, key), key);
    }
    if (phase.action != CYCLE_MOVE_BY && phase.action != CYCLE_APPROACH) return;
    const double distance = std::fabs(1.0 * phase.target);
    within(place, "distance", static_cast<std::int64_t>(distance), phase.travel_max, "travel_max");
    if (distance / phase.speed * scales_.ticks_per_s > phase.time_max)
      place.fail("time_max", "expected at least the time of the distance at this speed, " +
                                 sim::number_text(distance / phase.speed) +
                                 " s; raise it or the speed");
  }

  // Selects transitions from a phase to the next phase. `all`: all transitions. `intended`: the
  // transitions that no exceeded limit causes. `uncounted`: the intended transitions without a
  // count.
  enum class Ways { all, intended, uncounted };

  Phases next_of(std::size_t phase, Ways ways) const {
    Phases next;
    for (const cycle_condition_t &end : code_.phases[phase].conditions)
      if (end.when != CYCLE_NEVER && end.next != CYCLE_END &&
          (ways != Ways::uncounted || end.count == 0))
        next.insert(end.next);
    if (ways == Ways::all && code_.phases[phase].reaction != CYCLE_END)
      next.insert(code_.phases[phase].reaction);
    return next;
  }

  Phases reached_from(Phases start, Ways ways) const {
    std::vector<std::size_t> open(start.begin(), start.end());
    while (!open.empty()) {
      const std::size_t phase = open.back();
      open.pop_back();
      for (const std::size_t next : next_of(phase, ways))
        if (start.insert(next).second) open.push_back(next);
    }
    return start;
  }

  void check_flow() const {
    const Phases reached = reached_from({0}, Ways::all);
    for (std::size_t i = 0; i < code_.phases.size(); ++i) {
      const CyclePlace place = root_.at("phase", i);
      const std::string &name = program_.phases[i].name;
      if (!reached.contains(i))
        place.fail("expected a phase that another phase leads to, but nothing leads to " + name +
                   "; name it in `next` or `on_limit`, or remove it");
      if (reached_from(next_of(i, Ways::uncounted), Ways::uncounted).contains(i))
        place.fail("expected a cycle that ends, but " + name +
                   " follows itself without end; give a condition of the loop a count");
    }
  }

  void check(const cycle_element_t &element, const Phases &intended, const std::string &name,
             const CyclePlace &place) const {
    if (!cycle_element_is_valid(&element, code_.points.data(),
                                static_cast<std::uint16_t>(code_.points.size())))
      place.fail("expected curves that rise in x and cover from and to; correct " + name);
    std::int64_t most_q8 = 0, time_most = 0;
    for (const std::size_t phase : intended)
      if ((element.phases >> phase & 1) != 0) {
        most_q8 = std::max(most_q8, force_most(code_.phases[phase]));
        time_most += code_.phases[phase].time_max;
      }
    if (most_q8 == 0)
      place.fail(
          "phases",
          "expected a phase that a good part passes, but the cycle reaches these phases only "
          "after a limit is exceeded; add a phase, or remove the element");
    check_forces(place, element, most_q8);
    if (element.over_time != 0 && element.x_least > time_most)
      place.fail("from",
                 "expected at most the time_max of the phases of the element, " +
                     sim::number_text(static_cast<double>(time_most) / scales_.ticks_per_s) +
                     " s together; lower it");
  }

  // Refuses a bound or level of an evaluation element beyond force_max of its phases, because no
  // good part has such a force.
  static void check_forces(const CyclePlace &place, const cycle_element_t &element,
                           std::int64_t most) {
    const auto beyond = [&](const char *key, const char *what) {
      place.fail(key, std::string("expected a ") + what +
                          " within force_max of the phases of the element, because no good "
                          "part has a force beyond it; lower it, or raise force_max");
    };
    if (element.of_force != 0) {
      if (std::abs(element.level) > most) beyond("level", "level");
      if (std::abs(element.level_2) > most) beyond("level_2", "level");
      return;
    }
    static const std::set<int> kForces = {CYCLE_PEAK, CYCLE_VALLEY, CYCLE_LAST, CYCLE_AT,
                                          CYCLE_WINDOW};
    if (!kForces.contains(element.kind)) return;
    if (element.y_least > most) beyond("least", "force");
    if (element.y_most < -most) beyond("most", "force");
  }

  const CycleProgram &program_;
  const CycleCode &code_;
  const CycleScales &scales_;
  const CyclePlace &root_;
  Phases tared_;  // phases in which the program may have a tare offset
};

}  // namespace

void check_cycle(const CycleProgram &program, const CycleCode &code, const CycleScales &scales,
                 const CyclePlace &place) {
  Checker(program, code, scales, place).check();
}

}  // namespace forceaxis::host
