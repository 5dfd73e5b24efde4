#include "sim/model/model_format.hpp"

#include <algorithm>

namespace forceaxis::sim {
namespace {

using format::integer;
using format::needed;
using format::number;
using format::numbers;
using format::optional;
using format::optional_integer;
using format::other;
using format::ranged;
using format::table;

using D = Dimension;
using S = Sign;

constexpr KeyFormat kName =
    other("name", "identifier", "", "Name; no other element of the model may have it.");
constexpr KeyFormat kBetween = other(
    "between", "two names", "", "The bodies a and b at its ends. One of them may be \"ground\".");
constexpr KeyFormat kMaxwellStiffness =
    optional("maxwell_stiffness", D::stiffness, S::positive, "none",
             "Stiffness of a further spring in series with a dashpot, beside the stiffness: the "
             "force of a held deflection relaxes by the share of this spring (standard linear "
             "solid).");
constexpr KeyFormat kMaxwellTime =
    optional("maxwell_time", D::time, S::positive, "maxwell_stiffness must be omitted too",
             "Time in which that force relaxes to 1/e: the damping of the dashpot divided by "
             "maxwell_stiffness.");
constexpr KeyFormat kTouchStiffness =
    needed("stiffness", D::stiffness, S::positive, "Stiffness of the contact.");
constexpr KeyFormat kDamping = number("damping", D::damping, S::not_negative, 0.0,
                                      "Viscous damping, parallel to the stiffness.");
constexpr KeyFormat kForceLimit = optional("force_limit", D::force, S::positive, "not limited",
                                           "Largest force of the drive in either direction.");

constexpr KeyFormat kParameterKeys[] = {
    other("value", "number, quantity or product", "",
          "Value of the parameter: a number in `unit`; a quantity such as \"12 mm\"; or a "
          "product or quotient of other parameters and numbers, such as \"m / tau\", with the "
          "dimension of `unit`."),
    other("unit", "unit", "", "Unit of the parameter, one of the units of this page."),
    other("source", "text", "none", "Source of the value."),
    other("documentation", "true or false", "false",
          "true: the parameter is for information only, and the model need not use it."),
};
constexpr TableFormat kParameter{"A parameter: a named value to which keys may refer.",
                                 kParameterKeys};

constexpr TableFormat kParameters{
    "Parameters by name. A parameter of this file takes precedence over one of "
    "parameters_file, and the model must use it.",
    {},
    true,
    {},
    {}};

constexpr KeyFormat kBodyKeys[] = {
    kName,
    optional("mass", D::mass, S::positive, "inertia must be given", "Mass."),
    numbers("inertia", D::inertia, S::positive, "none",
            "Inertia of what turns with the body, such as a rotor: it adds inertia / r_trans^2 to "
            "the mass. A list has one value for each of `r_trans`."),
    numbers("r_trans", D::transmission, S::positive, "inertia must be omitted too",
            "Travel of the body for one radian of the inertia: a screw lead such as \"10 mm/rev\", "
            "the radius of a pulley, or this divided by the ratio of a gear."),
    number("position", D::length, S::any, 0.0, "Position at the start."),
    number("velocity", D::velocity, S::any, 0.0, "Velocity at the start."),
};
constexpr TableFormat kBody{
    "A rigid body that moves along the axis. A model has 1 to 32 bodies; other elements "
    "or the drive must connect each of them to ground.",
    kBodyKeys};

constexpr KeyFormat kStructureModeKeys[] = {
    needed("frequency", D::frequency, S::not_negative,
           "Undamped natural frequency, without anything at the ports; 0 for a rigid-body mode."),
    number("damping_ratio", D::ratio, S::not_negative, 0.0,
           "Damping ratio; 0 for a rigid-body mode."),
    number("modal_mass", D::mass, S::positive, 1.0,
           "Modal mass in the scale of the shape. Omit it for a mass-normalised shape, whose unit "
           "is 1/sqrt(kg)."),
    numbers("shape", D::ratio, S::any, "",
            "Displacement of each port in the mode, in the order of `ports`."),
};
constexpr TableFormat kStructureMode{
    "A mode of vibration of the structure. The compliance of modes that are left out can be given "
    "as one more mode for each port: a residual flexibility R in m/N becomes a mode with a "
    "frequency f far above the others, the shape 2 pi f sqrt(R) at this port and 0 at the others, "
    "and the modal mass 1 kg.",
    kStructureModeKeys};

constexpr KeyFormat kStructureKeys[] = {
    kName,
    other("ports", "list of names", "",
          "Names of the points at which elements act and signals are read. A port may be named "
          "wherever a body may be named, except under [[gravity]], because its mass is not known. "
          "No other element may have the name."),
    table("mode", kStructureMode, true),
};
constexpr TableFormat kStructure{
    "A flexible structure, given by the modes of vibration that a modal analysis has measured at "
    "its ports. The position of a port is the sum of shape * modal coordinate over the modes, and "
    "a "
    "force at a port acts on each mode by its shape. All structures together have at most 32 "
    "modes. "
    "A structure with a rigid-body mode must be connected to ground; one without is held by what "
    "held it in the measurement. It starts at rest.",
    kStructureKeys};

constexpr KeyFormat kSpringKeys[] = {
    kName,
    kBetween,
    numbers("stiffness", D::stiffness, S::not_negative, "",
            "Stiffness. A list makes the spring piecewise linear, with stiffness k between "
            "breaks[k-1] and breaks[k]."),
    numbers("loads", D::force, S::any, "none",
            "Forces at which the stiffness changes, in ascending order, in place of `breaks`. "
            "The list has one value fewer than the list of stiffnesses, which must then be > 0."),
    numbers("breaks", D::length, S::any, "none",
            "Deflections at which the stiffness changes, in ascending order, one value fewer "
            "than stiffnesses."),
    kDamping,
    kMaxwellStiffness,
    kMaxwellTime,
};
constexpr TableFormat kSpring{
    "A spring with damping. For d = x_a - x_b, the force stiffness * d + damping * d' "
    "acts backwards on a and forwards on b.",
    kSpringKeys};

constexpr KeyFormat kDamperKeys[] = {
    kName,
    kBetween,
    numbers("damping", D::damping, S::not_negative, "",
            "Damping. A list makes the damper a piecewise-linear function of the velocity."),
    numbers("breaks", D::velocity, S::any, "none",
            "Velocities at which the damping changes, in ascending order, one value fewer than "
            "dampings."),
};
constexpr TableFormat kDamper{"A damper without stiffness.", kDamperKeys};

constexpr KeyFormat kContactKeys[] = {
    kName,
    kBetween,
    numbers(
        "stiffness", D::stiffness, S::positive, "",
        "Stiffness of the contact. A list makes it a curve of force over overlap, with "
        "stiffness k between breaks[k-1] and breaks[k]. With segments of the width h that meet a "
        "Hertz contact F = c d^1.5 at their ends, the force is at most 0.148 c h^1.5 more."),
    numbers("loads", D::force, S::positive, "none",
            "Forces at which the stiffness changes, in ascending order, in place of `breaks`."),
    numbers("breaks", D::length, S::positive, "none",
            "Overlaps at which the stiffness changes, in ascending order, one value fewer than "
            "stiffnesses."),
    kDamping,
    kMaxwellStiffness,
    kMaxwellTime,
    optional("hysteresis_stiffness", D::stiffness, S::positive, "none",
             "Stiffness of a further spring in series with a dry slider, beside the stiffness. A "
             "closed cycle of the overlap with the amplitude D loses 4 hysteresis_force * (D - "
             "hysteresis_force / hysteresis_stiffness) if D is larger than this quotient."),
    optional("hysteresis_force", D::force, S::positive, "hysteresis_stiffness must be omitted too",
             "Force of that spring at which the slider slips."),
    number("gap", D::length, S::any, 0.0,
           "Distance of the two surfaces at x_a = x_b. A negative value is an overlap."),
};
constexpr TableFormat kContact{
    "A contact that can be lost. Its overlap is d = x_a - x_b - gap and its force is "
    "stiffness * d + damping * d' while both are > 0; otherwise the force is 0. The surface of a "
    "contact with maxwell_stiffness recovers after a loss, and is met where it then is. The "
    "surface "
    "of a contact with hysteresis_stiffness keeps the dent of its last loss, where its force was "
    "0, "
    "and is met there. A contact with one of these keys has one stiffness and no damping. Linear "
    "figures of a contact with hysteresis are those of small motions about a point at which the "
    "slider sticks, with the stiffness stiffness + hysteresis_stiffness and without its losses.",
    kContactKeys};

constexpr KeyFormat kBacklashKeys[] = {
    kName,
    kBetween,
    kTouchStiffness,
    kDamping,
    needed("width", D::length, S::not_negative,
           "Free travel. The ends are in contact below -width/2 and above +width/2."),
};
constexpr TableFormat kBacklash{"A backlash between two bodies.", kBacklashKeys};

constexpr KeyFormat kStopKeys[] = {
    kName,
    kBetween,
    kTouchStiffness,
    kDamping,
    optional("low", D::length, S::any, "no stop at this end",
             "Value of x_a - x_b below which the stop is in contact."),
    optional("high", D::length, S::any, "no stop at this end",
             "Value of x_a - x_b above which the stop is in contact; greater than `low`."),
};
constexpr TableFormat kStop{
    "End stops. They have no force while low < x_a - x_b < high. At least one of `low` "
    "and `high` must be given.",
    kStopKeys};

constexpr KeyFormat kFrictionKeys[] = {
    kName,
    kBetween,
    needed("coulomb", D::force, S::not_negative, "Friction force while the ends slide."),
    optional("stiction", D::force, S::not_negative, "coulomb",
             "Breakaway force, at which sliding begins; at least `coulomb`."),
};
constexpr TableFormat kFriction{
    "Dry friction. It opposes sliding. At standstill it sticks while the force that this "
    "needs is at most `stiction`. Frictions must not form a loop.",
    kFrictionKeys};

constexpr KeyFormat kBrakeKeys[] = {
    kName,
    kBetween,
    needed("holding", D::force, S::positive,
           "Friction force of the engaged brake while it sticks and while it slides."),
    number("release", D::time, S::not_negative, 0.0,
           "Delay from the firmware's output brake_release to the release of the brake."),
    number("engage", D::time, S::not_negative, 0.0,
           "Delay from the end of the output brake_release to the engaged brake."),
};
constexpr TableFormat kBrake{
    "A brake that the firmware's output brake_release releases. It is engaged at the "
    "start. An engaged brake acts as dry friction, a released brake has no force. A "
    "friction between the same ends acts in addition.",
    kBrakeKeys};

constexpr KeyFormat kGravityKeys[] = {
    kName,
    other("body", "body", "", "The body on which the force acts."),
    numbers("acceleration", D::acceleration, S::any, "",
            "Acceleration, positive towards the workpiece. A list has one value for each of "
            "`positions`."),
    numbers("positions", D::length, S::any, "none",
            "Positions of the body in ascending order. The acceleration is interpolated between "
            "them and constant outside their range."),
};
constexpr TableFormat kGravity{"A force on one body: its mass times an acceleration.",
                               kGravityKeys};

constexpr KeyFormat kCoggingKeys[] = {
    kName,
    kBetween,
    numbers("force", D::force, S::any, "",
            "Amplitude of a sine over the position, whose rest is at `position`. A list of at "
            "least two values has the forces at equal distances over one period."),
    needed("period", D::length, S::positive, "Distance after which the force repeats."),
    integer("segments", 4, 64, 16.0,
            "Straight segments in a period of a sine, which they meet at their ends. Between them "
            "they are less than the sine, at most by 1 - cos(pi / segments) of the amplitude: 7.6 "
            "% with 8, 1.9 % with 16, 0.5 % with 32."),
    number("position", D::length, S::any, 0.0, "Value of x_a - x_b at which a period begins."),
    needed("from", D::length, S::any,
           "Value of x_a - x_b at which the travel begins. The force is constant before the last "
           "value outside the travel."),
    needed(
        "to", D::length, S::any,
        "Value of x_a - x_b at which the travel ends; greater than `from`. The travel has at most "
        "1000 segments."),
};
constexpr TableFormat kCogging{
    "A force that repeats over the position, such as the cogging of a linear motor or a screw. It "
    "is linear between its values, acts backwards on a and forwards on b, and stores energy.",
    kCoggingKeys};

constexpr KeyFormat kExternalKeys[] = {
    kName,
    other("body", "body", "", "The body on which the force acts."),
    numbers("times", D::time, S::not_negative, "",
            "Times since the start in ascending order, at least two."),
    numbers("forces", D::force, S::any, "",
            "Force at each of these times, positive towards the workpiece. It is linear between "
            "them and 0 before the first and after the last."),
};
constexpr TableFormat kExternal{"An external force on one body, a table over the time.",
                                kExternalKeys};

constexpr KeyFormat kDcMotorKeys[] = {
    other("input", "command, tach", "command",
          "Use of the DAC voltage: as velocity command u, or added to the tachometer voltage "
          "as t."),
    needed("k_preamp_cmd", D::ratio, S::not_zero, "Gain of the preamplifier for the command."),
    needed("k_preamp_fdbk", D::ratio, S::not_negative,
           "Gain of the preamplifier for the tachometer."),
    needed("a_preamp_fdbk", D::rate, S::positive, "Corner frequency of the tachometer filter."),
    needed("k_tach", D::speed_constant, S::not_negative,
           "Tachometer voltage at a motor speed of 1 rad/s."),
    needed("k_torque", D::torque_constant, S::positive, "Torque constant."),
    needed("k_back_emf", D::speed_constant, S::not_negative, "Constant of the back EMF."),
    needed("L", D::inductance, S::positive, "Inductance of the winding."),
    needed("R", D::resistance, S::not_negative, "Resistance of the winding."),
    needed("r_trans", D::transmission, S::positive,
           "Travel of the body for one radian of the motor."),
    number("b_m", D::rotary_damping, S::not_negative, 0.0, "Viscous friction of the motor."),
    needed("k_current", D::volt_per_amp, S::not_negative, "Gain of the current measurement."),
    optional("current_feedback_limit", D::voltage, S::positive, "not limited",
             "Voltage at which the current measurement saturates."),
    optional("preamp_limit", D::voltage, S::positive, "not limited",
             "Voltage at which the current command saturates."),
    needed("k_amp", D::ratio, S::positive, "Gain of the power stage for the current error."),
    optional("amp_break", D::voltage, S::positive, "one slope",
             "Current error, as a voltage, above which the power stage has the gain k_amp_outer."),
    optional("k_amp_outer", D::ratio, S::not_negative, "k_amp",
             "Gain of the power stage above amp_break; required if amp_break is given."),
    optional("supply_limit", D::voltage, S::positive, "not limited",
             "Largest voltage at the motor."),
};

constexpr KeyFormat kFirstOrderKeys[] = {
    needed("k_act", D::damping, S::positive, "Steady-state force divided by the velocity error."),
    needed("a_act", D::rate, S::positive, "Corner frequency of the first-order lag of the force."),
    needed("velocity_per_volt", D::velocity_per_volt, S::not_zero,
           "Commanded velocity at a DAC voltage of 1 V."),
    kForceLimit,
};

constexpr KeyFormat kPerfectKeys[] = {
    needed("force_per_volt", D::force_per_volt, S::not_zero, "Force at a DAC voltage of 1 V."),
    kForceLimit,
};

// The keys of a motor with a current loop, which the types torque and velocity share.
constexpr KeyFormat kForcePerAmp =
    optional("k_force", D::force_per_current, S::positive, "k_torque / r_trans",
             "Force constant of a linear motor, in place of k_torque and r_trans.");
constexpr KeyFormat kTorquePerAmp =
    optional("k_torque", D::torque_constant, S::positive, "k_force must be given",
             "Torque constant of a rotary motor.");
constexpr KeyFormat kScrew =
    optional("r_trans", D::transmission, S::positive, "k_force must be given",
             "Travel of the body for one radian of the motor: the lead of a screw such as \"10 "
             "mm/rev\", or the radius of a pulley divided by the ratio of its gear.");
constexpr KeyFormat kCurrentBandwidth = needed(
    "current_bandwidth", D::rate, S::positive,
    "Frequency at which the current loop, a first-order lag, follows its target with -3 dB.");
constexpr KeyFormat kPeakCurrent = optional("peak_current", D::current, S::positive, "not limited",
                                            "Largest target of the current.");
constexpr KeyFormat kRatedCurrent =
    optional("rated_current", D::current, S::positive, "peak_current at all times",
             "Largest target of the current after the drive has given peak_current for peak_time; "
             "less than peak_current. DriveMotor in sim/model/model.hpp has the "
             "equations.");
constexpr KeyFormat kPeakTime =
    optional("peak_time", D::time, S::positive, "rated_current must be omitted too",
             "Time for which the drive gives peak_current after a long rest.");

constexpr KeyFormat kTorqueKeys[] = {
    needed("current_per_volt", D::current_per_volt, S::not_zero,
           "Target of the current at a DAC voltage of 1 V."),
    kForcePerAmp,
    kTorquePerAmp,
    kScrew,
    kCurrentBandwidth,
    kPeakCurrent,
    kRatedCurrent,
    kPeakTime,
    number("damping", D::damping, S::not_negative, 0.0,
           "Velocity damping in the drive: its target is lowered by the current whose force is "
           "damping * v."),
};

constexpr KeyFormat kVelocityKeys[] = {
    needed("velocity_per_volt", D::velocity_per_volt, S::not_zero,
           "Target of the velocity at a DAC voltage of 1 V."),
    kForcePerAmp,
    kTorquePerAmp,
    kScrew,
    kCurrentBandwidth,
    kPeakCurrent,
    kRatedCurrent,
    kPeakTime,
    optional("k_velocity", D::damping, S::positive, "computed from bandwidth",
             "Proportional gain of the velocity loop: the force for a velocity error."),
    optional("integral_time", D::time, S::positive, "no integral",
             "Integral time of the velocity loop: its integral grows in this time by the "
             "proportional part."),
    optional("bandwidth", D::rate, S::positive, "k_velocity must be given",
             "Frequency at which the closed velocity loop follows its target with -3 dB, in place "
             "of k_velocity and integral_time."),
    ranged("damping_ratio", D::ratio, 0.3, 2.0, "0.7071",
           "Damping ratio of the two slow poles of the closed velocity loop, beside bandwidth."),
    optional("tuned_mass", D::mass, S::positive, "tuned_inertia must be given",
             "Moving mass for which the velocity loop was tuned, beside bandwidth."),
    optional("tuned_inertia", D::inertia, S::positive, "tuned_mass must be given",
             "Inertia at the motor for which the velocity loop was tuned, in place of tuned_mass."),
};

constexpr KeyFormat kStepperKeys[] = {
    needed("velocity_per_volt", D::velocity_per_volt, S::not_zero,
           "Velocity of the field at a DAC voltage of 1 V, as travel of the body."),
    needed("holding_force", D::force, S::positive,
           "Largest force on the body: the holding torque of the motor at the current of its "
           "driver, divided by the travel for one radian."),
    needed("full_step", D::length, S::positive,
           "Travel of the body for a full step: the lead of a screw divided by 200 for a motor of "
           "1.8 degrees. The force repeats after 4 full steps."),
    number("damping", D::damping, S::not_negative, 0.0,
           "Force for a difference between the velocities of the field and of the body."),
    integer("segments", 4, 32, 16.0,
            "Straight segments in a period of the sine of the load angle, a multiple of 4. They "
            "meet the sine at their ends; between them they are less, at most by 1 - cos(pi / "
            "segments) of holding_force: 7.6 % with 8, 1.9 % with 16, 0.5 % with 32."),
};

constexpr KeyFormat kDriveKeys[] = {
    other("type", "dc_motor, first_order, perfect, torque, velocity, stepper", "",
          "Type of the drive. It adds the keys below."),
    other("body", "body", "", "The body on which the drive exerts its force."),
    other("reaction", "body or ground", "ground", "The body on which the reaction force acts."),
    integer("cycle_ticks", 1, 300, 1.0,
            "Cycle of the bus between firmware and drive in ticks of 1/1500 s: 1, or a multiple of "
            "3, which is 2 ms. In the first tick of a cycle the firmware's output leaves for the "
            "drive, which holds it for a cycle, and the encoder is measured."),
    integer("delay_ticks_out", 0, 30, 0.0,
            "Ticks from the output of the firmware to the drive. The drive is disabled until the "
            "first output arrives."),
    integer("delay_ticks_in", 0, 30, 0.0,
            "Ticks from the measurement of the encoder to the firmware."),
    optional_integer("enable_ticks", 0, 65535, "the drive reports nothing",
                     "Ticks from `amp_enable` until the drive follows the code; until then it is "
                     "disabled. The drive reports to the firmware that it is fitted and whether it "
                     "is on, with the encoder count. Without this key the firmware sees an "
                     "amplifier for +-10 V."),
};

constexpr KeyFormat kMachineTableKeys[] = {
    numbers("times", D::time, S::not_negative, "", "Times since tick 0, ascending, at least two."),
    numbers("speeds", D::velocity, S::any, "forces must be given",
            "Velocity that the controller commands at each time, for a drive that follows a "
            "velocity."),
    numbers("forces", D::force, S::any, "speeds must be given",
            "Force that the controller commands at each time, for a drive that follows a force."),
    other("interpolated", "flag", "false",
          "Whether the command of a tick lies on the line between two times; otherwise a value is "
          "held until the next time."),
};
constexpr TableFormat kMachineTable{
    "Commands that are given as a table over the time, such as those of a recording.",
    kMachineTableKeys,
    false,
    "law = \"table\"",
    {}};

// The keys of a controller that measures a force.
constexpr KeyFormat kMachineSignal =
    other("signal", "signal", "", "Force signal of the model that the controller measures.");
constexpr KeyFormat kMachineSetpoint =
    needed("setpoint", D::force, S::any, "Set-point of the force.");
constexpr KeyFormat kMachineSpeed =
    needed("speed_max", D::velocity, S::positive,
           "Largest velocity that the controller commands; without contact it approaches with it.");
constexpr KeyFormat kMachineFilter =
    optional("filter", D::rate, S::positive, "no filter",
             "Corner frequency of a first-order low pass of the measured force.");
constexpr KeyFormat kMachineDelay =
    integer("delay_ticks", 0, 30, 0.0, "Ticks by which the measured force is late.");

constexpr KeyFormat kAdmittanceKeys[] = {
    kMachineSignal,
    kMachineSetpoint,
    kMachineSpeed,
    needed("mass", D::mass, S::positive, "Virtual mass of the admittance."),
    number("damping", D::damping, S::not_negative, 0.0, "Virtual damping of the admittance."),
    kMachineFilter,
    kMachineDelay,
};
constexpr TableFormat kAdmittance{
    "An admittance: the velocity v of a virtual mass, mass v' = f - damping v, where f is the "
    "set-point less the measured force. At speed_max it stops to accelerate.",
    kAdmittanceKeys,
    false,
    "law = \"admittance\"",
    {}};

constexpr KeyFormat kForcePiKeys[] = {
    kMachineSignal,
    kMachineSetpoint,
    kMachineSpeed,
    needed("damping", D::damping, S::positive,
           "Force error for which the proportional part commands 1 m/s."),
    optional("integral_time", D::time, S::positive, "no integral",
             "Time in which the integral grows by the proportional part. At speed_max the "
             "integral is held."),
    kMachineFilter,
    kMachineDelay,
};
constexpr TableFormat kForcePi{
    "A PI controller of the force whose output is a velocity: v = f / damping + q, q' = f / "
    "(damping integral_time), where f is the set-point less the measured force.",
    kForcePiKeys,
    false,
    "law = \"force_pi\"",
    {}};

constexpr KeyFormat kMachineKeys[] = {
    other("law", "table, admittance, force_pi", "",
          "Law of the controller. It adds the keys below."),
    integer("cycle_ticks", 1, 300, 1.0,
            "Cycle of the controller in ticks of 1/1500 s: it gives a new command in the first "
            "tick of a cycle."),
};
constexpr const TableFormat *kMachineLaws[] = {&kMachineTable, &kAdmittance, &kForcePi};
constexpr TableFormat kMachineController{
    "A controller that belongs to the machine, such as that of a robot or a press: a model of "
    "somebody else's controller, of which no more than this law is known. It commands the drive in "
    "place of the firmware, whose DAC code has no effect; an experiment on the model selects no "
    "mode of operation. Linear analysis leaves it out. MachineController in sim/model/model.hpp "
    "has the equations.",
    kMachineKeys,
    false,
    {},
    kMachineLaws};

constexpr KeyFormat kEncoderKeys[] = {
    other("body", "body", "", "The body whose position the encoder measures."),
    other("reference", "body or ground", "ground",
          "The body to which the measured position is relative."),
    needed("scale", D::count_per_length, S::not_zero, "Encoder counts per metre."),
};
constexpr TableFormat kEncoder{"The encoder, whose position the firmware reads.", kEncoderKeys};

constexpr KeyFormat kSwitchesKeys[] = {
    optional("limit_neg", D::length, S::any, "no switch",
             "Limit switch that is active at this position and below it."),
    optional("limit_pos", D::length, S::any, "no switch",
             "Limit switch that is active at this position and above it; above limit_neg."),
    optional("home_from", D::length, S::any, "active from the negative end of the travel",
             "Home switch that is active at this position and above it."),
    optional("home_to", D::length, S::any, "active to the positive end of the travel",
             "Home switch that is active below this position; above home_from."),
    optional("index", D::length, S::any, "no pulse",
             "Position at which the encoder gives an index pulse."),
    optional("index_every", D::length, S::positive, "one pulse",
             "Distance between further index pulses, beginning at `index`, which must be given "
             "too."),
};
constexpr TableFormat kSwitches{
    "Positions of switches along the travel of the encoder's body. A switch exists only "
    "if its position is given.",
    kSwitchesKeys};

constexpr KeyFormat kAdcKeys[] = {
    integer("channel", 0, 1, std::nullopt,
            "Number of the converter; channel 0 measures the force that the firmware controls."),
    other("signal", "signal", "",
          "The signal of the model that the converter measures; see the signals below."),
    ranged("creep", D::ratio, -0.1, 0.1, "no creep",
           "Share of the load by which the reading grows under a constant load, as OIML R 60 and "
           "data sheets of load cells give it: 0.0005 is 0.05 %. The reading of a signal y is y + "
           "creep * z, z' = (y - z) / creep_time, with z = 0 at tick 0."),
    ranged("creep_time", D::time, 0.01, 1e6, "creep must be omitted too",
           "Time constant of the creep, from 0.01 s to 1e6 s."),
    other("drift", "number", "no drift",
          "Final error of the zero while the sensor warms up, in the unit of the signal. At the "
          "time t after tick 0 the error is drift * (1 - exp(-t / drift_time))."),
    ranged("drift_time", D::time, 0.01, 1e6, "drift must be omitted too",
           "Time constant of the drift, from 0.01 s to 1e6 s."),
    other("sensor_limit", "number", "not limited",
          "Magnitude at which the sensor saturates, > 0, in the unit of the signal."),
    optional("filter", D::rate, S::positive, "no filter",
             "Corner frequency of a first-order low pass after the sensor, at most 1e6 rad/s."),
    other("conditioning_limit", "number", "not limited",
          "Magnitude at which the analog electronics saturate, > 0, in the unit of the signal."),
    other("noise", "number", "0", "Measurement noise (rms), in the unit of the signal."),
    other("per_count", "number", "",
          "Change of the signal for one ADC code, not 0, in the unit of the signal per count."),
    number("zero_code", D::count, S::any, 0.0,
           "ADC code at signal 0: an integer from 0 to 2^bits - 1. With 2^(bits-1) the converter "
           "measures both directions."),
    integer("bits", 8, 24, 8.0,
            "Resolution of the converter in bits. The firmware has the upper 16 bits of a longer "
            "code, so its `adc_bits` is then 16."),
    ranged("sample_rate", D::frequency, 1.0, 30e3, "a sample at each tick of 1/1500 s",
           "Rate of the samples, from 1 Hz to 30 kHz."),
    other("converter_filter", "none, sinc3, sinc4, sinc5", "none",
          "Filter of a sigma-delta converter, beside sample_rate: a sample is the mean of the "
          "signal over the last 3, 4 or 5 periods T of the samples, weighted so that a frequency f "
          "keeps |sin(pi f T) / (pi f T)| to the power of 3, 4 or 5. The delay is 1.5, 2 or 2.5 "
          "periods, beside `latency`. The limits of sensor and electronics act before the filter, "
          "noise and conversion after it. Before tick 0 the signal has its value of tick 0."),
    ranged(
        "sample_phase", D::time, 0.0, 1.0, "not known",
        "Time from tick 0 to the first sample, at least 0 and below 1 / sample_rate. Without this "
        "key a run takes 0, and limits and margins are the worst of all phases. A time below 1 ns "
        "counts as 0."),
    ranged("latency", D::time, 0.0, 0.1, 0.0,
           "Time from a sample to the tick from which on the firmware has it, at most 0.1 s. A "
           "time below 1 ns counts as 0. Until the first sample arrives, the firmware has the "
           "signal of tick 0."),
};
constexpr TableFormat kAdc{
    "An ADC of the firmware. Creep and drift are added to the signal, which then passes the sensor "
    "limit, the low pass, the limit of the electronics, the filter of the converter and the noise "
    "before its conversion to a code. With a sample rate or a latency the firmware has the newest "
    "sample that has arrived, and its age in ticks.",
    kAdcKeys};

constexpr KeyFormat kDacKeys[] = {
    integer("bits", 8, 16, 12.0,
            "Resolution of the converter in bits. A run needs 12 to 16; it gives the firmware "
            "`dac_bits` of this value. A drive on a bus may have 16."),
    number("range", D::voltage, S::positive, 10.0,
           "Range of the output voltage: the voltage at the lowest code is -range."),
    number("offset", D::voltage, S::any, 0.0, "Output voltage at code 0."),
    number("noise", D::voltage, S::not_negative, 0.0, "Noise of the output voltage (rms)."),
};
constexpr TableFormat kDac{
    "The DAC of the command. Its output voltage is code * 2 range / 2^bits + offset + "
    "noise.",
    kDacKeys};

constexpr const TableFormat *kDriveTypes[] = {&kDcMotorFormat, &kFirstOrderFormat, &kPerfectFormat,
                                              &kTorqueFormat,  &kVelocityFormat,   &kStepperFormat};
constexpr TableFormat kDrive{"The motor with its amplifier. The DAC voltage u is its input.",
                             kDriveKeys,
                             false,
                             {},
                             kDriveTypes};

constexpr KeyFormat kTitle = other("title", "text", "empty", "Title of the file.");
constexpr KeyFormat kShows = other("shows", "text", "empty", "What the file demonstrates.");

constexpr KeyFormat kModelKeys[] = {
    kTitle,
    kShows,
    other("parameters_file", "file name", "none",
          "A file in the same folder that has the table [parameters] for several models."),
    table("parameters", kParameters),
    table("body", kBody, true),
    table("structure", kStructure, true),
    table("spring", kSpring, true),
    table("damper", kDamper, true),
    table("contact", kContact, true),
    table("backlash", kBacklash, true),
    table("stop", kStop, true),
    table("friction", kFriction, true),
    table("brake", kBrake, true),
    table("gravity", kGravity, true),
    table("cogging", kCogging, true),
    table("external", kExternal, true),
    table("drive", kDrive),
    table("machine_controller", kMachineController),
    table("encoder", kEncoder),
    table("switches", kSwitches),
    table("adc", kAdc, true),
    table("dac", kDac),
};

constexpr KeyFormat kSharedKeys[] = {kTitle, kShows, table("parameters", kParameters)};

}  // namespace

constexpr TableFormat kDcMotorFormat{
    "A DC motor with a current amplifier, after a preamplifier with tachometer feedback. "
    "DcMotor in sim/model/model.hpp has the equations.",
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
constexpr TableFormat kTorqueFormat{
    "A current amplifier with its motor, rotary or linear: the current follows current_per_volt u "
    "as a first-order lag, and the force follows the current. TorqueDrive in sim/model/model.hpp "
    "has the equations.",
    kTorqueKeys,
    false,
    "type = \"torque\"",
    {}};
constexpr TableFormat kVelocityFormat{
    "A drive with a velocity loop of its own: a PI controller of the velocity above a current "
    "loop. The integral follows the limited target of the current, so it does not wind up. The "
    "gains are given, or computed from bandwidth, damping_ratio and the mass for which the loop "
    "was tuned; `forceaxis loop linearise` prints them. VelocityDrive in sim/model/model.hpp has "
    "the "
    "equations.",
    kVelocityKeys,
    false,
    "type = \"velocity\"",
    {}};
constexpr TableFormat kStepperFormat{
    "A stepper motor without an encoder of its own. Its force is a sine of the load angle, the "
    "travel of the field less that of the body, so it resists as a spring and slips by 4 full "
    "steps if the load is more than holding_force. After a slip of 8 such periods the motor has "
    "stalled and has no force until it is disabled and enabled again, which sets the load angle to "
    "0. StepperDrive in sim/model/model.hpp has the equations.",
    kStepperKeys,
    false,
    "type = \"stepper\"",
    {}};
constexpr TableFormat kParameterFormat = kParameter;
constexpr TableFormat kSharedParametersFormat{"Parameters of several models.", kSharedKeys};
constexpr TableFormat kModelFormat{"The model of a plant.", kModelKeys};

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
