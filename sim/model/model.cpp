#include "sim/model/model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "sim/model/elements.hpp"
#include "sim/model/elements/all.hpp"
#include "sim/model/expression.hpp"
#include "sim/model/model_format.hpp"
#include "sim/model/section.hpp"
#include "sim/model/toml.hpp"

namespace forceaxis::sim {
namespace {

constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();

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
    Section section(source, *fields, path, kParameterFormat);
    Parameter parameter;
    parameter.name = key.str();
    parameter.file = source.file;
    const toml::node &value = section.require("value", "a finite number");
    if (value.is_string() && is_expression(value.ref<std::string>()))
      parameter.expression = value.ref<std::string>();
    const bool computed = !parameter.expression.empty();
    const bool quantity = !computed && value.is_string() && is_quantity(value.ref<std::string>());
    if (!computed && !quantity &&
        !std::isfinite(value.is_number() ? *value.value<double>() : kNoNumber))
      section.fail("value", "expected a finite number, got " + kind_of(value) +
                                "; give the parameter's value");
    parameter.unit = section.text("unit", "a unit such as \"kg\" or \"N s/m\"");
    const auto dimension = dimension_of(parameter.unit);
    if (!dimension)
      section.fail("unit", "expected one of " + joined(unit_spellings()) + ", got " +
                               in_quotes(parameter.unit) +
                               suggestion(parameter.unit, unit_spellings()) +
                               "; use one of these spellings");
    if (!computed)
      parameter.value =
          quantity ? section.value("value", *dimension, Sign::any) : *value.value<double>();
    parameter.refers = names_in(parameter.expression);
    parameter.documentation = section.flag("documentation");
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
    source.fail("parameters_file", "expected a readable file in the folder of this file, got " +
                                       in_quotes(name) + "; check the path");
  Source shared{path.string(), {}};
  const toml::table table = parse_toml(shared.file);
  Section section(shared, table, "", kSharedParametersFormat);
  (void)section.optional_text("title", "a text");
  (void)section.optional_text("shows", "a text");
  auto parameters = read_parameters(shared, section.find("parameters"));
  section.finish();
  return parameters;
}

// Applies the overrides of a model. It knows the file name for messages about an override.
class Overriding {
 public:
  Overriding(Source &source, const std::string &file)
      : source_(source), file_(file.empty() ? source.file : file), in_set_(!file.empty()) {}

  void apply(std::span<const Override> overrides) {
    check_names(overrides);
    // An override with the name of a parameter is applied after all overrides with a number or
    // quantity, so that it uses the overridden value.
    for (const Override &change : overrides)
      if (const auto *text = std::get_if<std::string>(&change.value);
          text != nullptr && is_expression(*text))
        put_expression(*source_.find(change.parameter), *text);
      else if (!names_parameter(change))
        put(*source_.find(change.parameter), number(change));
    std::vector<std::pair<Parameter *, Parameter>> named;
    for (const Override &change : overrides)
      if (names_parameter(change))
        named.emplace_back(source_.find(change.parameter), value_of_named(change));
    for (const auto &[parameter, other] : named) {
      if (other.expression.empty())
        put(*parameter, other.value);
      else
        put_expression(*parameter, other.name);
    }
  }

 private:
  static bool names_parameter(const Override &change) {
    const auto *text = std::get_if<std::string>(&change.value);
    return text != nullptr && !is_quantity(*text) && !is_expression(*text);
  }

  static void put(Parameter &parameter, double value) {
    parameter.value = value;
    parameter.overridden = true;
    parameter.expression.clear();
  }

  static void put_expression(Parameter &parameter, const std::string &text) {
    parameter.expression = text;
    parameter.overridden = true;
  }

  [[noreturn]] void fail(const std::string &parameter, const std::string &message) const {
    throw InputError(file_, (in_set_ ? "set." : "parameters.") + parameter, message);
  }

  void check_names(std::span<const Override> overrides) const {
    std::vector<std::string> wrong;
    for (const Override &change : overrides)
      if (source_.find(change.parameter) == nullptr) wrong.push_back(change.parameter);
    if (wrong.empty()) return;
    const auto names = source_.parameter_names();
    fail(wrong.front(), "expected one of the parameters " + joined(names) + ", got " +
                            wrong_names(wrong, names) + "; correct the override's name");
  }

