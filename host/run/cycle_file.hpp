#pragma once
// The program of a press cycle in a TOML file: phases, their conditions and limits, and evaluation
// elements, with units and names. read_cycle() converts it to the record that the firmware runs
// (firmware/cycle/program.h), with the scales of a model. The rows of the structs declare the keys
// of the file. cycle_kinds.hpp declares the words that a key may have as its value.
//
// Every error is an InputError that names file and key. Examples of errors are a phase that cannot
// be reached or cannot end, a loop without a count, and a condition that a limit prevents. A force
// beyond force_limit or beyond the range of the force sensor is also an error.
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "host/run/cycle_kinds.hpp"
#include "host/run/cycle_scales.hpp"
#include "host/run/item.hpp"
#include "host/run/object_values.hpp"
#include "sim/model/field.hpp"
#include "sim/model/model.hpp"

namespace forceaxis::host {

using CyclePoints = std::vector<std::tuple<double, double>>;

// A condition as the file describes it, in SI units.
struct CycleEnd {
  static constexpr const char *kName = "CycleEnd";
  static constexpr std::string_view kMeaning =
      "A condition that ends the phase. Up to 4 are checked in each tick, in the order of the "
      "file, "
      "after the limits.";
  CycleChoice<kCycleConditions> when;
  std::optional<double> value;
  CycleSet<kCycleInputs> inputs;
  std::string next;
  int count = 0;

  sim::Quantity quantity() const { return {*when.row().value, when.row().sign}; }
  std::string_view unit() const {
    return when.row().value ? sim::unit_of(*when.row().value) : std::string_view();
  }

  static constexpr auto rows() {
    using namespace sim::format;
    return sim::rows_of(
        sim::field(&CycleEnd::when, choice("when", kWordsOf<kCycleConditions>, "",
                                           "choose what ends the phase", kWhen)),
        sim::field(&CycleEnd::value, &CycleEnd::quantity,
                   other("value", "number", "none",
                         "Value of the quantity: s for time, N for a force, m for a travel, N/m "
                         "for a stiffness.")),
        sim::field(&CycleEnd::inputs, other("inputs", "list of inputs", "none", kInputs)),
        sim::field(&CycleEnd::next, other("next", "phase or end", "",
                                          "The phase that follows; `end`: the cycle ends as "
                                          "intended.")),
        sim::field(&CycleEnd::count, integer("count", 0, 65535, 0,
                                             "Largest number of times in a cycle that this "
                                             "condition is taken; 0: any number.")));
  }
  static constexpr auto items() {
    return std::tuple{
        item("when", &CycleEnd::when),
        item("value", &CycleEnd::value,
             "value of the condition in `unit`; None if the condition has no value"),
        item("unit", &CycleEnd::unit, "s, N, N/m, m, or empty"),
        item("next", &CycleEnd::next, "name of the phase that follows this condition, or end")};
  }

 private:
  static constexpr CycleText kWhen = meanings<kCycleConditions>("What ends the phase.");
  static constexpr CycleText kInputs =
      naming<kCycleInputs>("Inputs of a condition that needs them");
};

// A phase as the file describes it, in SI units.
struct CyclePhase {
  static constexpr const char *kName = "CyclePhase";
  static constexpr std::string_view kMeaning =
      "A phase of the cycle, at most 16. The cycle begins with the first one.";
  std::string name;
  CycleChoice<kCycleActions> action;
  std::optional<double> position, distance, speed, force, slope;
  CycleChoice<kCycleTables> over;
  std::vector<double> table_x, table_force;
  std::optional<double> tare_s;
  CycleSet<kCycleOutputs> outputs_on, outputs_off;
  double force_max = 0.0;
  double travel_max = 0.0;
  double time_max = 0.0;
  std::optional<double> stiffness_travel;
  std::string on_limit = "end";
  std::vector<CycleEnd> ends;

