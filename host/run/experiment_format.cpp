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
    "Values of the model's parameters, by name: numbers in the parameter's unit, quantities, or "
    "names of other parameters. --set NAME=VALUE takes precedence.",
    {},
    true};

constexpr KeyFormat kBankKeys[] = {
    ranged("gain", D::ratio, 0.0, 65535.0 / 256.0, "",
           "DAC codes for each count of an 8-bit force reading."),
    ranged("integral_rad_per_s", D::ratio, 0.0, sim::kTickRateHz, 0.0,
           "Corner of the integral part, in rad/s."),
    ranged("velocity_gain", D::ratio, 0.0, 65535.0 / 256.0, 0.0,
           "DAC codes for each encoder count a tick."),
    other("sections", "list of [b0, b1, b2, a1, a2]", "none",
          "Up to three second-order sections with a0 = 1, coefficients from -16 to 16."),
    other("certificate", "flag", "true", "Whether it has a certificate for this sensor."),
};
constexpr TableFormat kBank{"A bank of the force law.", kBankKeys};

constexpr KeyFormat kShaperKeys[] = {
    needed("mode_Hz", D::frequency, S::positive,
           "Undamped frequency of the mode; half its damped period is 1 to 255 ticks for zv, 1 to "
           "127 for zvd."),
    ranged("damping", D::ratio, 0.0, 0.9, 0.0, "Damping ratio of the mode."),
    other("kind", "zv, zvd", "zvd",
          "Two impulses, or three for a mode that is known less well, and twice as late."),
};
constexpr TableFormat kShaper{"A shaper of commands, which leaves one mode at rest.", kShaperKeys};

constexpr KeyFormat kFirmwareKeys[] = {
    table("bank_1", kBank), table("bank_2", kBank),         table("bank_3", kBank),
    table("bank_4", kBank), table("shaper_force", kShaper), table("shaper_motion", kShaper),
};
constexpr TableFormat kFirmware{
    "Objects of the firmware by name (`forceaxis objects` lists them): a number in the object's "
    "unit, a quantity that the model's scales convert, a parameter's name, a text of an "
    "enumeration, or true and false. Written before the first tick: parameters, then commands, "
    "`mode` last.",
    kFirmwareKeys, true};
constexpr TableFormat kFirmwareAt{
    "Objects of the firmware that are written then, as in [firmware].", kFirmwareKeys, true};

constexpr KeyFormat kImpulseKeys[] = {
    other("body", "body", "", "A body of the model."),
    needed("N_s", D::impulse, S::any, "The impulse, toward the workpiece where positive."),
};
constexpr TableFormat kImpulse{"A blow on a body.", kImpulseKeys};

constexpr KeyFormat kSensorKeys[] = {
    other("force", "live, held, high, low, zero", "",
          "What ADC 0 reads from then on: the plant's signal, the code of the tick before, an end "
          "of its range, or the model's code of no force."),
};
constexpr TableFormat kSensor{"A sensor that fails, or works again.", kSensorKeys};

constexpr KeyFormat kAtKeys[] = {
    ranged("time_s", D::time, 0.0, kLongestRun_s, "",
           "Instant, at most duration_s, rounded up to a tick; it acts before that tick."),
    table("impulse", kImpulse),
    table("firmware", kFirmwareAt),
    table("sensor", kSensor),
};
constexpr TableFormat kAt{"What happens at one instant; at least one of the tables in it.",
                          kAtKeys};

constexpr KeyFormat kVerdictKeys[] = {
    ranged("window_s", D::time, kTick_s, kLongestRun_s, "1 s, or duration_s if that is shorter",
           "The end of the run, for this time, is judged."),
    ranged("force_ripple_max_count", D::count, 0.0, 1e9, "not judged",
           "Largest ripple, peak to peak, of the force reading, in counts at 8 bits."),
    ranged("position_ripple_max_count", D::count, 0.0, 1e12, "not judged",
           "Largest ripple, peak to peak, of the encoder, in counts."),
    other("contact_held", "flag, contact or list of contacts", "false",
          "These contacts stay pressed; true: every contact of the model."),
    ranged("held_force_error_max_N", D::force, 0.0, 1e9, "not judged",
           "Largest error of the mean force in the window against the set-point."),
    ranged("held_force_error_max_percent", D::ratio, 0.0, 1e9, "not judged",
           "The same in percent of the set-point."),
    ranged("overshoot_max_percent", D::ratio, 0.0, 1e9, "not judged",
           "Largest excess of the force over the last set-point, in percent of it."),
    ranged("settle_max_s", D::time, 0.0, kLongestRun_s, "not judged",
           "Longest time until the force stays within 5 % of the force held."),
    ranged("peak_force_max_N", D::force, 0.0, 1e9, "not judged",
           "Largest force in any contact, over the whole run."),
    ranged("peak_force_max_percent", D::ratio, 0.0, 1e9, "not judged",
           "The same in percent of the last set-point."),
    ranged(
        "contact_losses_max", D::count, 0.0, 1e9, "not judged",
        "How often contact may be lost over the whole run: of the contacts of contact_held, else "
        "of all."),
    ranged("saturated_max_s", D::time, 0.0, kLongestRun_s, "not judged",
           "How long the output (DAC) may be at an end of its range, over the whole run."),
};
constexpr TableFormat kVerdict{
    "What the run is judged by; at least one limit. `stable`: all are kept. `unstable`: a fault is "
    "latched, a ripple is above its limit and does not die away (its second half of the window has "
    "more than 60 % of it), or contact is lost in the window. `not_met`: another limit is missed, "
    "or contact is made after the window has begun. `never_in_contact`: a contact was to be "
    "pressed "
    "and never was. Whatever the limits, a run is never stable while the force reading that they "
    "use or the output is at an end of its range in the window, with a set-point of force beyond "
    "the reading's range, or, where force is controlled, while contact is lost in the window. "
    "Without this table the run has no verdict.",
    kVerdictKeys};

constexpr KeyFormat kPlotKeys[] = {
    other("rows", "list of lists of columns", "encoder, adc0 and dac",
          "Columns of the trace, those of one row in one diagram."),
    ranged("from_s", D::time, 0.0, 1e6, "the start", "Where the figure begins."),
    ranged("to_s", D::time, 0.0, 1e6, "the end", "Where it ends, after from_s."),
};
constexpr TableFormat kPlot{"What the figure of a run shows.", kPlotKeys};

constexpr KeyFormat kTraceKeys[] = {
    other("objects", "list of objects", "",
          "Objects of the firmware that become columns of the trace, as they are after each tick."),
};
constexpr TableFormat kTrace{"Further columns of the trace; in process only.", kTraceKeys};

constexpr TableFormat kExpect{
    "What must come out: `forceaxis test` compares the run with it.", {}, true};

constexpr KeyFormat kExperimentKeys[] = {
    other("title", "text", "", "What the experiment is."),
    other("figure", "text", "empty", "Number of the figure that it repeats."),
    other("shows", "text", "empty", "What to look at."),
    other("model", "file name", "", "The model's file, relative to this one."),
    needed("duration_s", D::time, S::positive,
           "Duration, at most 600 s, rounded up to a tick of 1/1500 s."),
    integer("seed", 0, 0x7FFFFFFF, 0.0, "Seed of the model's noise."),
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
    "An experiment: a plant, the firmware's objects, what happens when, and what is expected.",
    kExperimentKeys};

}  // namespace forceaxis::host