  double number(const Override &change) const {
    const Parameter &parameter = *source_.find(change.parameter);
    const std::string in_unit = " in " + parameter.unit;
    double value = 0.0;
    if (const auto *text = std::get_if<std::string>(&change.value)) {
      const Dimension dimension = *dimension_of(parameter.unit);
      const QuantityResult quantity = read_quantity(*text, dimension);
      if (!quantity.value)
        fail(change.parameter, "expected " + phrase_of(dimension) + ", got " + quantity.obtained +
                                   "; correct the value or its unit");
      value = *quantity.value;
    } else {
      value = std::get<double>(change.value);
    }
    if (!std::isfinite(value))
      fail(change.parameter, "expected a finite number" + in_unit + ", got " + number_text(value) +
                                 "; correct the override's value");
    return value;
  }

  const Parameter &value_of_named(const Override &change) const {
    const std::string &name = std::get<std::string>(change.value);
    const Parameter &parameter = *source_.find(change.parameter);
    const Parameter *const other = source_.find(name);
    const auto names = source_.parameter_names();
    if (other == nullptr)
      fail(change.parameter, "expected " + phrase_of(*dimension_of(parameter.unit)) +
                                 " or a parameter out of " + joined(names) + ", got " +
                                 in_quotes(name) + suggestion(name, names) +
                                 "; correct the override's value");
    if (dimension_of(other->unit) != dimension_of(parameter.unit))
      fail(change.parameter, "expected a parameter in " + parameter.unit + ", got " + name +
                                 " in " + other->unit + "; refer to another parameter");
    return *other;
  }

