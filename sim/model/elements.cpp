#include "sim/model/elements.hpp"

#include <algorithm>
#include <cstddef>
#include <limits>
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
    read_links();
    read_gravities();
    read_drive();
    read_sensors();
  }

 private:
  std::string claim_name(Section &section);
  template <class Link>
  Link link(Section &section);
  template <class Link>
  Link touching(Section &section);
  void read_bodies();
  void read_links();
  void read_gravities();
  void read_drive();
  void read_switches(Section &section);
  void read_sensors();

  Section &root_;
  Model &model_;
  std::set<std::string> names_;
};

std::string Elements::claim_name(Section &section) {
  std::string name = section.name();
  if (!names_.insert(name).second)
    section.fail("name", "expected a name that no other element has, got " + in_quotes(name) +
                             " again; rename one element");
  return name;
}

void Elements::read_bodies() {
  root_.each("body", [&](Section &section) {
    Body body;
    body.name = claim_name(section);
    body.mass = section.number("mass");
    body.position = section.number("position");
    body.velocity = section.number("velocity");
    model_.bodies.push_back(std::move(body));
  });
  constexpr std::size_t kMostBodies = 32;
  if (model_.bodies.empty() || model_.bodies.size() > kMostBodies)
    root_.fail("body", "expected 1.." + std::to_string(kMostBodies) + " bodies, got " +
                           std::to_string(model_.bodies.size()) +
                           "; add or remove [[body]] tables");
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
  element.ends = section.between(model_.bodies);
  return element;
}

double read_damping(Section &section) { return section.number("damping"); }

// Reads the common keys of contacts and stops.
template <class Link>
Link Elements::touching(Section &section) {
  Link element = link<Link>(section);
  element.stiffness = section.number("stiffness");
  element.damping = read_damping(section);
  return element;
}

void Elements::read_links() {
  root_.each("spring", [&](Section &section) {
    auto spring = link<Spring>(section);
    spring.stiffness = read_slopes(section, "stiffness");
    spring.damping = read_damping(section);
    model_.springs.push_back(std::move(spring));
  });
  root_.each("damper", [&](Section &section) {
    auto damper = link<Damper>(section);
    damper.damping = read_slopes(section, "damping");
    model_.dampers.push_back(std::move(damper));
  });
  root_.each("contact", [&](Section &section) {
    auto contact = touching<Contact>(section);
    contact.gap = section.number("gap");
    model_.contacts.push_back(std::move(contact));
  });
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
    gravity.body = section.body("body", model_.bodies, false, std::nullopt);
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

void Elements::read_drive() {
  root_.one("drive", [&](Section &section) {
    Drive drive;
    const std::size_t type = section.choice("type", "choose a drive type");
    drive.body = section.body("body", model_.bodies, false, std::nullopt);
    drive.reaction = section.body("reaction", model_.bodies, true, kGround);
    if (drive.body == drive.reaction)
      section.fail("reaction",
                   "expected another body than drive.body or ground, got " +
                       in_quotes(model_.bodies[static_cast<std::size_t>(drive.body)].name) +
                       "; choose the body on which the reaction force acts");
    section.add(*section.format().added[type]);
    if (type == 0) {
      drive.type = read_motor(section);
    } else if (type == 1) {
      drive.type = read_first_order(section);
    } else {
      drive.type = read_perfect(section);
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

void Elements::read_sensors() {
  root_.one("encoder", [&](Section &section) {
    Encoder encoder;
    encoder.body = section.body("body", model_.bodies, false, std::nullopt);
    encoder.reference = section.body("reference", model_.bodies, true, kGround);
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
    std::vector<std::string> names;
    for (const SignalInfo &signal : signals) names.push_back(signal.name);
    Adc adc;
    adc.signal = section.text("signal", "a signal's name");
    const auto found = std::find(names.begin(), names.end(), adc.signal);
    if (found == names.end())
      section.fail("signal", "expected one of " + joined(names) + ", got " + in_quotes(adc.signal) +
                                 suggestion(adc.signal, names) + "; name a signal of this model");
    const SignalInfo &signal = signals[static_cast<std::size_t>(found - names.begin())];
    const Dimension unit = signal.dimension;
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

void read_elements(Section &root, Model &model) { Elements(root, model).read(); }

}  // namespace forceaxis::sim
