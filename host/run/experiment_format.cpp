#include "host/run/experiment_format.hpp"

#include "sim/hybrid/mode.hpp"

namespace forceaxis::host {
namespace {

using sim::KeyFormat;
using sim::TableFormat;
using sim::format::integer;
using sim::format::needed;
using sim::format::optional;
using sim::format::other;
using sim::format::ranged;
using sim::format::table;

using D = sim::Dimension;
using S = sim::Sign;

constexpr double kTick_s = 1.0 / sim::kTickRateHz;

constexpr TableFormat kSet{
    "Values for parameters of the model, by name: numbers in the unit of the parameter, "
    "quantities, or names of other parameters. Overrides NAME=VALUE take precedence.",
    {},
    true};

constexpr KeyFormat kBankKeys[] = {
    ranged("gain", D::ratio, 0.0, 65535.0 / 256.0, "",
           "DAC codes per count of the measured force at 8 bits."),
    ranged("integral_rad_per_s", D::ratio, 0.0, sim::kTickRateHz, 0.0,
           "Rate of the integral action, in rad/s."),
    ranged("velocity_gain", D::ratio, 0.0, 65535.0 / 256.0, 0.0,
           "DAC codes per encoder count per tick."),
    other("sections", "list of [b0, b1, b2, a1, a2]", "none",
          "Up to three second-order sections with a0 = 1, coefficients from -16 to 16."),
    other("certificate", "flag", "true",
          "Whether the bank has a certificate for the sensor of this experiment."),
};
constexpr TableFormat kBank{"A bank of the force law.", kBankKeys};

constexpr KeyFormat kShaperKeys[] = {
    needed("mode_Hz", D::frequency, S::positive,
           "Undamped frequency of the mode of vibration. Half of its damped period must be 1 to "
           "255 ticks for zv, 1 to 127 ticks for zvd."),
    ranged("damping", D::ratio, 0.0, 0.9, 0.0, "Damping ratio of the mode of vibration."),
    other("kind", "zv, zvd", "zvd",
          "zv: two impulses. zvd: three impulses and twice the delay, for a mode whose "
          "frequency is known less exactly."),
};
constexpr TableFormat kShaper{
    "An input shaper, which prevents the excitation of one mode of vibration.", kShaperKeys};

constexpr KeyFormat kFirmwareKeys[] = {
    table("bank_1", kBank), table("bank_2", kBank),         table("bank_3", kBank),
    table("bank_4", kBank), table("shaper_force", kShaper), table("shaper_motion", kShaper),
};
constexpr TableFormat kFirmware{
    "Values for objects of the firmware, by name (`list_objects` lists them): a "
    "number in the unit of the object, a quantity that is converted with the scales of "
    "the model, the name of a parameter, a text of an enumeration, or true or false. "
    "They are written before the first tick: parameters, then commands, `mode` last.",
    kFirmwareKeys, true};
constexpr TableFormat kFirmwareAt{
    "Values for objects of the firmware that are written at this instant, as in "
    "[firmware].",
    kFirmwareKeys, true};

constexpr KeyFormat kImpulseKeys[] = {
    other("body", "body", "", "A body of the model."),
    needed("N_s", D::impulse, S::any, "The impulse, positive towards the workpiece."),
};
constexpr TableFormat kImpulse{"An impulse on a body.", kImpulseKeys};

constexpr KeyFormat kSensorKeys[] = {
    other("force", "live, held, high, low, zero, silent", "",
          "What ADC 0 converts from this instant on: the signal of the plant (live), the code "
          "of the previous tick (held), an end of its range (high, low), or the code of no "
          "force in the model (zero). With silent no new code arrives: the last one becomes "
          "older."),
};
constexpr TableFormat kSensor{"A failure of a sensor, or its end.", kSensorKeys};

constexpr KeyFormat kDriveKeys[] = {
    other("failure", "none, off, fault, silent", "",
          "The drive has switched itself off (off), also with a fault (fault), or its frames do "
          "not arrive any more while it still receives frames (silent). With none it works "
          "again, and is on `enable_ticks` later if it is enabled."),
};
constexpr TableFormat kDrive{
    "A failure of a drive that has `enable_ticks` in the model, or its end.", kDriveKeys};

constexpr KeyFormat kAtKeys[] = {
    ranged("time_s", D::time, 0.0, kLongestRun_s, "",
           "Time of the action, at most duration_s, rounded up to a tick. The action applies "
           "before that tick."),
    table("impulse", kImpulse),
    table("firmware", kFirmwareAt),
    table("sensor", kSensor),
    table("drive", kDrive),
};
constexpr TableFormat kAt{"Actions at one instant. At least one of the tables must be given.",
                          kAtKeys};

constexpr KeyFormat kVerdictKeys[] = {
    ranged("window_s", D::time, kTick_s, kLongestRun_s, "1 s, or duration_s if that is shorter",
           "Length of the window at the end of the run over which the verdict is evaluated."),
    ranged("force_ripple_max_count", D::count, 0.0, 1e9, "not checked",
           "Largest peak-to-peak ripple of the measured force, in counts at 8 bits."),
    ranged("position_ripple_max_count", D::count, 0.0, 1e12, "not checked",
           "Largest peak-to-peak ripple of the encoder, in counts."),
    other("contact_held", "flag, contact or list of contacts", "false",
          "Contacts that must stay closed; true: every contact of the model."),
    ranged("held_force_error_max_N", D::force, 0.0, 1e9, "not checked",
           "Largest difference between the mean force in the window and the set-point."),
    ranged("held_force_error_max_percent", D::ratio, 0.0, 1e9, "not checked",
           "Largest difference between the mean force in the window and the set-point, in "
           "percent of the set-point."),
    ranged("overshoot_max_percent", D::ratio, 0.0, 1e9, "not checked",
           "Largest excess of the force over the last set-point, in percent of the set-point."),
    ranged("settle_max_s", D::time, 0.0, kLongestRun_s, "not checked",
           "Longest time until the force stays within 5 % of its mean in the window."),
    ranged("peak_force_max_N", D::force, 0.0, 1e9, "not checked",
           "Largest force of any contact over the complete run."),
    ranged("peak_force_max_percent", D::ratio, 0.0, 1e9, "not checked",
           "Largest force of any contact over the complete run, in percent of the last "
           "set-point."),
    ranged("contact_losses_max", D::count, 0.0, 1e9, "not checked",
           "Largest number of contact losses over the complete run, counted for the contacts of "
           "contact_held or else for all contacts."),
    ranged("saturated_max_s", D::time, 0.0, kLongestRun_s, "not checked",
           "Longest total time of the DAC code at an end of its range, over the complete run."),
};
constexpr TableFormat kVerdict{
    "Limits for the verdict of the run; at least one must be given. `stable`: no limit "
    "is missed. `unstable`: a fault is latched, a ripple is above its limit and does not "
    "decay (it has more than 60 % of its value in the second half of the window), or "
    "contact is lost in the window. `not_met`: another limit is missed, or the contact "
    "is made after the start of the window. `never_in_contact`: the limits need a "
    "contact, and it was never made. With any limits, a run is not stable if the DAC "
    "code, or the measured force that a limit uses, is at an end of its range in the "
    "window; if the force set-point is outside the measuring range; or if force is "
    "controlled and contact is lost in the window. Without this table the run has no "
    "verdict.",
    kVerdictKeys};

constexpr KeyFormat kPlotKeys[] = {
    other("rows", "list of lists of columns", "encoder, adc0 and dac",
          "Columns of the trace. One diagram shows the columns of one row."),
    ranged("from_s", D::time, 0.0, 1e6, "the start", "Start of the time axis."),
    ranged("to_s", D::time, 0.0, 1e6, "the end", "End of the time axis, later than from_s."),
};
constexpr TableFormat kPlot{"Content of the figure of a run.", kPlotKeys};

constexpr KeyFormat kTraceKeys[] = {
    other("objects", "list of objects", "",
          "Objects of the firmware whose values after each tick become columns of the trace."),
};
constexpr TableFormat kTrace{
    "Further columns of the trace. They exist only if firmware and plant run in one "
    "process.",
    kTraceKeys};

constexpr TableFormat kExpect{
    "Expected results, with which `test_experiments` compares the run.", {}, true};

constexpr KeyFormat kExperimentKeys[] = {
    other("title", "text", "", "Title of the experiment."),
    other("figure", "text", "empty",
          "Number of the figure of the thesis that the experiment repeats."),
    other("shows", "text", "empty", "What the experiment demonstrates."),
    other("model", "file name", "", "File of the model, relative to this file."),
    needed("duration_s", D::time, S::positive,
           "Duration, at most 600 s, rounded up to a tick of 1/1500 s."),
    integer("seed", 0, 0x7FFFFFFF, 0.0, "Seed of the measurement noise of the model."),
    other("cycle", "file name", "none",
          "File of the program that the mode of operation `cycle` runs, relative to this file."),
    table("set", kSet),
    table("firmware", kFirmware),
    table("at", kAt, true),
    table("verdict", kVerdict),
    table("plot", kPlot),
    table("trace", kTrace),
    table("expect", kExpect),
};

}  // namespace

constexpr TableFormat kExperimentFormat{
    "An experiment: a plant, values for objects of the firmware, timed actions, and "
    "expected results.",
    kExperimentKeys};

}  // namespace forceaxis::host
