#pragma once
// The tables of an experiment file that accept keys of any name. experiment.hpp declares all other
// tables beside the structs that they describe. The keys of the table [expect] are declared in the
// Python module forceaxis.experiments.expect, which reads this table.
#include "host/run/bank_values.hpp"
#include "host/run/shaper_values.hpp"
#include "sim/model/field.hpp"

namespace forceaxis::host {

inline constexpr sim::TableFormat kSetFormat{
    "Values for parameters of the model, by name: numbers in the unit of the parameter, "
    "quantities, or names of other parameters. Overrides NAME=VALUE take precedence.",
    {},
    true};

inline constexpr sim::KeyFormat kFirmwareKeys[] = {
    sim::format::table("bank_1", sim::kFormat<Bank>),
    sim::format::table("bank_2", sim::kFormat<Bank>),
    sim::format::table("bank_3", sim::kFormat<Bank>),
    sim::format::table("bank_4", sim::kFormat<Bank>),
    sim::format::table("shaper_force", sim::kFormat<Shaper>),
    sim::format::table("shaper_motion", sim::kFormat<Shaper>),
};
inline constexpr sim::TableFormat kFirmwareFormat{
    "Values for objects of the firmware, by name (`list_objects` lists them): a "
    "number in the unit of the object, a quantity that is converted with the scales of "
    "the model, the name of a parameter, a text of an enumeration, or true or false. "
    "They are written before the first tick: parameters, then commands, `mode` last.",
    kFirmwareKeys, true};
inline constexpr sim::TableFormat kFirmwareAtFormat{
    "Values for objects of the firmware that are written at this instant, as in "
    "[firmware].",
    kFirmwareKeys, true};

inline constexpr sim::TableFormat kExpectFormat{
    "Expected results, with which `test_experiments` compares the run.", {}, true};

}  // namespace forceaxis::host
