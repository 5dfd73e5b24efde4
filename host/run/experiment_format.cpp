#include "host/run/experiment_format.hpp"

#include <array>
#include <cstddef>

#include "host/run/bank_values.hpp"
#include "host/run/experiment.hpp"
#include "host/run/shaper_values.hpp"

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

// Returns the keys that a struct declares, followed by the key `one`. The value of this key is a
// list, or it may have several types.
template <std::size_t Count>
constexpr std::array<KeyFormat, Count + 1> with_key(const std::array<KeyFormat, Count> &keys,
                                                    const KeyFormat &one) {
  std::array<KeyFormat, Count + 1> all{};
  for (std::size_t i = 0; i < Count; ++i) all[i] = keys[i];
  all[Count] = one;
  return all;
}

constexpr TableFormat kSet{
    "Values for parameters of the model, by name: numbers in the unit of the parameter, "
    "quantities, or names of other parameters. Overrides NAME=VALUE take precedence.",
    {},
    true};

constexpr KeyFormat kSectionsKey =
    other("sections", "list of [b0, b1, b2, a1, a2]", "none",
          "Up to three second-order sections with a0 = 1, coefficients from -16 to 16.");
constexpr auto kBankKeys = with_key(sim::kKeysOf<Bank>, kSectionsKey);
constexpr TableFormat kBank{"A bank of the force law.", kBankKeys};

constexpr KeyFormat kFirmwareKeys[] = {
    table("bank_1", kBank),
    table("bank_2", kBank),
    table("bank_3", kBank),
    table("bank_4", kBank),
    table("shaper_force", sim::kFormat<Shaper>),
    table("shaper_motion", sim::kFormat<Shaper>),
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

constexpr KeyFormat kAtKeys[] = {
    ranged("time_s", D::time, 0.0, kLongestRun_s, "",
           "Time of the action, at most duration_s, rounded up to a tick. The action applies "
           "before that tick."),
    table("impulse", kImpulse),
    table("firmware", kFirmwareAt),
    table("sensor", sim::kFormat<SensorFailure>),
    table("drive", sim::kFormat<DriveState>),
};
constexpr TableFormat kAt{"Actions at one instant. At least one of the tables must be given.",
                          kAtKeys};

constexpr KeyFormat kHeldKey =
    other("contact_held", "flag, contact or list of contacts", "false",
          "Contacts that must stay closed; true: every contact of the model.");
constexpr auto kVerdictKeys = with_key(sim::kKeysOf<Criterion>, kHeldKey);
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