  static constexpr auto rows() {
    using sim::Sign, sim::field;
    using D = sim::Dimension;
    using P = CyclePhase;
    using namespace sim::format;
    return sim::rows_of(
        field(&P::name, name_of("phase", "Name of the phase.")),
        field(&P::action,
              choice("do", kWordsOf<kCycleActions>, "", "choose what the phase does", kDo)),
        field(&P::position,
              optional("position", D::length, Sign::any, "none",
                       "Position of a move, from the zero of the homing (position_actual of the "
                       "axis). The axis has to be homed.")),
        field(&P::distance,
              optional("distance", D::length, Sign::any, "none",
                       "Distance of move_by, move_to_depth and approach, positive towards the "
                       "workpiece. The place of move_to_depth has this depth without a force on "
                       "the press.")),
        field(&P::speed,
              optional("speed", D::velocity, Sign::positive, "none", "Speed of the motion.")),
        field(&P::force, optional("force", D::force, Sign::not_zero, "none", "Force of press.")),
        field(&P::slope,
              optional("slope", D::force_rate, Sign::positive, "none",
                       "Rate at which the demanded force of press changes, from the force at its "
                       "start. For follow the largest rate; a table over time may not be "
                       "steeper.")),
        field(&P::over, choice("over", kWordsOf<kCycleTables>, "time", "choose x of the table",
                               "x of the table of follow: time or travel since the phase began, "
                               "the travel positive towards the workpiece.")),
        field(&P::table_x,
              numbers("table_x", D::ratio, Sign::any, "none",
                      "x of the points of the table of follow, 2 to 255, in s or m. Between two "
                      "points the force is on a straight line; before the first point it is the "
                      "first force, after the last point the last one.")),
        field(&P::table_force, numbers("table_force", D::force, Sign::any, "none",
                                       "Forces of the points of the table.")),
        field(&P::tare_s, ranged("tare_time", D::time, 1e-3, 10.0, "none",
                                 "Time over which tare takes the mean of the force, from "
                                 "standstill on.")),
        field(&P::outputs_on, other("outputs_on", "list of outputs", "none", kOn)),
        field(&P::outputs_off,
              other("outputs_off", "list of outputs", "none", "Outputs that are switched off.")),
        field(&P::force_max, needed("force_max", D::force, Sign::positive,
                                    "Limit of the magnitude of the measured force in this phase.")),
        field(&P::travel_max,
              needed("travel_max", D::length, Sign::positive,
                     "Limit of the travel since the start of the phase, in either direction.")),
        field(&P::time_max, ranged("time_max", D::time, 1e-3, kLongest_s, "",
                                   "Limit of the duration of the phase.")),
        field(&P::stiffness_travel,
              optional("stiffness_travel", D::length, Sign::positive, "none",
                       "Travel of one section over which stiffness_above and stiffness_below "
                       "measure, needed with them.")),
        field(&P::on_limit, other("on_limit", "phase or end", "end",
                                  "The phase that follows when a limit is exceeded; the part is "
                                  "then not good. A second limit ends the cycle.")),
        field(&P::ends, table("end", sim::kFormat<CycleEnd>, true)));
  }
  void complete(sim::Section &section, sim::Names &);

  static constexpr auto items() {
    return std::tuple{item("name", &CyclePhase::name), item("ends", &CyclePhase::ends),
                      item("on_limit", &CyclePhase::on_limit),
                      item("tare_s", &CyclePhase::tare_s,
                           "time over which the phase measures the offset of the force")};
  }

 private:
  static constexpr double kLongest_s = 3600.0;
  static constexpr CycleText kDo = meanings<kCycleActions>("");
  static constexpr CycleText kOn =
      naming<kCycleOutputs>("Outputs that are switched on when the phase begins, of any action");
};

// An evaluation element as the file describes it, in SI units. An empty bound is not checked.
struct CycleElement {
  static constexpr const char *kName = "CycleElement";
  static constexpr std::string_view kMeaning =
      "An evaluation element, at most 16: a figure of the curve of force over x in some phases. "
      "The "
      "part is good if the cycle ends as intended and each element is within its bounds. A window "
      "needs all of from, to, least and most, in the units of x and of the force.";
  std::string name;
  CycleChoice<kCycleElementKinds> kind;
  std::vector<std::string> phases;
  CycleChoice<kCycleCurves> over;
  CycleChoice<kCycleCrossings> of;
  std::optional<double> x_from, x_to, least, most, level, level_2;
  CycleChoice<kCycleDirections> direction;
  int ordinal = 1;
  CycleSet<kCycleSides> enters, leaves;
  std::vector<double> lower_x, lower_force, upper_x, upper_force;
  double per_value = 1.0;

  // Return the quantities of x, of the element's value and of the levels.
  sim::Quantity x() const {
    return {over.code() != 0 ? sim::Dimension::time : sim::Dimension::length};
  }
  sim::Quantity value() const;
  sim::Quantity crossed() const {
    return of.code() != 0 ? sim::Quantity{sim::Dimension::force} : x();
  }
  bool is_window() const { return kind.code() == CYCLE_WINDOW; }
  bool is_shape() const { return is_window() || kind.code() == CYCLE_ENVELOPE; }
  std::string_view unit() const {
    return is_window() ? std::string_view() : sim::unit_of(value().dimension);
  }
  CyclePoints lower() const;
  CyclePoints upper() const;

