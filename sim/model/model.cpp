#include "sim/model/model.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <utility>

#include "sim/model/elements.hpp"
#include "sim/model/section.hpp"

namespace forceaxis::sim {
namespace {

toml::table parse(const std::string &file) {
  std::error_code status;
  if (!std::filesystem::is_regular_file(file, status))
    throw InputError(file, "file", "expected a readable file, got none; check the path");
  std::ifstream stream(file, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  if (!stream.good() && !stream.eof())
    throw InputError(file, "file", "expected a readable file, got a read error; check the file");
  try {
    return toml::parse(std::string_view(text), std::string_view(file));
  } catch (const toml::parse_error &error) {
    const auto where = error.source().begin;
    throw InputError(
        file, "line " + std::to_string(where.line) + ", column " + std::to_string(where.column),
        "expected valid TOML, got: " + one_line(error.description()) +
            "; correct this line (is the file complete?)");
  }
}

std::vector<Parameter> read_parameters(Source &source, const toml::node *node) {
  std::vector<Parameter> parameters;
  if (node == nullptr) return parameters;
  const toml::table *table = node->as_table();
  if (table == nullptr)
    source.fail("parameters",
                "expected a table of parameters, got " + kind_of(*node) + "; write [parameters]");
  for (const auto &[key, entry] : *table) {
    const std::string path = "parameters." + one_line(key.str());
    if (!is_identifier(key.str()))
      source.fail(path,
                  "expected a name of letters, digits and _ that begins with a letter or _, got " +
                      in_quotes(key.str()) + "; rename this parameter");
    const toml::table *fields = entry.as_table();
    if (fields == nullptr)
      source.fail(path, "expected a table { value, unit, source }, got " + kind_of(entry) +
                            "; write { value = ..., unit = \"...\", source = \"...\" }");
    Section section(source, *fields, path);
    Parameter parameter;
    parameter.name = key.str();
    parameter.file = source.file;
    const toml::node &value = section.require("value", "a finite number");
    if (!value.is_number() ||
        !std::isfinite(value.value<double>().value_or(std::numeric_limits<double>::quiet_NaN())))
      section.fail("value", "expected a finite number, got " + kind_of(value) +
                                "; give the parameter's value");
    parameter.value = *value.value<double>();
    parameter.unit = section.text("unit", "a unit such as \"kg\" or \"N s/m\"");
    if (!dimension_of(parameter.unit))
      section.fail("unit", "expected one of " + joined(unit_spellings()) + ", got " +
                               in_quotes(parameter.unit) + "; use one of these spellings");
    parameter.source = section.optional_text("source", "a text").value_or("");
    section.finish();
    parameters.push_back(std::move(parameter));
  }
  return parameters;
}

std::vector<Parameter> read_shared_parameters(const Source &source, const std::string &name) {
  const std::filesystem::path path = std::filesystem::path(source.file).parent_path() / name;
  std::error_code status;
  if (name.empty() || !std::filesystem::is_regular_file(path, status))
    source.fail("parameters_file", "expected a readable file beside this one, got " +
                                       in_quotes(name) + "; check the path");
  Source shared{path.string(), {}};
  const toml::table table = parse(shared.file);
  Section section(shared, table, "");
  (void)section.optional_text("title", "a text");
  (void)section.optional_text("shows", "a text");
  auto parameters = read_parameters(shared, section.find("parameters"));
  section.finish();
  return parameters;
}

void apply(Source &source, std::span<const Override> overrides) {
  for (const Override &change : overrides) {
    Parameter *const found = source.find(change.parameter);
    const std::string key = "parameters." + one_line(change.parameter);
    if (found == nullptr) {
      const auto names = source.parameter_names();
      source.fail(key, "expected one of the parameters " + joined(names) + ", got " +
                           in_quotes(change.parameter) + suggestion(change.parameter, names) +
                           "; correct the override's name");
    }
    if (!std::isfinite(change.value))
      source.fail(key + ".value", "expected a finite number, got " + number_text(change.value) +
                                      "; correct the override's value");
    found->value = change.value;
    found->overridden = true;
  }
}

// Follows everything with two ends from ground; what is not reached floats freely.
void check_connected(const Model &model) {
  std::vector<Ends> links;
  model.each_link([&](const auto &link) { links.push_back(link.ends); });
  if (model.drive) links.push_back({model.drive->body, model.drive->reaction});
  std::vector<bool> reached(model.bodies.size() + 1, false);  // [0] is ground
  reached[0] = true;
  for (bool grown = true; grown;) {
    grown = false;
    for (const Ends &link : links) {
      const auto a = static_cast<std::size_t>(link.a + 1);
      const auto b = static_cast<std::size_t>(link.b + 1);
      if (reached[a] != reached[b]) reached[a] = reached[b] = grown = true;
    }
  }
  for (std::size_t i = 0; i < model.bodies.size(); ++i)
    if (!reached[i + 1])
      throw InputError(
          model.file, "body[" + std::to_string(i) + "].name",
          "expected a body tied to ground by springs, other elements or the drive, got " +
              in_quotes(model.bodies[i].name) + " disconnected; connect or remove it");
}

// Each friction may stick, and then its ends move as one; a loop would hold them twice over.
void check_frictions(const Model &model) {
  std::vector<int> group(model.bodies.size() + 1);  // [0] is ground
  for (std::size_t i = 0; i < group.size(); ++i) group[i] = static_cast<int>(i);
  for (std::size_t i = 0; i < model.frictions.size(); ++i) {
    const Friction &friction = model.frictions[i];
    const int a = group[static_cast<std::size_t>(friction.ends.a + 1)];
    const int b = group[static_cast<std::size_t>(friction.ends.b + 1)];
    if (a == b)
      throw InputError(
          model.file, "friction[" + std::to_string(i) + "].between",
          "expected frictions that form no loop, got a second way between the ends of " +
              in_quotes(friction.name) + "; remove one friction of the loop");
    std::replace(group.begin(), group.end(), a, b);
  }
}

void check_used(const Source &source) {
  for (const Parameter &parameter : source.parameters)
    if (!parameter.used && parameter.file == source.file)
      source.fail("parameters." + parameter.name,
                  "expected a parameter that this model uses, got one nothing refers to; remove it "
                  "or use its name");
}

}  // namespace

InputError::InputError(std::string file_name, std::string key_name, std::string text)
    : std::runtime_error(one_line(file_name) + ": " + one_line(key_name) + ": " + one_line(text)),
      file(one_line(file_name)),
      key(one_line(key_name)),
      message(one_line(text)) {}

std::vector<SignalInfo> Model::signal_list() const {
  std::vector<SignalInfo> list;
  for (const Body &body : bodies) {
    list.push_back({body.name + ".position", Dimension::length});
    list.push_back({body.name + ".velocity", Dimension::velocity});
    list.push_back({body.name + ".acceleration", Dimension::acceleration});
  }
  each_link([&](const auto &link) {
    list.push_back({link.name + ".force", Dimension::force});
    list.push_back({link.name + ".spring_force", Dimension::force});
    list.push_back({link.name + ".spring_force_rate", Dimension::force_rate});
    list.push_back({link.name + ".deflection", Dimension::length});
  });
  for (const Gravity &gravity : gravities)
    list.push_back({gravity.name + ".force", Dimension::force});
  if (drive) {
    list.push_back({"drive.force", Dimension::force});
    list.push_back({"drive.command", Dimension::voltage});
    if (std::holds_alternative<DcMotor>(drive->type)) {
      list.push_back({"drive.current", Dimension::current});
      list.push_back({"drive.tach", Dimension::voltage});
      list.push_back({"drive.tach_filtered", Dimension::voltage});
      list.push_back({"drive.current_command", Dimension::voltage});
      list.push_back({"drive.voltage", Dimension::voltage});
    }
  }
  return list;
}

int Model::body_index(std::string_view name) const {
  const int index = find_body(bodies, name);
  if (index == kGround) throw std::invalid_argument("no body named " + std::string(name));
  return index;
}

Model load_model(const std::filesystem::path &path, std::span<const Override> overrides) {
  Source source{path.string(), {}};
  const toml::table table = parse(source.file);
  Section root(source, table, "");
  Model model;
  model.file = source.file;
  model.title = root.optional_text("title", "a text").value_or("");
  model.shows = root.optional_text("shows", "a text").value_or("");
  if (const auto shared = root.optional_text("parameters_file", "a file name"))
    source.parameters = read_shared_parameters(source, *shared);
  for (Parameter &own : read_parameters(source, root.find("parameters"))) {
    if (Parameter *const found = source.find(own.name); found != nullptr)
      *found = std::move(own);
    else
      source.parameters.push_back(std::move(own));
  }
  apply(source, overrides);
  read_elements(root, model);
  root.finish();
  check_connected(model);
  check_frictions(model);
  check_used(source);
  model.parameters = std::move(source.parameters);
  return model;
}

}  // namespace forceaxis::sim
