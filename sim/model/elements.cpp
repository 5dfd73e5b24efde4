#include "sim/model/elements.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <limits>
#include <numbers>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace forceaxis::sim {
namespace {

class Elements {
 public:
  Elements(Section &root, Model &model) : root_(root), model_(model) {}

  void read() {
    read_bodies();
    read_structures();
    points_ = model_.point_names();
    read_links();
    read_gravities();
    read_externals();
    read_drive();
    read_sensors();
    read_machine_controller();
  }

 private:
  std::size_t signal(Section &section, const std::vector<SignalInfo> &signals) const;
  void claim(Section &section, const std::string &key, const std::string &name);
  std::string claim_name(Section &section);
  template <class Link>
  Link link(Section &section);
  template <class Link>
  Link touching(Section &section);
  void read_bodies();
  void read_structures();
  void read_links();
  void read_gravities();
  Contact read_contact(Section &section);
  Cogging read_cogging(Section &section);
  void read_externals();
  void read_drive();
  void read_switches(Section &section);
  void read_sensors();
  void read_machine_controller();

  Section &root_;
  Model &model_;
  std::set<std::string> names_;
  std::vector<std::string> points_;
};

// Refuses a name that another element or port has.
void Elements::claim(Section &section, const std::string &key, const std::string &name) {
  if (!names_.insert(name).second)
    section.fail(key, "expected a name that no other element has, got " + in_quotes(name) +
                          " again; rename one element");
}

std::string Elements::claim_name(Section &section) {
  std::string name = section.name();
  claim(section, "name", name);
  return name;
}

// Returns the mass of a body, including the equivalent masses of the inertias that turn with it.
double read_mass(Section &section) {
  if (!section.has("inertia")) {
    if (section.has("r_trans"))
      section.fail("r_trans",
                   "expected inertia beside r_trans, got no such key; add inertia or "
                   "remove r_trans");
    return section.value("mass", Dimension::mass, Sign::positive);
  }
  double mass = section.optional_number("mass").value_or(0.0);
  const std::vector<double> inertias = section.numbers("inertia");
  const std::vector<double> travels = section.numbers("r_trans");
  if (inertias.size() != travels.size())
    section.fail("r_trans", "expected " + std::to_string(inertias.size()) +
                                " values, one for each inertia, got " +
                                std::to_string(travels.size()) + "; add or remove values");
  for (std::size_t i = 0; i < inertias.size(); ++i) mass += inertias[i] / (travels[i] * travels[i]);
  return mass;
}

void Elements::read_bodies() {
  root_.each("body", [&](Section &section) {
    Body body;
    body.name = claim_name(section);
    body.mass = read_mass(section);
    body.position = section.number("position");
    body.velocity = section.number("velocity");
    model_.bodies.push_back(std::move(body));
  });
  constexpr std::size_t kMostBodies = 32;
  if ((model_.bodies.empty() && !root_.has("structure")) || model_.bodies.size() > kMostBodies)
    root_.fail("body", "expected 1.." + std::to_string(kMostBodies) + " bodies, got " +
                           std::to_string(model_.bodies.size()) +
                           "; add or remove [[body]] tables");
}

Structure::Mode read_mode(Section &section, std::size_t ports) {
  Structure::Mode mode;
  mode.frequency_hz = section.number("frequency");
  mode.damping_ratio = section.number("damping_ratio");
  mode.mass = section.number("modal_mass");
  mode.shape = section.numbers("shape");
  if (mode.frequency_hz == 0.0 && mode.damping_ratio > 0.0)
    section.fail("damping_ratio", "expected 0 beside the frequency 0, got " +
                                      number_text(mode.damping_ratio) +
                                      "; remove this key, a [[damper]] can damp a rigid body");
  if (mode.shape.size() != ports)
    section.fail("shape", "expected " + std::to_string(ports) +
                              " values, one for each of ports, got " +
                              std::to_string(mode.shape.size()) + "; add or remove values");
  return mode;
}

void Elements::read_structures() {
  std::size_t count = 0;
  root_.each("structure", [&](Section &section) {
    Structure structure;
    structure.name = claim_name(section);
    structure.ports = section.names("ports");
    section.each("mode", [&](Section &mode) {
      structure.modes.push_back(read_mode(mode, structure.ports.size()));
    });
    if (structure.modes.empty())
      section.fail("mode", "expected at least one mode, got none; add [[structure.mode]]");
    for (std::size_t port = 0; port < structure.ports.size(); ++port) {
      const std::string key = "ports[" + std::to_string(port) + "]";
      claim(section, key, structure.ports[port]);
      if (std::all_of(structure.modes.begin(), structure.modes.end(),
                      [&](const Structure::Mode &mode) { return mode.shape[port] == 0.0; }))
        section.fail(key, "expected a port that a mode moves, got " +
                              in_quotes(structure.ports[port]) +
                              ", whose shape is 0 in each mode; remove this port");
    }
    count += structure.modes.size();
    model_.structures.push_back(std::move(structure));
  });
  constexpr std::size_t kMostModes = 32;
  if (count > kMostModes)
    root_.fail("structure", "expected at most " + std::to_string(kMostModes) +
                                " modes of all structures together, got " + std::to_string(count) +
                                "; remove the modes with the highest frequencies");
}

// Reads the slopes of a curve and the breaks between them. A break is an input of the curve, or a
// force of a spring (`loads`).
Slopes read_slopes(Section &section, const char *key) {
  Slopes curve;
  curve.slopes = section.numbers(key);
  const bool loadable = std::string_view(key) == "stiffness";
  const bool by_load = loadable && section.has("loads");
  curve.breaks = section.rising("breaks");
  if (by_load) {
    if (!curve.breaks.empty())
      section.fail("loads", "expected breaks or loads, got both keys; remove one key");
    curve.breaks = section.rising("loads");
  }
  if (curve.breaks.size() + 1 != curve.slopes.size())
    section.fail(by_load                ? "loads"
                 : curve.breaks.empty() ? key
                                        : "breaks",
                 "expected one value fewer in " +
                     std::string(loadable ? "breaks or loads" : "breaks") + " than in " + key +
                     ", got " + std::to_string(curve.breaks.size()) + " and " +
                     std::to_string(curve.slopes.size()) + "; add or remove values");
  if (!by_load) return curve;

  // The deflection at a load is the sum of the deflections of all segments between the force 0 and
  // this load.
  const std::vector<double> loads = curve.breaks;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (double &at : curve.breaks) {
    const double low = std::min(at, 0.0);
    const double high = std::max(at, 0.0);
    double way = 0.0;
    for (std::size_t k = 0; k < curve.slopes.size(); ++k) {
      const double from = std::max(low, k == 0 ? -kInfinity : loads[k - 1]);
      const double to = std::min(high, k == loads.size() ? kInfinity : loads[k]);
      if (!(curve.slopes[k] > 0.0))
        section.fail(key, "expected values > 0 beside loads, got " + number_text(curve.slopes[k]) +
                              "; a spring without stiffness cannot carry a load");
      if (to > from) way += (to - from) / curve.slopes[k];
    }
    at = at < 0.0 ? -way : way;
  }
  return curve;
}

// Reads the keys that every element with two ends has.
template <class Link>
Link Elements::link(Section &section) {
  Link element;
  element.name = claim_name(section);
  element.ends = section.between(points_);
  return element;
}

// Refuses keys that have a meaning only beside another key.
void only_beside(Section &section, const char *beside, std::initializer_list<const char *> keys) {
  for (const char *key : keys)
    if (section.has(key) && !section.has(beside))
      section.fail(key, "expected " + std::string(beside) + " beside " + key +
                            ", got no such key; add " + beside + " or remove " + key);
}

std::optional<Maxwell> read_maxwell(Section &section) {
  only_beside(section, "maxwell_stiffness", {"maxwell_time"});
  const auto stiffness = section.optional_number("maxwell_stiffness");
  if (!stiffness) return std::nullopt;
  return Maxwell{*stiffness, section.value("maxwell_time", Dimension::time, Sign::positive)};
}

std::optional<Hysteresis> read_hysteresis(Section &section) {
  only_beside(section, "hysteresis_stiffness", {"hysteresis_force"});
  const auto stiffness = section.optional_number("hysteresis_stiffness");
  if (!stiffness) return std::nullopt;
  return Hysteresis{*stiffness,
                    section.value("hysteresis_force", Dimension::force, Sign::positive)};
}

double read_damping(Section &section) { return section.number("damping"); }

// Reads the common keys of backlashes and stops.
template <class Link>
Link Elements::touching(Section &section) {
  Link element = link<Link>(section);
  element.stiffness = section.number("stiffness");
  element.damping = read_damping(section);
  return element;
}

// Returns the forces of one period of a cogging at equal distances.
std::vector<double> read_period(Section &section) {
  std::vector<double> forces = section.numbers("force");
  if (forces.size() > 1) {
    if (section.has("segments"))
      section.fail("segments",
                   "expected no segments beside a list of forces, got both; remove one");
    return forces;
  }
  const double amplitude = forces.front();
  const int segments = section.integer("segments");
  forces.clear();
  for (int k = 0; k < segments; ++k)
    forces.push_back(amplitude * std::sin(2.0 * std::numbers::pi * k / segments));
  return forces;
}

Cogging Elements::read_cogging(Section &section) {
  auto cogging = link<Cogging>(section);
  const std::vector<double> period = read_period(section);
  const double width = section.number("period") / static_cast<double>(period.size());
  const double start = section.number("position");
  const double from = section.number("from");
  const double to = section.number("to");
  if (!(to > from))
    section.fail("to", "expected a value greater than from, " + number_text(from) + ", got " +
                           number_text(to) + "; exchange or correct the two values");
  constexpr double kMostSegments = 1000.0;
  if ((to - from) / width > kMostSegments)
    section.fail("period", "expected at most 1000 segments between from and to, got " +
                               number_text((to - from) / width) +
                               "; shorten the travel, or give fewer segments");
  // The places are multiples of the width from the start of a period that lies before the travel.
  const auto first = static_cast<long>(std::floor((from - start) / width));
  const auto last = static_cast<long>(std::ceil((to - start) / width));
  const auto count = static_cast<long>(period.size());
  for (long k = first; k <= std::max(last, first + 1); ++k) {
    cogging.places.push_back(start + static_cast<double>(k) * width);
    cogging.forces.push_back(period[static_cast<std::size_t>(((k % count) + count) % count)]);
  }
  for (std::size_t k = 1; k < cogging.places.size(); ++k)
    if (!(cogging.places[k] > cogging.places[k - 1]))
      section.fail("period", "expected a period that the position resolves, got " +
                                 number_text(section.number("period")) + "; correct it");
  return cogging;
}

void Elements::read_externals() {
  root_.each("external", [&](Section &section) {
    External external;
    external.name = claim_name(section);
    external.body = section.point("body", points_, false, std::nullopt);
    external.times = section.rising("times");
    external.forces = section.numbers("forces");
    if (external.times.size() < 2)
      section.fail("times", "expected at least two times, got " +
                                std::to_string(external.times.size()) +
                                "; add the begin and the end of the force");
    if (external.forces.size() != external.times.size())
      section.fail("forces", "expected " + std::to_string(external.times.size()) +
                                 " values, one for each of times, got " +
                                 std::to_string(external.forces.size()) + "; add or remove values");
    model_.externals.push_back(std::move(external));
  });
}

Contact Elements::read_contact(Section &section) {
  auto contact = link<Contact>(section);
  contact.stiffness = read_slopes(section, "stiffness");
  contact.damping = read_damping(section);
  contact.gap = section.number("gap");
  contact.maxwell = read_maxwell(section);
  contact.hysteresis = read_hysteresis(section);
  const bool linear = contact.damping == 0.0 && contact.stiffness.slopes.size() == 1;
  if (contact.hysteresis && (!linear || contact.maxwell))
    section.fail("hysteresis_stiffness",
                 "expected one stiffness, no damping and no maxwell_stiffness beside "
                 "hysteresis_stiffness, got more; remove the other keys");
  if (contact.maxwell && !linear)
    section.fail("maxwell_stiffness",
                 "expected one stiffness and no damping beside maxwell_stiffness, got more; "
                 "remove the damping or the further segments");
  return contact;
}

void Elements::read_links() {
  root_.each("spring", [&](Section &section) {
    auto spring = link<Spring>(section);
    spring.stiffness = read_slopes(section, "stiffness");
    spring.damping = read_damping(section);
    spring.maxwell = read_maxwell(section);
    model_.springs.push_back(std::move(spring));
  });
  root_.each("damper", [&](Section &section) {
    auto damper = link<Damper>(section);
    damper.damping = read_slopes(section, "damping");
    model_.dampers.push_back(std::move(damper));
  });
  root_.each("contact",
             [&](Section &section) { model_.contacts.push_back(read_contact(section)); });
  root_.each("backlash", [&](Section &section) {
    auto backlash = touching<Stop>(section);
    const double width = section.number("width");
    backlash.low = -0.5 * width;
    backlash.high = 0.5 * width;
    model_.stops.push_back(std::move(backlash));
  });
  root_.each("stop", [&](Section &section) {
    auto stop = touching<Stop>(section);
    stop.low = section.optional_number("low");
    stop.high = section.optional_number("high");
    if (!stop.low && !stop.high)
      section.fail("low",
                   "expected low or high or both in m, got no such key; add one of these keys");
    if (stop.low && stop.high && !(*stop.low < *stop.high))
      section.fail("high", "expected a value greater than low, " + number_text(*stop.low) +
                               ", got " + number_text(*stop.high) +
                               "; exchange or correct the two values");
    model_.stops.push_back(std::move(stop));
  });
  root_.each("friction", [&](Section &section) {
    auto friction = link<Friction>(section);
    friction.coulomb = section.number("coulomb");
    friction.stiction = section.optional_number("stiction").value_or(friction.coulomb);
    if (friction.stiction < friction.coulomb)
      section.fail("stiction", "expected at least coulomb, " + number_text(friction.coulomb) +
                                   ", got " + number_text(friction.stiction) +
                                   "; the breakaway force is not less than the sliding force");
    model_.frictions.push_back(std::move(friction));
  });
  root_.each("cogging",
             [&](Section &section) { model_.coggings.push_back(read_cogging(section)); });
  root_.each("brake", [&](Section &section) {
    auto brake = link<Brake>(section);
    brake.holding = section.number("holding");
    brake.release_s = section.number("release");
    brake.engage_s = section.number("engage");
    model_.brakes.push_back(std::move(brake));
  });
}

void Elements::read_gravities() {
  root_.each("gravity", [&](Section &section) {
    Gravity gravity;
    gravity.name = claim_name(section);
    gravity.body = section.point("body", points_, false, std::nullopt);
    if (!model_.is_body(gravity.body))
      section.fail("body", "expected a body, got the port " +
                               in_quotes(points_[static_cast<std::size_t>(gravity.body)]) +
                               ", whose mass is not known; give the weight of the structure as an "
                               "[[external]] force");
    gravity.accelerations = section.numbers("acceleration");
    gravity.positions = section.rising("positions");
    const std::size_t wanted = gravity.accelerations.size() == 1 ? 0 : gravity.accelerations.size();
    if (gravity.positions.size() != wanted)
      section.fail("positions", "expected " + std::to_string(wanted) +
                                    " values, one for each of a list in acceleration, got " +
                                    std::to_string(gravity.positions.size()) +
                                    "; add or remove values");
    model_.gravities.push_back(std::move(gravity));
  });
}

DcMotor read_motor(Section &section) {
  DcMotor motor;
  motor.input_tach = section.choice("input", "choose the use of the DAC voltage") == 1;
  motor.k_preamp_cmd = section.number("k_preamp_cmd");
  motor.k_preamp_fdbk = section.number("k_preamp_fdbk");
  motor.a_preamp_fdbk = section.number("a_preamp_fdbk");
  motor.k_tach = section.number("k_tach");
  motor.k_torque = section.number("k_torque");
  motor.k_back_emf = section.number("k_back_emf");
  motor.inductance = section.number("L");
  motor.resistance = section.number("R");
  motor.r_trans = section.number("r_trans");
  motor.b_m = section.number("b_m");
  motor.k_current = section.number("k_current");
  motor.current_feedback_limit = section.optional_number("current_feedback_limit");
  motor.preamp_limit = section.optional_number("preamp_limit");
  motor.k_amp = section.number("k_amp");
  motor.amp_break = section.optional_number("amp_break");
  if (motor.amp_break) {
    motor.k_amp_outer = section.number("k_amp_outer");
  } else if (section.has("k_amp_outer")) {
    section.fail("amp_break",
                 "expected a finite number > 0 in V beside k_amp_outer, got nothing; "
                 "add this key or remove k_amp_outer");
  } else {
    motor.k_amp_outer = motor.k_amp;
  }
  motor.supply_limit = section.optional_number("supply_limit");
  return motor;
}

FirstOrderDrive read_first_order(Section &section) {
  FirstOrderDrive simple;
  simple.k_act = section.number("k_act");
  simple.a_act = section.number("a_act");
  simple.velocity_per_volt = section.number("velocity_per_volt");
  simple.force_limit = section.optional_number("force_limit");
  return simple;
}

PerfectDrive read_perfect(Section &section) {
  PerfectDrive perfect;
  perfect.force_per_volt = section.number("force_per_volt");
  perfect.force_limit = section.optional_number("force_limit");
  return perfect;
}

// Refuses a file that has both or none of two keys or groups of keys.
void one_of(Section &section, const char *one, const char *other, const std::string &what) {
  if (section.has(one) != section.has(other)) return;
  const bool both = section.has(one);
  section.fail(one, "expected " + std::string(one) + " or " + other + ", got " +
                        (both ? "both keys" : "no such key") + "; " +
                        (both ? "remove one of them" : "give " + what));
}

// `turns`: another key needs the transmission of the motor beside k_force.
DriveMotor read_drive_motor(Section &section, bool turns) {
  DriveMotor motor;
  one_of(section, "k_force", "k_torque", "the force or torque constant of the motor");
  if (const auto direct = section.optional_number("k_force")) {
    motor.force_per_amp = *direct;
    if (section.has("r_trans") && !turns)
      section.fail("r_trans", "expected no r_trans beside k_force, got one; remove one key");
  } else {
    motor.force_per_amp = *section.optional_number("k_torque") /
                          section.value("r_trans", Dimension::transmission, Sign::positive);
  }
  motor.rate = section.number("current_bandwidth");
  motor.peak_current = section.optional_number("peak_current");
  motor.rated_current = section.optional_number("rated_current");
  only_beside(section, "peak_current", {"rated_current"});
  only_beside(section, "rated_current", {"peak_time"});
  if (!motor.rated_current) return motor;
  motor.peak_time = section.value("peak_time", Dimension::time, Sign::positive);
  if (!(*motor.rated_current < *motor.peak_current))
    section.fail("rated_current", "expected a current below peak_current, " +
                                      number_text(*motor.peak_current) + " A, got " +
                                      number_text(*motor.rated_current) +
                                      "; exchange or correct the two currents");
  return motor;
}

TorqueDrive read_torque(Section &section) {
  TorqueDrive torque;
  torque.current_per_volt = section.number("current_per_volt");
  torque.motor = read_drive_motor(section, false);
  torque.damping = section.number("damping");
  return torque;
}

VelocityDrive read_velocity(Section &section) {
  VelocityDrive drive;
  drive.velocity_per_volt = section.number("velocity_per_volt");
  drive.motor = read_drive_motor(section, section.has("tuned_inertia"));
  one_of(section, "k_velocity", "bandwidth", "the gain or the bandwidth of the velocity loop");
  only_beside(section, "k_velocity", {"integral_time"});
  only_beside(section, "bandwidth", {"damping_ratio", "tuned_mass", "tuned_inertia"});
  if (const auto gain = section.optional_number("k_velocity")) {
    drive.k_velocity = *gain;
    drive.integral_time = section.optional_number("integral_time");
    return drive;
  }
  const double bandwidth = *section.optional_number("bandwidth");
  one_of(section, "tuned_mass", "tuned_inertia", "the mass or inertia of the tuning");
  auto mass = section.optional_number("tuned_mass");
  if (!mass) {
    const double r = section.value("r_trans", Dimension::transmission, Sign::positive);
    mass = *section.optional_number("tuned_inertia") / (r * r);
  }
  constexpr double kDampingRatio = 0.7071;
  const double ratio = section.optional_number("damping_ratio").value_or(kDampingRatio);
  const auto gains = velocity_gains(*mass, bandwidth, ratio, drive.motor.rate);
  if (!gains)
    section.fail("bandwidth", "expected a bandwidth that a current loop of " +
                                  number_text(drive.motor.rate) + " rad/s permits, got " +
                                  number_text(bandwidth) +
                                  " rad/s; lower it, lower damping_ratio or raise "
                                  "current_bandwidth");
  drive.k_velocity = gains->k_velocity;
  drive.integral_time = gains->integral_time;
  return drive;
}

StepperDrive read_stepper(Section &section) {
  StepperDrive stepper;
  stepper.velocity_per_volt = section.number("velocity_per_volt");
  stepper.holding_force = section.number("holding_force");
  stepper.full_step = section.number("full_step");
  stepper.damping = section.number("damping");
  stepper.segments = section.integer("segments");
  if (stepper.segments % 4 != 0)
    section.fail("segments",
                 "expected a multiple of 4, so that a point has the holding force, got " +
                     std::to_string(stepper.segments) + "; give 16");
  return stepper;
}

BusCycle read_bus(Section &section) {
  BusCycle bus;
  bus.ticks = section.integer("cycle_ticks");
  if (bus.ticks != 1 && bus.ticks % 3 != 0)
    section.fail("cycle_ticks", "expected 1, or a multiple of 3 ticks, which are 2 ms, got " +
                                    std::to_string(bus.ticks) +
                                    "; set the bus to a cycle of 2 ms, 4 ms or longer");
  bus.delay_ticks_out = section.integer("delay_ticks_out");
  bus.delay_ticks_in = section.integer("delay_ticks_in");
  return bus;
}

void Elements::read_drive() {
  root_.one("drive", [&](Section &section) {
    Drive drive;
    const std::size_t type = section.choice("type", "choose a drive type");
    drive.body = section.point("body", points_, false, std::nullopt);
    drive.reaction = section.point("reaction", points_, true, kGround);
    if (drive.body == drive.reaction)
      section.fail("reaction", "expected another body than drive.body or ground, got " +
                                   in_quotes(points_[static_cast<std::size_t>(drive.body)]) +
                                   "; choose the body on which the reaction force acts");
    drive.bus = read_bus(section);
    if (section.has("enable_ticks")) drive.enable_ticks = section.integer("enable_ticks");
    section.add(*section.format().added[type]);
    if (type == 0) {
      drive.type = read_motor(section);
    } else if (type == 1) {
      drive.type = read_first_order(section);
    } else if (type == 2) {
      drive.type = read_perfect(section);
    } else if (type == 3) {
      drive.type = read_torque(section);
    } else if (type == 4) {
      drive.type = read_velocity(section);
    } else {
      drive.type = read_stepper(section);
    }
    model_.drive = drive;
  });
}

std::optional<Dimension> per_count(Dimension dimension) {
  switch (dimension) {
    case Dimension::force:
      return Dimension::force_per_count;
    case Dimension::current:
      return Dimension::current_per_count;
    case Dimension::voltage:
      return Dimension::voltage_per_count;
    case Dimension::length:
      return Dimension::length_per_count;
    case Dimension::velocity:
      return Dimension::velocity_per_count;
    case Dimension::acceleration:
      return Dimension::acceleration_per_count;
    case Dimension::force_rate:
      return Dimension::force_rate_per_count;
    default:
      return std::nullopt;
  }
}

void Elements::read_switches(Section &section) {
  const auto place = [&](const char *key) { return section.optional_number(key); };
  const auto in_order = [&](const std::optional<double> &low, const std::optional<double> &high,
                            const char *low_key, const char *high_key) {
    if (low && high && *low >= *high)
      section.fail(high_key, std::string("expected a position beyond ") + low_key + " = " +
                                 number_text(*low) + " m, got " + number_text(*high) +
                                 "; exchange or correct the two positions");
  };
  Switches &switches = model_.switches;
  switches.limit_neg = place("limit_neg");
  switches.limit_pos = place("limit_pos");
  switches.home_from = place("home_from");
  switches.home_to = place("home_to");
  switches.index = place("index");
  switches.index_every = section.optional_number("index_every");
  in_order(switches.limit_neg, switches.limit_pos, "limit_neg", "limit_pos");
  in_order(switches.home_from, switches.home_to, "home_from", "home_to");
  if (switches.index_every && !switches.index)
    section.fail(
        "index_every",
        "expected the position of one index pulse too, got no index; add index, such as 0");
  if (!model_.encoder)
    root_.fail(
        "switches",
        "expected an encoder, whose position activates the switches, got none; add [encoder]");
}

// Reduces a converter of more than 16 bits to the upper 16 bits of its code.
void keep_upper_bits(Adc &adc) {
  constexpr int kFirmwareBits = 16;
  if (adc.bits <= kFirmwareBits) return;
  const int codes = 1 << (adc.bits - kFirmwareBits);
  adc.rounding = (0.5 + adc.zero_code % codes) / codes;
  adc.zero_code /= codes;
  adc.per_count *= codes;
  adc.bits = kFirmwareBits;
}

// The simulation does not distinguish shorter times from 0.
double time_or_0(double time_s) {
  constexpr double kShortest = 1e-9;
  return time_s < kShortest ? 0.0 : time_s;
}

std::optional<Sampling> read_sampling(Section &section) {
  Sampling sampling;
  const auto rate = section.optional_number("sample_rate");
  sampling.rate_hz = rate.value_or(sampling.rate_hz);
  const auto phase = section.optional_number("sample_phase");
  sampling.phase_s = time_or_0(phase.value_or(0.0));
  sampling.phase_known = phase || !rate;
  sampling.latency_s = time_or_0(section.number("latency"));
  if (!(sampling.phase_s * sampling.rate_hz < 1.0))
    section.fail("sample_phase", "expected a time below one period of the samples, " +
                                     number_text(1.0 / sampling.rate_hz) + " s, got " +
                                     number_text(sampling.phase_s) +
                                     " s; give the time to the first sample");
  if (!rate && sampling.phase_s == 0.0 && sampling.latency_s == 0.0) return std::nullopt;
  return sampling;
}

// Reads the order of the converter's filter, 0 for none.
int read_sinc_order(Section &section) {
  constexpr int kOrders[] = {0, 3, 4, 5};
  const std::size_t filter =
      section.choice("converter_filter", "take the filter from the data sheet of the converter");
  if (filter > 0) only_beside(section, "sample_rate", {"converter_filter"});
  return kOrders[filter];
}

// Reads creep and drift. `unit` is that of the signal.
void read_slow_errors(Section &section, Dimension unit, Adc &adc) {
  only_beside(section, "creep", {"creep_time"});
  only_beside(section, "drift", {"drift_time"});
  if (const auto share = section.optional_number("creep"))
    adc.creep = Creep{*share, section.number("creep_time")};
  if (const auto final = section.optional_value("drift", unit, Sign::any))
    adc.drift = Drift{*final, section.number("drift_time")};
}

// Returns the index of the signal that the key `signal` names.
std::size_t Elements::signal(Section &section, const std::vector<SignalInfo> &signals) const {
  std::vector<std::string> names;
  for (const SignalInfo &known : signals) names.push_back(known.name);
  const std::string name = section.text("signal", "a signal's name");
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end())
    section.fail("signal", "expected one of " + joined(names) + ", got " + in_quotes(name) +
                               suggestion(name, names) + "; name a signal of this model");
  return static_cast<std::size_t>(found - names.begin());
}

