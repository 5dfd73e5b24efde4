#include "sim/model/model_format.hpp"

#include <algorithm>

namespace forceaxis::sim {
namespace {

using format::integer;
using format::needed;
using format::number;
using format::numbers;
using format::optional;
using format::other;
using format::table;

using D = Dimension;
using S = Sign;

constexpr KeyFormat kName = other("name", "identifier", "", "Name, unique within the model.");
constexpr KeyFormat kBetween = other(
    "between", "two names", "", "The bodies a and b at its ends; one of them may be \"ground\".");
constexpr KeyFormat kTouchStiffness =
    needed("stiffness", D::stiffness, S::positive, "Stiffness where its ends touch.");
constexpr KeyFormat kDamping =
    number("damping", D::damping, S::not_negative, 0.0, "Viscous damping beside the stiffness.");
constexpr KeyFormat kForceLimit = optional("force_limit", D::force, S::positive, "not limited",
                                           "Largest force of the drive, in either direction.");

constexpr KeyFormat kParameterKeys[] = {
    other("value", "number, quantity or product", "",
          "Its value, in `unit` where it has none of its own; or a product or quotient of other "
          "parameters and numbers, \"m / tau\", whose dimension is that of `unit`."),
    other("unit", "unit", "", "One of the units of this page."),
    other("source", "text", "none", "Where the value comes from."),
    other("documentation", "true or false", "false",
          "Whether it is kept to be read: nothing needs to refer to it."),
};
constexpr TableFormat kParameter{"A parameter: a value that keys may name.", kParameterKeys};

constexpr TableFormat kParameters{
    "Parameters by name; those of this file take precedence over parameters_file and must be used "
    "by the model.",
    {},
    true,
    {},
    {}};

constexpr KeyFormat kBodyKeys[] = {
    kName,
    needed("mass", D::mass, S::positive, "Mass."),
    number("position", D::length, S::any, 0.0, "Position at the start."),
    number("velocity", D::velocity, S::any, 0.0, "Velocity at the start."),
};
constexpr TableFormat kBody{
    "A rigid body that moves along the axis; 1 to 32 of them, each tied to ground through other "
    "elements or the drive.",
    kBodyKeys};

constexpr KeyFormat kSpringKeys[] = {
    kName,
    kBetween,
    numbers("stiffness", D::stiffness, S::not_negative, "",
            "Stiffness; a list makes the spring piecewise linear, slope k between breaks[k-1] and "
            "breaks[k]."),
    numbers("loads", D::force, S::any, "none",
            "Rising forces at which the stiffness changes, one fewer than stiffnesses, which are "
            "then > 0; in place of `breaks`."),
    numbers("breaks", D::length, S::any, "none",
            "Rising deflections at which the stiffness changes, one fewer than stiffnesses."),
    kDamping,
};
constexpr TableFormat kSpring{
    "A spring with damping: the force stiffness * d + damping * d' pushes a back and b forward, "
    "d = x_a - x_b.",
    kSpringKeys};

constexpr KeyFormat kDamperKeys[] = {
    kName,
    kBetween,
    numbers("damping", D::damping, S::not_negative, "",
            "Damping; a list makes the damper piecewise linear over the velocity."),
    numbers("breaks", D::velocity, S::any, "none",
            "Rising velocities at which the damping changes, one fewer than dampings."),
};
constexpr TableFormat kDamper{"A damper alone.", kDamperKeys};

constexpr KeyFormat kContactKeys[] = {
    kName,
    kBetween,
    kTouchStiffness,
    kDamping,
    number("gap", D::length, S::any, 0.0, "Distance at x_a = x_b; it is overlap where negative."),
};
constexpr TableFormat kContact{
    "A contact that can be lost: stiffness * d + damping * d' while the overlap d = x_a - x_b - "
    "gap and that sum are > 0, else no force.",
    kContactKeys};

constexpr KeyFormat kBacklashKeys[] = {
    kName,
    kBetween,
    kTouchStiffness,
    kDamping,
    needed("width", D::length, S::not_negative, "Free play: it touches at -width/2 and +width/2."),
};
constexpr TableFormat kBacklash{"Free play between two bodies.", kBacklashKeys};

constexpr KeyFormat kStopKeys[] = {
    kName,
    kBetween,
    kTouchStiffness,
    kDamping,
    optional("low", D::length, S::any, "no stop on this side", "It touches below this x_a - x_b."),
    optional("high", D::length, S::any, "no stop on this side",
             "It touches beyond this x_a - x_b, which is more than `low`."),
};
constexpr TableFormat kStop{
    "End stops: free while low < x_a - x_b < high; at least one side is given.", kStopKeys};

constexpr KeyFormat kFrictionKeys[] = {
    kName,
    kBetween,
    needed("coulomb", D::force, S::not_negative, "Friction while it slides."),
    optional("stiction", D::force, S::not_negative, "coulomb",
             "Force at which sliding begins, at least `coulomb`."),
};
constexpr TableFormat kFriction{
    "Dry friction: it opposes sliding, and sticks at rest while no more than `stiction` is needed. "
    "Frictions must not form a loop.",
    kFrictionKeys};

constexpr KeyFormat kBrakeKeys[] = {
    kName,
    kBetween,
    needed("holding", D::force, S::positive, "Force that it holds, and with which it slides."),
    number("release", D::time, S::not_negative, 0.0,
           "From the firmware's output brake_release to where it lets go."),
    number("engage", D::time, S::not_negative, 0.0,
           "From the end of that output to where it holds again."),
};
constexpr TableFormat kBrake{
    "A brake that the firmware's output brake_release opens; engaged at the start. While it is "
    "engaged it is dry friction, while it is released it is not there. A friction between the same "
    "ends adds to it.",
    kBrakeKeys};

constexpr KeyFormat kGravityKeys[] = {
    kName,
    other("body", "body", "", "The body that it pulls."),
    numbers("acceleration", D::acceleration, S::any, "",
            "Acceleration, toward the workpiece where positive; a list gives one for each of "
            "`positions`."),
    numbers("positions", D::length, S::any, "none",
            "Rising positions of the body; between them the acceleration is interpolated, beyond "
            "them constant."),
};
constexpr TableFormat kGravity{"A force on one body: its mass times an acceleration.",
                               kGravityKeys};

constexpr KeyFormat kDcMotorKeys[] = {
    other("input", "command, tach", "command",
          "Where the DAC's volts act: as velocity command u, or added to the tachometer's voltage "
          "t."),
    needed("k_preamp_cmd", D::ratio, S::not_zero, "Gain of the preamplifier for the command."),
    needed("k_preamp_fdbk", D::ratio, S::not_negative,
           "Gain of the preamplifier for the tachometer."),
    needed("a_preamp_fdbk", D::rate, S::positive, "Corner of the tachometer's filter."),
    needed("k_tach", D::speed_constant, S::not_negative, "Constant of the tachometer."),
    needed("k_torque", D::torque_constant, S::positive, "Torque constant."),
    needed("k_back_emf", D::speed_constant, S::not_negative, "Constant of the back EMF."),
    needed("L", D::inductance, S::positive, "Inductance of the winding."),
    needed("R", D::resistance, S::not_negative, "Resistance of the winding."),
    needed("r_trans", D::transmission, S::positive, "Travel for each radian of the motor."),
    number("b_m", D::rotary_damping, S::not_negative, 0.0, "Viscous friction of the motor."),
    needed("k_current", D::volt_per_amp, S::not_negative, "Gain of the current's measurement."),
    optional("current_feedback_limit", D::voltage, S::positive, "not limited",
             "Where the current's measurement saturates."),
    optional("preamp_limit", D::voltage, S::positive, "not limited",
             "Where the current command saturates."),
    needed("k_amp", D::ratio, S::positive, "Gain of the power stage for the current's error."),
    optional("amp_break", D::voltage, S::positive, "one slope",
             "Error beyond which the power stage has the gain k_amp_outer."),
    optional("k_amp_outer", D::ratio, S::not_negative, "k_amp",
             "Gain beyond amp_break; required beside it."),
    optional("supply_limit", D::voltage, S::positive, "not limited",
             "Largest voltage at the motor."),
};

constexpr KeyFormat kFirstOrderKeys[] = {
    needed("k_act", D::damping, S::positive, "Force for each unit of velocity error."),
    needed("a_act", D::rate, S::positive, "Corner of the force's lag."),
    needed("velocity_per_volt", D::velocity_per_volt, S::not_zero,
           "Commanded velocity for each volt of the DAC."),
    kForceLimit,
};

constexpr KeyFormat kPerfectKeys[] = {
    needed("force_per_volt", D::force_per_volt, S::not_zero, "Force for each volt of the DAC."),
    kForceLimit,
};

constexpr KeyFormat kDriveKeys[] = {
    other("type", "dc_motor, first_order, perfect", "", "Kind of drive; it adds the keys below."),
    other("body", "body", "", "The body that the drive pushes."),
    other("reaction", "body or ground", "ground", "The body that the drive pushes against."),
};

constexpr KeyFormat kEncoderKeys[] = {
    other("body", "body", "", "The body whose position is counted."),
    other("reference", "body or ground", "ground", "The body that it is counted against."),
    needed("scale", D::count_per_length, S::not_zero, "Encoder counts for each metre."),
};
constexpr TableFormat kEncoder{"The position that the firmware reads.", kEncoderKeys};

constexpr KeyFormat kSwitchesKeys[] = {
    optional("limit_neg", D::length, S::any, "no switch", "Limit switch: on at and below it."),
    optional("limit_pos", D::length, S::any, "no switch",
             "Limit switch: on at and beyond it, beyond limit_neg."),
    optional("home_from", D::length, S::any, "from the negative end",
             "Home switch: on at and beyond it."),
    optional("home_to", D::length, S::any, "to the positive end",
             "Home switch: on below it, beyond home_from."),
    optional("index", D::length, S::any, "no pulse", "A pulse where the body passes it."),
    optional("index_every", D::length, S::positive, "one pulse",
             "A pulse at every such distance from `index`, which is required beside it."),
};
constexpr TableFormat kSwitches{
    "Places of switches on the way of the encoder's body; each key gives one switch.",
    kSwitchesKeys};

constexpr KeyFormat kAdcKeys[] = {
    integer("channel", 0, 1, std::nullopt, "0 is the force that the firmware controls."),
    other("signal", "signal", "",
          "The signal of the model that it converts; see the signals below."),
    other("sensor_limit", "number", "not limited",
          "Where the sensor saturates, > 0, in the signal's unit."),
    optional("filter", D::rate, S::positive, "no filter",
             "Corner of a first-order low pass behind the sensor, at most 1e6 rad/s."),
    other("conditioning_limit", "number", "not limited",
          "Where the analog electronics saturate, > 0, in the signal's unit."),
    other("noise", "number", "0", "Noise, rms, in the signal's unit."),
    other("per_count", "number", "",
          "The signal for each ADC code, not 0; its unit is that of the signal per count."),
    number("zero_code", D::count, S::any, 0.0,
           "Code of the signal 0: a whole number, 0 to 2^bits - 1."),
    integer("bits", 8, 16, 8.0, "Width of the converter."),
};
constexpr TableFormat kAdc{
    "A converter of the firmware: signal, sensor's limit, low pass, limit of the electronics, "
    "noise, code.",
    kAdcKeys};

constexpr KeyFormat kDacKeys[] = {
    integer("bits", 8, 16, 12.0, "Width of the converter; the firmware needs 12."),
    number("range", D::voltage, S::positive, 10.0, "Volts at the lowest code, negated."),
    number("offset", D::voltage, S::any, 0.0, "Volts at code 0."),
    number("noise", D::voltage, S::not_negative, 0.0, "Noise, rms."),
};
constexpr TableFormat kDac{
    "The command's converter: code * 2 range / 2^bits + offset + noise, in V.", kDacKeys};

constexpr const TableFormat *kDriveTypes[] = {&kDcMotorFormat, &kFirstOrderFormat, &kPerfectFormat};
constexpr TableFormat kDrive{"The motor with its amplifier, driven by the DAC's volts u.",
                             kDriveKeys,
                             false,
                             {},
                             kDriveTypes};

constexpr KeyFormat kTitle = other("title", "text", "empty", "What the file is.");
constexpr KeyFormat kShows = other("shows", "text", "empty", "What to look at.");

constexpr KeyFormat kModelKeys[] = {
    kTitle,
    kShows,
    other("parameters_file", "file name", "none",
          "A file beside this one that holds [parameters] for several models."),
    table("parameters", kParameters),
    table("body", kBody, true),
    table("spring", kSpring, true),
    table("damper", kDamper, true),
    table("contact", kContact, true),
    table("backlash", kBacklash, true),
    table("stop", kStop, true),
    table("friction", kFriction, true),
    table("brake", kBrake, true),
    table("gravity", kGravity, true),
    table("drive", kDrive),
    table("encoder", kEncoder),
    table("switches", kSwitches),
    table("adc", kAdc, true),
    table("dac", kDac),
};

constexpr KeyFormat kSharedKeys[] = {kTitle, kShows, table("parameters", kParameters)};

}  // namespace

constexpr TableFormat kDcMotorFormat{
    "A current-fed DC motor behind a preamplifier with tachometer feedback: see DcMotor in "
    "sim/model/model.hpp for its equations.",
    kDcMotorKeys,
    false,
    "type = \"dc_motor\"",
    {}};
constexpr TableFormat kFirstOrderFormat{
    "A velocity-controlled actuator: F' = a_act (k_act (velocity_per_volt u - v) - F).",
    kFirstOrderKeys,
    false,
    "type = \"first_order\"",
    {}};
constexpr TableFormat kPerfectFormat{
    "A force source: F = force_per_volt u.", kPerfectKeys, false, "type = \"perfect\"", {}};
constexpr TableFormat kParameterFormat = kParameter;
constexpr TableFormat kSharedParametersFormat{"Parameters of several models.", kSharedKeys};
constexpr TableFormat kModelFormat{"A plant.", kModelKeys};

std::string_view sign_text(Sign sign) {
  switch (sign) {
    case Sign::not_zero:
      return "a finite number other than 0";
    case Sign::not_negative:
      return "a finite number >= 0";
    case Sign::positive:
      return "a finite number > 0";
    default:
      return "a finite number";
  }
}

const KeyFormat *TableFormat::find(std::string_view key) const {
  const auto found = std::find_if(keys.begin(), keys.end(),
                                  [key](const KeyFormat &format) { return format.key == key; });
  return found == keys.end() ? nullptr : &*found;
}

}  // namespace forceaxis::sim
