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
                             " again; rename one of them");
  return name;
}

void Elements::read_bodies() {
  root_.each("body", [&](Section &section) {
    Body body;
    body.name = claim_name(section);
    body.mass = section.value("mass", Dimension::mass, Sign::positive);
    body.position = section.value_or("position", Dimension::length, Sign::any, 0.0);
    body.velocity = section.value_or("velocity", Dimension::velocity, Sign::any, 0.0);
    model_.bodies.push_back(std::move(body));
  });
  constexpr std::size_t kMostBodies = 32;
  if (model_.bodies.empty() || model_.bodies.size() > kMostBodies)
    root_.fail("body", "expected 1.." + std::to_string(kMostBodies) + " bodies, got " +
                           std::to_string(model_.bodies.size()) +
                           "; add or remove [[body]] tables");
}

// A slope, or several with the breaks between them: values of the argument or, for springs, of the
// curve (`loads`).
Slopes read_slopes(Section &section, const char *key, Dimension dimension, Dimension over) {
  Slopes curve;
  curve.slopes = section.values(key, dimension, Sign::not_negative);
  const bool loadable = dimension == Dimension::stiffness;
  const bool by_load = loadable && section.has("loads");
  curve.breaks = section.rising("breaks", over);
  if (by_load) {
    if (!curve.breaks.empty())
      section.fail("loads", "expected breaks or loads, got both; remove one of them");
    curve.breaks = section.rising("loads", Dimension::force);
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

  // The deflection at a load: the sum of the shares of all slopes between 0 and it.
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
                              "; a spring without stiffness reaches no load");
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

double read_damping(Section &section) {
  return section.value_or("damping", Dimension::damping, Sign::not_negative, 0.0);
}

// Reads a link that acts where its ends touch: a contact, or either side of a stop.
template <class Link>
Link Elements::touching(Section &section) {
  Link element = link<Link>(section);
  element.stiffness = section.value("stiffness", Dimension::stiffness, Sign::positive);
  element.damping = read_damping(section);
  return element;
}

void Elements::read_links() {
  root_.each("spring", [&](Section &section) {
    auto spring = link<Spring>(section);
    spring.stiffness = read_slopes(section, "stiffness", Dimension::stiffness, Dimension::length);
    spring.damping = read_damping(section);
    model_.springs.push_back(std::move(spring));
  });
  root_.each("damper", [&](Section &section) {
    auto damper = link<Damper>(section);
    damper.damping = read_slopes(section, "damping", Dimension::damping, Dimension::velocity);
    model_.dampers.push_back(std::move(damper));
  });
  root_.each("contact", [&](Section &section) {
    auto contact = touching<Contact>(section);
    contact.gap = section.value_or("gap", Dimension::length, Sign::any, 0.0);
    model_.contacts.push_back(std::move(contact));
  });
  root_.each("backlash", [&](Section &section) {
    auto backlash = touching<Stop>(section);
    const double width = section.value("width", Dimension::length, Sign::not_negative);
    backlash.low = -0.5 * width;
    backlash.high = 0.5 * width;
    model_.stops.push_back(std::move(backlash));
  });
  root_.each("stop", [&](Section &section) {
    auto stop = touching<Stop>(section);
    stop.low = section.optional_value("low", Dimension::length, Sign::any);
    stop.high = section.optional_value("high", Dimension::length, Sign::any);
    if (!stop.low && !stop.high)
      section.fail("low", "expected low or high or both in m, got neither; add one of these keys");
    if (stop.low && stop.high && !(*stop.low < *stop.high))
      section.fail("high", "expected more than low, " + number_text(*stop.low) + ", got " +
                               number_text(*stop.high) + "; exchange or correct them");
    model_.stops.push_back(std::move(stop));
  });
  root_.each("friction", [&](Section &section) {
    auto friction = link<Friction>(section);
    friction.coulomb = section.value("coulomb", Dimension::force, Sign::not_negative);
    friction.stiction =
        section.value_or("stiction", Dimension::force, Sign::not_negative, friction.coulomb);
    if (friction.stiction < friction.coulomb)
      section.fail("stiction", "expected at least coulomb, " + number_text(friction.coulomb) +
                                   ", got " + number_text(friction.stiction) +
                                   "; friction at rest is never less than sliding");
    model_.frictions.push_back(std::move(friction));
  });
}

void Elements::read_gravities() {
  root_.each("gravity", [&](Section &section) {
    Gravity gravity;
    gravity.name = claim_name(section);
    gravity.body = section.body("body", model_.bodies, false, std::nullopt);
    gravity.accelerations = section.values("acceleration", Dimension::acceleration, Sign::any);
    gravity.positions = section.rising("positions", Dimension::length);
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
  const std::string inputs = "one of command, tach";
  const std::string input = section.optional_text("input", inputs).value_or("command");
  if (input != "command" && input != "tach")
    section.fail("input", "expected " + inputs + ", got " + in_quotes(input) +
                              "; choose where the DAC's volts go");
  motor.input_tach = input == "tach";
  motor.k_preamp_cmd = section.value("k_preamp_cmd", Dimension::ratio, Sign::not_zero);
  motor.k_preamp_fdbk = section.value("k_preamp_fdbk", Dimension::ratio, Sign::not_negative);
  motor.a_preamp_fdbk = section.value("a_preamp_fdbk", Dimension::rate, Sign::positive);
  motor.k_tach = section.value("k_tach", Dimension::speed_constant, Sign::not_negative);
  motor.k_torque = section.value("k_torque", Dimension::torque_constant, Sign::positive);
  motor.k_back_emf = section.value("k_back_emf", Dimension::speed_constant, Sign::not_negative);
  motor.inductance = section.value("L", Dimension::inductance, Sign::positive);
  motor.resistance = section.value("R", Dimension::resistance, Sign::not_negative);
  motor.r_trans = section.value("r_trans", Dimension::transmission, Sign::positive);
  motor.b_m = section.value_or("b_m", Dimension::rotary_damping, Sign::not_negative, 0.0);
  motor.k_current = section.value("k_current", Dimension::volt_per_amp, Sign::not_negative);
  motor.current_feedback_limit =
      section.optional_value("current_feedback_limit", Dimension::voltage, Sign::positive);
  motor.preamp_limit = section.optional_value("preamp_limit", Dimension::voltage, Sign::positive);
  motor.k_amp = section.value("k_amp", Dimension::ratio, Sign::positive);
  motor.amp_break = section.optional_value("amp_break", Dimension::voltage, Sign::positive);
  if (motor.amp_break) {
    motor.k_amp_outer = section.value("k_amp_outer", Dimension::ratio, Sign::not_negative);
  } else if (section.has("k_amp_outer")) {
    section.fail("amp_break",
                 "expected a finite number > 0 in V beside k_amp_outer, got nothing; "
                 "add this key or remove k_amp_outer");
  } else {
    motor.k_amp_outer = motor.k_amp;
  }
  motor.supply_limit = section.optional_value("supply_limit", Dimension::voltage, Sign::positive);
  return motor;
}

FirstOrderDrive read_first_order(Section &section) {
  FirstOrderDrive simple;
  simple.k_act = section.value("k_act", Dimension::damping, Sign::positive);
  simple.a_act = section.value("a_act", Dimension::rate, Sign::positive);
  simple.velocity_per_volt =
      section.value("velocity_per_volt", Dimension::velocity_per_volt, Sign::not_zero);
  simple.force_limit = section.optional_value("force_limit", Dimension::force, Sign::positive);
  return simple;
}

PerfectDrive read_perfect(Section &section) {
  PerfectDrive perfect;
  perfect.force_per_volt =
      section.value("force_per_volt", Dimension::force_per_volt, Sign::not_zero);
  perfect.force_limit = section.optional_value("force_limit", Dimension::force, Sign::positive);
  return perfect;
}

void Elements::read_drive() {
  root_.one("drive", [&](Section &section) {
    Drive drive;
    const std::string kinds = "one of dc_motor, first_order, perfect";
    const std::string type = section.text("type", kinds);
    drive.body = section.body("body", model_.bodies, false, std::nullopt);
    drive.reaction = section.body("reaction", model_.bodies, true, kGround);
    if (drive.body == drive.reaction)
      section.fail("reaction",
                   "expected another body than drive.body or ground, got " +
                       in_quotes(model_.bodies[static_cast<std::size_t>(drive.body)].name) +
                       "; choose what the drive pushes against");
    if (type == "dc_motor") {
      drive.type = read_motor(section);
    } else if (type == "first_order") {
      drive.type = read_first_order(section);
    } else if (type == "perfect") {
      drive.type = read_perfect(section);
    } else {
      section.fail("type",
                   "expected " + kinds + ", got " + in_quotes(type) + "; choose a drive type");
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
  const auto place = [&](const char *key) {
    return section.optional_value(key, Dimension::length, Sign::any);
  };
  const auto in_order = [&](const std::optional<double> &low, const std::optional<double> &high,
                            const char *low_key, const char *high_key) {
    if (low && high && *low >= *high)
      section.fail(high_key, std::string("expected a place beyond ") + low_key + " = " +
                                 number_text(*low) + " m, got " + number_text(*high) +
                                 "; exchange or move them");
  };
  Switches &switches = model_.switches;
  switches.limit_neg = place("limit_neg");
  switches.limit_pos = place("limit_pos");
  switches.home_from = place("home_from");
  switches.home_to = place("home_to");
  switches.index = place("index");
  switches.index_every = section.optional_value("index_every", Dimension::length, Sign::positive);
  in_order(switches.limit_neg, switches.limit_pos, "limit_neg", "limit_pos");
  in_order(switches.home_from, switches.home_to, "home_from", "home_to");
  if (switches.index_every && !switches.index)
    section.fail("index_every",
                 "expected the place of one pulse too, got no index; add index, such as 0");
  if (!model_.encoder)
    root_.fail("switches",
               "expected an encoder, whose body passes the switches, got none; add [encoder]");
}

void Elements::read_sensors() {
  root_.one("encoder", [&](Section &section) {
    Encoder encoder;
    encoder.body = section.body("body", model_.bodies, false, std::nullopt);
    encoder.reference = section.body("reference", model_.bodies, true, kGround);
    if (encoder.body == encoder.reference)
      section.fail("reference",
                   "expected another body than encoder.body or ground, got the same; "
                   "choose what the encoder counts against");
    encoder.scale = section.value("scale", Dimension::count_per_length, Sign::not_zero);
    model_.encoder = encoder;
  });
  root_.one("switches", [&](Section &section) { read_switches(section); });
  const std::vector<SignalInfo> signals = model_.signal_list();
  root_.each("adc", [&](Section &section) {
    const auto channel = static_cast<std::size_t>(section.integer("channel", 0, 1, std::nullopt));
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
    adc.filter = section.optional_value("filter", Dimension::rate, Sign::positive);
    constexpr double kFastestFilter = 1e6;
    if (adc.filter && *adc.filter > kFastestFilter)
      section.fail("filter", "expected at most 1e6 rad/s, got " + number_text(*adc.filter) +
                                 "; omit a filter whose effect within a tick is negligible");
    adc.conditioning_limit = section.optional_value("conditioning_limit", unit, Sign::positive);
    adc.noise = section.value_or("noise", unit, Sign::not_negative, 0.0);
    adc.per_count = section.value("per_count", *per_count(unit), Sign::not_zero);
    adc.bits = section.integer("bits", 8, 16, 8);
    const double zero = section.value_or("zero_code", Dimension::count, Sign::any, 0.0);
    const int top = (1 << adc.bits) - 1;
    if (!(zero >= 0.0 && zero <= top && zero == static_cast<int>(zero)))
      section.fail("zero_code", "expected a whole number 0.." + std::to_string(top) + ", got " +
                                    number_text(zero) + "; choose a code of this ADC");
    adc.zero_code = static_cast<int>(zero);
    model_.adc[channel] = adc;
  });
  root_.one("dac", [&](Section &section) {
    model_.dac.bits = section.integer("bits", 8, 16, model_.dac.bits);
    model_.dac.range =
        section.value_or("range", Dimension::voltage, Sign::positive, model_.dac.range);
    model_.dac.offset = section.value_or("offset", Dimension::voltage, Sign::any, 0.0);
    model_.dac.noise = section.value_or("noise", Dimension::voltage, Sign::not_negative, 0.0);
  });
}

}  // namespace

void read_elements(Section &root, Model &model) { Elements(root, model).read(); }

}  // namespace forceaxis::sim