// Returns the voltage of the drive for a command of 1 m/s, or of 1 N for a `force`. The drive must
// follow such commands.
double volts_per_command(Section &section, const Drive &drive, bool force) {
  if (const auto *first = std::get_if<FirstOrderDrive>(&drive.type); first && !force)
    return 1.0 / first->velocity_per_volt;
  if (const auto *velocity = std::get_if<VelocityDrive>(&drive.type); velocity && !force)
    return 1.0 / velocity->velocity_per_volt;
  if (const auto *stepper = std::get_if<StepperDrive>(&drive.type); stepper && !force)
    return 1.0 / stepper->velocity_per_volt;
  if (const auto *perfect = std::get_if<PerfectDrive>(&drive.type); perfect && force)
    return 1.0 / perfect->force_per_volt;
  if (const auto *torque = std::get_if<TorqueDrive>(&drive.type); torque && force)
    return 1.0 / (torque->current_per_volt * torque->motor.force_per_amp);
  section.fail("law", std::string("expected a drive that follows ") +
                          (force ? "a force (perfect, torque)"
                                 : "a velocity (first_order, velocity, stepper)") +
                          ", got another type; change drive.type");
}

MachineTable read_machine_table(Section &section, bool *force) {
  MachineTable table;
  one_of(section, "speeds", "forces", "the commands of the table");
  *force = section.has("forces");
  const char *key = *force ? "forces" : "speeds";
  table.times = section.rising("times");
  table.values = section.numbers(key);
  table.interpolated = section.flag("interpolated");
  if (table.times.size() < 2)
    section.fail("times", "expected at least two times, got " + std::to_string(table.times.size()) +
                              "; add times");
  if (table.values.size() != table.times.size())
    section.fail(key, "expected " + std::to_string(table.times.size()) +
                          " values, one for each of the times, got " +
                          std::to_string(table.values.size()) + "; add or remove values");
  return table;
}

