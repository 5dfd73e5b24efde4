#pragma once
// The program of a cycle in a TOML file: phases, their conditions and limits, and evaluation
// elements, with units and names. read_cycle() converts it to the record that the firmware runs
// (firmware/cycle/program.h), with the scales of a model.
//
// Every error is an InputError that names file and key: a phase that cannot be reached or cannot
// end, a loop without a count, a condition that a limit prevents, a force beyond force_limit, or
// beyond what the force sensor can show.
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "host/run/item.hpp"
#include "host/run/object_values.hpp"
#include "sim/model/format.hpp"
#include "sim/model/model.hpp"

namespace forceaxis::host {

extern const sim::TableFormat kCycleFormat;

using CyclePoints = std::vector<std::tuple<double, double>>;

// A condition as the file describes it, in SI units.
struct CycleEnd {
  static constexpr const char *kName = "CycleEnd";
  static constexpr const char *kMeaning = "A condition that ends a phase.";
  std::string when;
  std::optional<double> value;
  std::string unit;
  std::string next;

  static constexpr auto items() {
    return std::tuple{item("when", &CycleEnd::when),
                      item("value", &CycleEnd::value, "in `unit`; None if it has none"),
                      item("unit", &CycleEnd::unit, "s, N, N/m, m, or empty"),
                      item("next", &CycleEnd::next, "name of the phase that follows, or end")};
  }
};

// A phase as the file describes it.
struct CyclePhase {
  static constexpr const char *kName = "CyclePhase";
  static constexpr const char *kMeaning =
      "A phase, with the conditions that end it in the order of the file.";
  std::string name;
  std::vector<CycleEnd> ends;
  std::string on_limit;
  std::optional<double> tare_s;

  static constexpr auto items() {
    return std::tuple{item("name", &CyclePhase::name), item("ends", &CyclePhase::ends),
                      item("on_limit", &CyclePhase::on_limit),
                      item("tare_s", &CyclePhase::tare_s,
                           "time over which the phase measures the offset of the force")};
  }
};

// An evaluation element as the file describes it, in SI units. Empty: no such bound.
struct CycleElement {
  static constexpr const char *kName = "CycleElement";
  static constexpr const char *kMeaning =
      "An evaluation element, with bounds in SI units. None means that there is no such bound.";
  std::string name;
  std::string kind;
  std::vector<std::string> phases;
  std::string over;
  std::string of;
  std::string unit;
  double per_value = 1.0;
  std::optional<double> x_from, x_to, least, most, level;
  CyclePoints lower, upper;

  static constexpr auto items() {
    using E = CycleElement;
    return std::tuple{
        item("name", &E::name),
        item("kind", &E::kind, "kind of evaluation element: peak, window, ..."),
        item("phases", &E::phases),
        item("over", &E::over, "travel or time"),
        item("of", &E::of, "x or force: what crosses the level of `at` and `difference`"),
        item("unit", &E::unit, "SI unit of the value; empty for a number"),
        item("per_value", &E::per_value, "value in SI units = value of the firmware * per_value"),
        item("x_from", &E::x_from),
        item("x_to", &E::x_to),
        item("least", &E::least),
        item("most", &E::most),
        item("level", &E::level),
        item("lower", &E::lower, "points (x, N) of the curves of an envelope"),
        item("upper", &E::upper)};
  }
};

struct CycleProgram {
  static constexpr const char *kName = "CycleProgram";
  static constexpr const char *kMeaning = "A program of a cycle, compiled for an axis.";
  // The record of the program, at most 4096 bytes, in words so that it is aligned.
  std::vector<std::uint32_t> record;
  std::filesystem::path file;
  std::string title;
  std::uint32_t number = 0;
  std::string zero;
  std::optional<double> zero_at;
  std::vector<CyclePhase> phases;
  std::vector<CycleElement> elements;
  CyclePoints compliance;

  std::vector<std::string> phase_names() const {
    std::vector<std::string> names;
    for (const CyclePhase &phase : phases) names.push_back(phase.name);
    return names;
  }
  // The CRC of the record, its last word.
  std::uint32_t crc() const { return record.back(); }

  static constexpr auto items() {
    using P = CycleProgram;
    return std::tuple{
        item("file", &P::file),
        item("title", &P::title),
        item("number", &P::number, "number by which the axis selects the program; 0: none"),
        item("crc", &P::crc, "CRC of the record"),
        item("zero", &P::zero, "what defines travel 0: touch, force or position"),
        item("zero_at", &P::zero_at, "the force in N, or the position in m"),
        item("phases", &P::phases),
        item("elements", &P::elements),
        item("compliance", &P::compliance,
             "points (N, m): deflection of the press over the force")};
  }
};

// Reads a program. The model has to have an encoder and a force on ADC 0. `initial` has the writes
// to the firmware before tick 0, of which rated_force, force_limit, force_sign, tare_band, the
// objects of the reading (adc_bits, force_zero_code, force_tare) and the soft limits count. Throws
// sim::InputError.
CycleProgram read_cycle(const std::filesystem::path &file, const sim::Model &model,
                        const std::vector<ObjectWrite> &initial);

}  // namespace forceaxis::host