  Source &source_;
  std::string file_;
  bool in_set_;
};

// Calls `visit` for each element with two ends, except the drive, in the order of the signals.
template <class Visit>
void each_link(const Model &model, Visit visit) {
  for (const Spring &spring : model.springs) visit(spring);
  for (const Damper &damper : model.dampers) visit(damper);
  for (const Contact &contact : model.contacts) visit(contact);
  for (const Backlash &backlash : model.backlashes) visit(backlash);
  for (const Stop &stop : model.stops) visit(stop);
  for (const Friction &friction : model.frictions) visit(friction);
  for (const Brake &brake : model.brakes) visit(brake);
  for (const Cogging &cogging : model.coggings) visit(cogging);
}

bool same_ends(Ends one, Ends other) {
  return (one.a == other.a && one.b == other.b) || (one.a == other.b && one.b == other.a);
}

// Returns the connections that a structure makes: of its ports with each other, and with ground
// unless it has a rigid-body mode.
std::vector<Ends> links_of(const Structure &structure, int first_port) {
  std::vector<Ends> links;
  for (int port = 1; port < static_cast<int>(structure.ports.size()); ++port)
    links.push_back({first_port, first_port + port});
  if (std::none_of(structure.modes.begin(), structure.modes.end(),
                   [](const Structure::Mode &mode) { return mode.frequency_hz == 0.0; }))
    links.push_back({first_port, kGround});
  return links;
}

// Refuses a body or a structure without a connection to ground. The search starts at ground and
// follows all elements with two ends.
void check_connected(const Model &model) {
  std::vector<Ends> links;
  each_link(model, [&](const auto &link) { links.push_back(link.ends); });
  if (model.drive) links.push_back({model.drive->body, model.drive->reaction});
  auto port = static_cast<int>(model.bodies.size());
  for (const Structure &structure : model.structures) {
    for (const Ends link : links_of(structure, port)) links.push_back(link);
    port += static_cast<int>(structure.ports.size());
  }
  // Element 0 stands for the ground.
  std::vector<bool> reached(static_cast<std::size_t>(port) + 1, false);
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
  std::size_t first = model.bodies.size() + 1;
  for (std::size_t i = 0; i < model.structures.size(); ++i) {
    const Structure &structure = model.structures[i];
    if (!reached[first])
      throw InputError(
          model.file, "structure[" + std::to_string(i) + "].ports",
          "expected a port tied to ground by springs, other elements or the drive, because the "
          "structure has a rigid-body mode, got none of " +
              joined(structure.ports) + "; connect one of them");
    first += structure.ports.size();
  }
}

using Rows = std::vector<std::vector<double>>;

// Returns the displacement of each point for a displacement of 1 of each coordinate, divided by the
// square root of the coordinate's mass. A coordinate is a body or a mode.
Rows mobility(const Model &model) {
  std::size_t coordinates = model.bodies.size();
  for (const Structure &structure : model.structures) coordinates += structure.modes.size();
  Rows rows(model.point_names().size(), std::vector<double>(coordinates, 0.0));
  std::size_t point = 0;
  for (; point < model.bodies.size(); ++point)
    rows[point][point] = 1.0 / std::sqrt(model.bodies[point].mass);
  std::size_t coordinate = point;
  for (const Structure &structure : model.structures) {
    for (const Structure::Mode &mode : structure.modes) {
      for (std::size_t port = 0; port < structure.ports.size(); ++port)
        rows[point + port][coordinate] = mode.shape[port] / std::sqrt(mode.mass);
      ++coordinate;
    }
    point += structure.ports.size();
  }
  return rows;
}

// A friction of a model, or a brake without a friction between the same ends. `key` is the path of
// its key in the model file.
struct Constraint {
  std::string key;
  std::string name;
  Ends ends;
};

// Refuses frictions that could not stick independently, because a structure has fewer modes than
// its ports have frictions.
void check_independent(const Model &model, const std::vector<Constraint> &constraints) {
  constexpr double kDependent = 1e-6;
  const Rows points = mobility(model);
  const auto dot = [](const std::vector<double> &a, const std::vector<double> &b) {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
  };
  Rows basis;  // orthonormal basis of the rows of all constraints that were checked before
  for (const Constraint &constraint : constraints) {
    std::vector<double> row(points.front().size(), 0.0);
    for (std::size_t i = 0; i < row.size(); ++i)
      for (const auto &[end, sign] :
           {std::pair(constraint.ends.a, 1), std::pair(constraint.ends.b, -1)})
        if (end != kGround) row[i] += sign * points[static_cast<std::size_t>(end)][i];
    const double size = std::sqrt(dot(row, row));
    for (int pass = 0; pass < 2; ++pass)
      for (const std::vector<double> &other : basis) {
        const double share = dot(row, other);
        for (std::size_t i = 0; i < row.size(); ++i) row[i] -= share * other[i];
      }
    const double left = std::sqrt(dot(row, row));
    if (!(left > kDependent * size))
      throw InputError(model.file, constraint.key,
                       "expected ends that can move while the other frictions and brakes stick, "
                       "got " +
                           in_quotes(constraint.name) +
                           ", whose ends have no motion of their own in the modes of the "
                           "structures; remove it or give more modes");
    for (double &value : row) value /= left;
    basis.push_back(std::move(row));
  }
}

// Refuses a loop of frictions, because the friction forces in the loop are undetermined while all
// of these frictions stick.
void check_frictions(const Model &model) {
  // group of each point of the model; index 0 is the ground
  std::vector<int> group(model.point_names().size() + 1);
  std::vector<Constraint> constraints;
  for (std::size_t i = 0; i < group.size(); ++i) group[i] = static_cast<int>(i);
  const auto join = [&](const char *element, std::size_t i, const auto &friction) {
    const std::string key = std::string(element) + "[" + std::to_string(i) + "].between";
    const int a = group[static_cast<std::size_t>(friction.ends.a + 1)];
    const int b = group[static_cast<std::size_t>(friction.ends.b + 1)];
    if (a == b)
      throw InputError(
          model.file, key,
          "expected frictions that do not form a loop, got a second path between the ends of " +
              in_quotes(friction.name) + "; remove one friction of the loop");
    std::replace(group.begin(), group.end(), a, b);
    constraints.push_back({key, friction.name, friction.ends});
  };
  for (std::size_t i = 0; i < model.frictions.size(); ++i) join("friction", i, model.frictions[i]);
  for (std::size_t i = 0; i < model.brakes.size(); ++i) {
    // A brake may have the same ends as a friction, because the brake then transmits the force of
    // both elements.
    const bool beside =
        std::any_of(model.frictions.begin(), model.frictions.end(),
                    [&](const Friction &f) { return same_ends(f.ends, model.brakes[i].ends); });
    if (!beside) join("brake", i, model.brakes[i]);
  }
  for (std::size_t i = 0; i < model.brakes.size(); ++i)
    for (std::size_t k = 0; k < i; ++k)
      if (same_ends(model.brakes[i].ends, model.brakes[k].ends))
        throw InputError(
            model.file, "brake[" + std::to_string(i) + "].between",
            "expected at most one brake between two ends, got a second brake with the ends of " +
                in_quotes(model.brakes[k].name) + "; remove one brake");
  if (!model.structures.empty()) check_independent(model, constraints);
}

void check_used(const Source &source) {
  std::vector<std::string> idle;
  for (const Parameter &parameter : source.parameters)
    if (!parameter.used && !parameter.documentation && parameter.file == source.file)
      idle.push_back(parameter.name);
  if (idle.empty()) return;
  source.fail(
      "parameters." + idle.front(),
      idle.size() == 1
          ? "expected a parameter that this model uses, got an unused parameter; "
            "remove the parameter, use its name, or mark it with documentation = true"
          : "expected parameters that this model uses, got " + joined(idle) +
                ", which are unused; remove these parameters, use their names, or mark them with "
                "documentation = true");
}

}  // namespace