void Elements::read_machine_controller() {
  const std::vector<SignalInfo> signals = model_.signal_list();
  root_.one("machine_controller", [&](Section &section) {
    if (!model_.drive) section.fail("law", "expected a model with a drive, got none; add [drive]");
    if (model_.drive->enable_ticks || !model_.drive->bus.immediate())
      section.fail("law",
                   "expected a drive without bus and enable_ticks, which are those of the "
                   "firmware; remove these keys of [drive]");
    MachineController controller;
    const std::size_t law = section.choice("law", "choose a law");
    section.add(*section.format().added[law]);
    controller.cycle_ticks = section.integer("cycle_ticks");
    bool force = false;
    if (law == 0) {
      controller.law = read_machine_table(section, &force);
    } else {
      const SignalInfo &measured = signals[signal(section, signals)];
      if (measured.dimension != Dimension::force)
        section.fail("signal", "expected a force in N, got " + in_quotes(measured.name) +
                                   "; name the force that the controller measures");
      controller.signal = measured.name;
      controller.setpoint = section.number("setpoint");
      controller.speed_max = section.number("speed_max");
      controller.filter = section.optional_number("filter");
      controller.delay_ticks = section.integer("delay_ticks");
      const double damping = section.number("damping");
      if (law == 1)
        controller.law = MachineAdmittance{section.number("mass"), damping};
      else
        controller.law = MachineForcePi{damping, section.optional_number("integral_time")};
    }
    controller.volts_per_command = volts_per_command(section, *model_.drive, force);
    model_.machine_controller = controller;
  });
}