  static constexpr auto rows() {
    using sim::Sign, sim::field;
    using D = sim::Dimension;
    using E = CycleElement;
    using namespace sim::format;
    return sim::rows_of(
        field(&E::name, name_of("element", "Name of the element.")),
        field(&E::kind,
              choice("kind", kWordsOf<kCycleElementKinds>, "", "choose a kind of element", kKinds)),
        field(&E::phases, other("phases", "list of phases", "", "The phases whose samples count.")),
        field(&E::over,
              choice("over", kWordsOf<kCycleCurves>, "travel", "choose x of the curve",
                     "x of the curve: travel from travel 0 (the key zero), or time since the first "
                     "sample of the element.")),
        field(&E::of, choice("of", kWordsOf<kCycleCrossings>, "x", "choose what crosses the level",
                             "Quantity that crosses the level of at and difference.")),
        field(&E::x_from, &E::x,
              other("from", "number", "the smallest x", "Begin of the range of x, in m or s.")),
        field(&E::x_to, &E::x, other("to", "number", "the largest x", "End of the range of x.")),
        field(&E::least, &E::value,
              other("least", "number", "no bound", "Smallest good value: N, m, s, N m or N s.")),
        field(&E::most, &E::value, other("most", "number", "no bound", "Largest good value.")),
        field(&E::level, &E::crossed,
              other("level", "number", "none",
                    "Level of at and difference: m or s of x, N of force.")),
        field(&E::level_2, &E::crossed,
              other("level_2", "number", "none", "Second level of difference.")),
        field(&E::direction,
              choice("direction", kWordsOf<kCycleDirections>, "rising", "choose the direction",
                     "Direction of the crossing. A line that ends on the level from below crosses "
                     "it rising; one that begins on it and ends below crosses it falling.")),
        field(&E::ordinal, integer("ordinal", 1, 255, 1, "Number of the crossing that counts.")),
        field(&E::enters, other("enters", "list of sides", "none", kEnters)),
        field(&E::leaves, other("leaves", "list of sides", "the curve ends in the window",
                                "Sides through which the curve may leave the window.")),
        field(&E::lower_x, numbers("lower_x", D::ratio, Sign::any, "none",
                                   "x of the points of the lower curve, in m or s.")),
        field(&E::lower_force, numbers("lower_force", D::force, Sign::any, "none",
                                       "Forces of the points of the lower curve.")),
        field(&E::upper_x, numbers("upper_x", D::ratio, Sign::any, "none",
                                   "x of the points of the upper curve.")),
        field(&E::upper_force, numbers("upper_force", D::force, Sign::any, "none",
                                       "Forces of the points of the upper curve.")));
  }
  void complete(sim::Section &section, sim::Names &);

  static constexpr auto items() {
    using E = CycleElement;
    return std::tuple{
        item("name", &E::name),
        item("kind", &E::kind, "kind of evaluation element: peak, window, ..."),
        item("is_shape", &E::is_shape,
             "True for a window or an envelope, whose bounds are curves and not two numbers"),
        item("phases", &E::phases),
        item("over", &E::over, "travel or time"),
        item("of", &E::of,
             "quantity that crosses the level of the kinds `at` and `difference`: x or force"),
        item("unit", &E::unit, "SI unit of the value; empty for a number"),
        item("per_value", &E::per_value, "value in SI units = value of the firmware * per_value"),
        item("x_from", &E::x_from),
        item("x_to", &E::x_to),
        item("least", &E::least, "bounds of the value; None: no such bound"),
        item("most", &E::most),
        item("level", &E::level),
        item("lower", &E::lower, "points (x, N) of the curves of an envelope"),
        item("upper", &E::upper)};
  }