InputError::InputError(std::string file_name, std::string key_name, std::string text)
    : std::runtime_error(one_line(file_name) + ": " + one_line(key_name) + ": " + one_line(text)),
      file(one_line(file_name)),
      key(one_line(key_name)),
      message(one_line(text)) {}

Model::Model() : switches(Switches{}), dac(Dac{}) {}
Model::Model(const Model &) = default;
Model::Model(Model &&) noexcept = default;
Model &Model::operator=(const Model &) = default;
Model &Model::operator=(Model &&) noexcept = default;
Model::~Model() = default;

bool Model::is_body(int point) const {
  return point >= 0 && point < static_cast<int>(bodies.size());
}

std::vector<SignalInfo> Model::signal_list() const {
  std::vector<SignalInfo> list;
  for (const std::string &point : point_names()) {
    list.push_back({point + ".position", Dimension::length});
    list.push_back({point + ".velocity", Dimension::velocity});
    list.push_back({point + ".acceleration", Dimension::acceleration});
  }
  each_link(*this, [&](const auto &link) {
    list.push_back({link.name + ".force", Dimension::force});
    list.push_back({link.name + ".spring_force", Dimension::force});
    list.push_back({link.name + ".spring_force_rate", Dimension::force_rate});
    list.push_back({link.name + ".deflection", Dimension::length});
  });
  for (const Gravity &gravity : gravities)
    list.push_back({gravity.name + ".force", Dimension::force});
  for (const External &external : externals)
    list.push_back({external.name + ".force", Dimension::force});
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
    if (const DriveMotor *motor = drive->motor()) {
      list.push_back({"drive.current", Dimension::current});
      list.push_back({"drive.target_current", Dimension::current});
      if (motor->rated_current) list.push_back({"drive.mean_current", Dimension::current});
    }
    if (const auto *velocity = std::get_if<VelocityDrive>(&drive->type);
        velocity != nullptr && velocity->integral_time)
      list.push_back({"drive.integral", Dimension::current});
    if (std::holds_alternative<StepperDrive>(drive->type))
      list.push_back({"drive.load_angle", Dimension::length});
  }
  return list;
}

std::vector<std::string> Model::point_names() const {
  std::vector<std::string> names;
  for (const Body &body : bodies) names.push_back(body.name);
  for (const Structure &structure : structures)
    names.insert(names.end(), structure.ports.begin(), structure.ports.end());
  return names;
}

int Model::point_index(std::string_view name) const {
  const int index = find_point(point_names(), name);
  if (index == kGround) throw std::invalid_argument("no body named " + std::string(name));
  return index;
}

struct ModelFile::Content {
  Source source;  // the model file with the parameter values that it gives, without overrides
  std::shared_ptr<const toml::table> table;
  std::string title, shows;
};

ModelFile::ModelFile(const std::filesystem::path &path) {
  auto content = std::make_unique<Content>();
  Source &source = content->source;
  source.file = path.string();
  content->table = shared_toml(source.file);
  const toml::table &table = *content->table;
  if (table.contains("model") && !table.contains("body"))
    source.fail("model", "expected a model, got an experiment or measurement of " +
                             in_quotes(table["model"].value_or(std::string())) +
                             "; give the name of that model file");
  Section root(source, table, "", kModelFormat);
  content->title = root.optional_text("title", "a text").value_or("");
  content->shows = root.optional_text("shows", "a text").value_or("");
  if (const auto shared = root.optional_text("parameters_file", "a file name"))
    source.parameters = read_shared_parameters(source, *shared);
  for (Parameter &own : read_parameters(source, root.find("parameters"))) {
    if (Parameter *const found = source.find(own.name); found != nullptr)
      *found = std::move(own);
    else
      source.parameters.push_back(std::move(own));
  }
  content_ = std::move(content);
}

ModelFile::ModelFile(ModelFile &&) noexcept = default;
ModelFile::~ModelFile() = default;

Model ModelFile::model(std::span<const Override> overrides,
                       const std::string &overrides_file) const {
  Source source = content_->source;
  Overriding(source, overrides_file).apply(overrides);
  compute_expressions(source, overrides_file);
  Section root(source, *content_->table, "", kModelFormat);
  Model model;
  model.file = source.file;
  model.title = content_->title;
  model.shows = content_->shows;
  read_elements(root, model);
  root.finish();
  check_connected(model);
  check_frictions(model);
  use_expressions(source);
  check_used(source);
  model.parameters = std::move(source.parameters);
  return model;
}

Model load_model(const std::filesystem::path &path, std::span<const Override> overrides,
                 const std::string &overrides_file) {
  return ModelFile(path).model(overrides, overrides_file);
}

}  // namespace forceaxis::sim