void Elements::read_sensors() {
  root_.one("encoder", [&](Section &section) {
    Encoder encoder;
    encoder.body = section.point("body", points_, false, std::nullopt);
    encoder.reference = section.point("reference", points_, true, kGround);
    if (encoder.body == encoder.reference)
      section.fail("reference",
                   "expected another body than encoder.body or ground, got the same; "
                   "choose the body to which the position is relative");
    encoder.scale = section.number("scale");
    model_.encoder = encoder;
  });
  root_.one("switches", [&](Section &section) { read_switches(section); });
  const std::vector<SignalInfo> signals = model_.signal_list();
  root_.each("adc", [&](Section &section) {
    const auto channel = static_cast<std::size_t>(section.integer("channel"));
    if (model_.adc[channel])
      section.fail("channel", "expected a channel not used before, got " + std::to_string(channel) +
                                  " again; there are channels 0 and 1");
    Adc adc;
    const SignalInfo &measured = signals[signal(section, signals)];
    adc.signal = measured.name;
    const Dimension unit = measured.dimension;
    read_slow_errors(section, unit, adc);
    adc.sensor_limit = section.optional_value("sensor_limit", unit, Sign::positive);
    adc.filter = section.optional_number("filter");
    constexpr double kFastestFilter = 1e6;
    if (adc.filter && *adc.filter > kFastestFilter)
      section.fail("filter", "expected at most 1e6 rad/s, got " + number_text(*adc.filter) +
                                 "; omit a filter whose effect within a tick is negligible");
    adc.conditioning_limit = section.optional_value("conditioning_limit", unit, Sign::positive);
    adc.noise = section.value_or("noise", unit, Sign::not_negative, 0.0);
    adc.per_count = section.value("per_count", *per_count(unit), Sign::not_zero);
    adc.bits = section.integer("bits");
    const double zero = section.number("zero_code");
    const int top = (1 << adc.bits) - 1;
    if (!(zero >= 0.0 && zero <= top && zero == static_cast<int>(zero)))
      section.fail("zero_code", "expected a whole number 0.." + std::to_string(top) + ", got " +
                                    number_text(zero) + "; choose a code of this ADC");
    adc.zero_code = static_cast<int>(zero);
    keep_upper_bits(adc);
    adc.sampling = read_sampling(section);
    adc.sinc_order = read_sinc_order(section);
    model_.adc[channel] = adc;
  });
  root_.one("dac", [&](Section &section) {
    model_.dac.bits = section.integer("bits");
    model_.dac.range = section.number("range");
    model_.dac.offset = section.number("offset");
    model_.dac.noise = section.number("noise");
  });
}

}  // namespace