 private:
  static constexpr CycleText kKinds = meanings<kCycleElementKinds>("");
  static constexpr CycleText kEnters =
      naming<kCycleSides>("Sides through which the curve may enter the window",
                          ". A corner belongs to the left or right side.");
};

struct CycleProgram {
  static constexpr const char *kName = "CycleProgram";
  static constexpr std::string_view kMeaning =
      "A cycle: phases that follow each other, and what makes a part good.";
  std::filesystem::path file;
  std::string title;
  std::string name;
  int number = 0;
  std::optional<std::string> bank_crc;
  CycleChoice<kCycleZeros> zero;
  std::optional<double> zero_force, zero_position;
  CycleSet<kCycleOutputs> keep_outputs;
  std::vector<double> compliance_force, compliance_deflection;
  std::vector<CyclePhase> phases;
  std::vector<CycleElement> elements;
  // The record of the program, at most 4096 bytes. It is stored as 32-bit words, so that it is
  // aligned.
  std::vector<std::uint32_t> record;

  std::vector<std::string> phase_names() const;
  // Returns the CRC of the record, which is the last word of the record.
  std::uint32_t crc() const { return record.back(); }
  std::vector<std::byte> bytes() const;
  std::optional<double> zero_at() const { return zero_force ? zero_force : zero_position; }
  CyclePoints compliance() const;

  static constexpr auto rows() {
    using sim::Sign, sim::field;
    using D = sim::Dimension;
    using P = CycleProgram;
    using namespace sim::format;
    return sim::rows_of(
        field(&P::title, other("title", "text", "", "Title of the program.")),
        field(&P::name, other("name", "text", "no name",
                              "Name in the record of the program, at most 12 bytes.")),
        field(&P::number,
              integer("number", 0, 0x7FFFFFFF, 0, "Number of the program, for the user.")),
        field(&P::bank_crc,
              other("bank_crc", "text", "any bank",
                    "CRC of the bank that the program was made for, such as \"1A2B3C4D\": no cycle "
                    "starts with another bank.")),
        field(&P::zero,
              choice("zero", kWordsOf<kCycleZeros>, "touch", "choose where travel 0 is", kZero)),
        field(&P::zero_force,
              optional("zero_force", D::force, Sign::not_zero, "none", "Force at travel 0.")),
        field(&P::zero_position,
              optional("zero_position", D::length, Sign::any, "none",
                       "Position of travel 0, in the coordinates of the encoder. The axis has to "
                       "be homed.")),
        field(&P::keep_outputs, other("keep_outputs", "list of outputs", "none",
                                      "Outputs that stay as they are at the end of the cycle, "
                                      "however it ends. All others go off.")),
        field(&P::compliance_force,
              needed_beside("compliance_deflection",
                            numbers("compliance_force", D::force, Sign::any, "none",
                                    "Forces of the points of the compliance of the press, 2 to "
                                    "16."))),
        field(&P::compliance_deflection,
              needed_beside("compliance_force",
                            numbers("compliance_deflection", D::length, Sign::any, "none",
                                    "Deflection of the press at each of these forces. It is "
                                    "subtracted from the travel of elements, of depth_above and "
                                    "of depth_below."))),
        field(&P::phases, table("phase", sim::kFormat<CyclePhase>, true)),
        field(&P::elements, table("element", sim::kFormat<CycleElement>, true)));
  }
  void complete(sim::Section &section, sim::Names &);

  static constexpr auto items() {
    using P = CycleProgram;
    return std::tuple{
        item("file", &P::file),
        item("title", &P::title),
        item("number", &P::number,
             "number by which an axis selects this program; 0: it cannot be selected"),
        item("record", &P::bytes,
             "bytes of the program that are downloaded to an axis (firmware/cycle/program.h)"),
        item("crc", &P::crc, "CRC of the record"),
        item("zero", &P::zero, "what defines travel 0: touch, force or position"),
        item("zero_at", &P::zero_at, "force in N or position in m that defines travel 0"),
        item("phases", &P::phases),
        item("elements", &P::elements),
        item("compliance", &P::compliance,
             "points (N, m): deflection of the press over the force")};
  }

 private:
  static constexpr CycleText kZero = meanings<kCycleZeros>("Where travel 0 is.");
};

// Reads the program of a press cycle. The model must have an encoder and a force on ADC 0.
// `initial` has the writes to the firmware before tick 0. Only the writes to these objects are
// used: rated_force, force_limit, force_sign, tare_band, the objects of the force reading
// (adc_bits, force_zero_code, force_tare) and the soft limits. Throws sim::InputError.
CycleProgram read_cycle(const std::filesystem::path &file, const sim::Model &model,
                        const std::vector<ObjectWrite> &initial);

// Reads the program of a press cycle for an axis with these scales. Throws sim::InputError.
CycleProgram read_cycle(const std::filesystem::path &file, const CycleScales &scales);

}  // namespace forceaxis::host
