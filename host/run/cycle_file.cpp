#include "host/run/cycle_file.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include "host/run/cycle_check.hpp"
#include "host/run/cycle_encode.hpp"
#include "host/run/cycle_scales.hpp"
#include "sim/model/section.hpp"
#include "sim/model/text.hpp"
#include "sim/model/toml.hpp"

namespace forceaxis::host {
namespace {

using sim::Section;

// Returns the single keys of a text such as "a, b".
std::vector<std::string_view> split(std::string_view keys) {
  std::vector<std::string_view> all;
  while (!keys.empty()) {
    const std::size_t end = std::min(keys.find(", "), keys.size());
    all.push_back(keys.substr(0, end));
    keys.remove_prefix(std::min(end + 2, keys.size()));
  }
  return all;
}

bool has(const std::vector<std::string_view> &keys, std::string_view key) {
  return std::find(keys.begin(), keys.end(), key) != keys.end();
}

CyclePoints points_of(const std::vector<double> &x, const std::vector<double> &y) {
  CyclePoints points;
  for (std::size_t i = 0; i < x.size(); ++i) points.emplace_back(x[i], y[i]);
  return points;
}

void expect_at_most(const Section &section, const char *list, const char *what, std::size_t size,
                    std::size_t most) {
  if (size > most)
    section.fail(list, "expected at most " + std::to_string(most) + " " + what + ", got " +
                           std::to_string(size) + "; remove some");
}

}  // namespace

void expect_keys(Section &section, std::string_view key, std::span<const CycleKind> rows,
                 const CycleKind &word) {
  const std::string of = std::string(key) + " = " + sim::in_quotes(word.name);
  const auto needed = split(word.needs), taken = split(word.takes);
  for (const CycleKind &row : rows)
    for (const auto &keys : {split(row.needs), split(row.takes)})
      for (const std::string_view other : keys)
        if (section.has(other) && !has(needed, other) && !has(taken, other))
          section.fail(other, "expected no such key for " + of + "; remove this key");
  for (const std::string_view own : needed) (void)section.require(own, "this key for " + of);
}

std::uint8_t codes_of(Section &section, std::string_view key, std::span<const CycleKind> rows) {
  std::vector<std::string> known;
  for (const CycleKind &row : rows) known.emplace_back(row.name);
  int codes = 0;
  for (const std::string &name : section.texts(key, "one of " + sim::joined(known))) {
    const auto found = std::find(known.begin(), known.end(), name);
    if (found == known.end())
      section.fail(key, "expected one of " + sim::joined(known) + ", got " + sim::in_quotes(name) +
                            sim::suggestion(name, known) + "; correct the name");
    codes |= rows[static_cast<std::size_t>(found - known.begin())].code;
  }
  return static_cast<std::uint8_t>(codes);
}

void CyclePhase::complete(Section &section, sim::Names &) {
  if (name == "end")
    section.fail("name", "expected a name other than end, which is reserved; rename this phase");
  if (ends.empty())
    section.fail("end", "expected a condition that ends the phase, got none; add [[phase.end]]");
  expect_at_most(section, "end", "conditions of a phase", ends.size(), CYCLE_CONDITIONS);
  const bool is_used = std::any_of(ends.begin(), ends.end(), [](const CycleEnd &end) {
    return end.when.row().value == sim::Dimension::stiffness;
  });
  if (is_used != stiffness_travel.has_value())
    section.fail("stiffness_travel",
                 is_used
                     ? "expected this key, because a condition of stiffness needs it; add this key"
                     : "expected no such key for a phase without a condition of stiffness; "
                       "remove this key");
}

sim::Quantity CycleElement::value() const {
  if (of.code() != 0) return x();
  if (kind.code() != CYCLE_WORK) return {sim::Dimension::force};
  return {over.code() != 0 ? sim::Dimension::impulse : sim::Dimension::energy};
}

CyclePoints CycleElement::lower() const { return points_of(lower_x, lower_force); }
CyclePoints CycleElement::upper() const { return points_of(upper_x, upper_force); }

void CycleElement::complete(Section &section, sim::Names &) {
  if (x_from && x_to && *x_from > *x_to)
    section.fail("to", "expected at least the value of from; exchange them");
  if (least && most && *least > *most)
    section.fail("most", "expected at least the value of least; exchange them");
}

CyclePoints CycleProgram::compliance() const {
  return points_of(compliance_force, compliance_deflection);
}

std::vector<std::string> CycleProgram::phase_names() const {
  std::vector<std::string> names;
  for (const CyclePhase &phase : phases) names.push_back(phase.name);
  return names;
}

std::vector<std::byte> CycleProgram::bytes() const {
  std::vector<std::byte> all(record.size() * sizeof(record[0]));
  std::memcpy(all.data(), record.data(), all.size());
  return all;
}

void CycleProgram::complete(Section &section, sim::Names &) {
  if (phases.empty()) section.fail("phase", "expected at least one [[phase]], got none");
  expect_at_most(section, "phase", "phases", phases.size(), CYCLE_PHASES_MAX);
  expect_at_most(section, "element", "elements", elements.size(), CYCLE_ELEMENTS_MAX);
}

namespace {

// Reads the program of a press cycle. `scales_of` returns the scales of the axis, for a Source with
// which it can refuse the axis.
template <class ScalesOf>
CycleProgram read(const std::filesystem::path &file, const ScalesOf &scales_of) {
  const toml::table table = sim::parse_toml(file.string());
  sim::Source source{file.string(), {}};
  Section root(source, table, "", sim::kFormat<CycleProgram>);
  const CycleScales scales = scales_of(source);
  sim::Names names;
  auto program = sim::read_table<CycleProgram>(root, names);
  root.finish();
  program.file = file;
  for (CycleElement &element : program.elements)
    if (!element.is_window()) element.per_value = 1.0 / scales.per(element.value().dimension);
  const CyclePlace place{source};
  const CycleCode code = encode_cycle(program, scales, place);
  check_cycle(program, code, scales, place);
  program.record = code.record(place);
  return program;
}

}  // namespace

CycleProgram read_cycle(const std::filesystem::path &file, const sim::Model &model,
                        const std::vector<ObjectWrite> &initial) {
  return read(file,
              [&](const sim::Source &source) { return cycle_scales(source, model, initial); });
}

CycleProgram read_cycle(const std::filesystem::path &file, const CycleScales &scales) {
  return read(file, [&](const sim::Source &) { return scales; });
}

}  // namespace forceaxis::host