// The poles are the roots of (s^2 + 2 zeta w s + w^2) (s + p), whose sum is the current bandwidth.
// The bandwidth of the closed loop rises with w from 0 to its limit at p = 0.
std::optional<VelocityGains> velocity_gains(double mass_kg, double bandwidth, double damping_ratio,
                                            double current_bandwidth) {
  const auto gains = [&](double w) {
    const double p = current_bandwidth - 2.0 * damping_ratio * w;
    const double middle = w * w + 2.0 * damping_ratio * w * p;
    return VelocityGains{mass_kg * middle / current_bandwidth, middle / (w * w * p)};
  };
  const auto follows = [&](double w) {
    const VelocityGains at = gains(w);
    const double p = current_bandwidth - 2.0 * damping_ratio * w;
    const double top = at.k_velocity * current_bandwidth / mass_kg;
    // Squares of the magnitudes: std::hypot has other last digits in other versions of libm.
    const auto squared = [](double re, double im) { return re * re + im * im; };
    const double up = squared(top * bandwidth, top / at.integral_time);
    const double down =
        squared(w * w - bandwidth * bandwidth, 2.0 * damping_ratio * w * bandwidth) *
        squared(bandwidth, p);
    return 2.0 * up >= down;
  };
  double low = 0.0;
  double high = current_bandwidth / (2.0 * damping_ratio);
  constexpr double kMost = 1.0 - 1e-9;  // at 1 there is no integral
  if (!follows(high * kMost)) return std::nullopt;
  high *= kMost;
  for (int k = 0; k < 200 && low < high; ++k) {
    const double middle = 0.5 * (low + high);
    (follows(middle) ? high : low) = middle;
  }
  return gains(high);
}

void read_elements(Section &root, Model &model) { Elements(root, model).read(); }

}  // namespace forceaxis::sim
