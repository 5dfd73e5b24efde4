#include "sim/model/model.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <set>
#include <utility>

namespace forceaxis::sim {
namespace {

struct Spelling {
  Dimension dimension;
  std::string_view unit;
};

// The first line of a dimension is its canonical spelling. The list in the header repeats this.
constexpr Spelling kSpellings[] = {
    {Dimension::ratio, "1"},
    {Dimension::ratio, "V/V"},
    {Dimension::count, "count"},
    {Dimension::mass, "kg"},
    {Dimension::length, "m"},
    {Dimension::time, "s"},
    {Dimension::velocity, "m/s"},
    {Dimension::force, "N"},
    {Dimension::impulse, "N s"},
    {Dimension::impulse, "N*s"},
    {Dimension::impulse, "kg m/s"},
    {Dimension::stiffness, "N/m"},
    {Dimension::damping, "N s/m"},
    {Dimension::damping, "N*s/m"},
    {Dimension::damping, "kg/s"},
    {Dimension::voltage, "V"},
    {Dimension::current, "A"},
    {Dimension::resistance, "ohm"},
    {Dimension::inductance, "H"},
    {Dimension::volt_per_amp, "V/A"},
    {Dimension::torque_constant, "N m/A"},
    {Dimension::torque_constant, "N*m/A"},
    {Dimension::speed_constant, "V s/rad"},
    {Dimension::speed_constant, "V*s/rad"},
    {Dimension::transmission, "m/rad"},
    {Dimension::rate, "rad/s"},
    {Dimension::rate, "1/s"},
    {Dimension::rotary_damping, "N m s/rad"},
    {Dimension::rotary_damping, "N*m*s/rad"},
    {Dimension::inertia, "kg m^2"},
    {Dimension::inertia, "kg*m^2"},
    {Dimension::force_per_volt, "N/V"},
    {Dimension::velocity_per_volt, "m/s/V"},
    {Dimension::velocity_per_volt, "m/(s V)"},
    {Dimension::count_per_length, "count/m"},
    {Dimension::acceleration, "m/s^2"},
    {Dimension::force_rate, "N/s"},
    {Dimension::force_per_count, "N/count"},
    {Dimension::current_per_count, "A/count"},
    {Dimension::voltage_per_count, "V/count"},
    {Dimension::length_per_count, "m/count"},
    {Dimension::velocity_per_count, "m/s/count"},
    {Dimension::acceleration_per_count, "m/s^2/count"},
    {Dimension::force_rate_per_count, "N/s/count"},
};

// A quoted TOML key or a file name may hold control characters; an error stays one line.
std::string one_line(std::string_view text) {
  std::string line(text);
  for (char &c : line) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x20 || byte == 0x7f) c = ' ';
  }
  return line;
}

std::string in_quotes(std::string_view text) { return "\"" + one_line(text) + "\""; }

std::string number_text(double value) {
  char text[40];
  const auto end = std::to_chars(text, text + sizeof text, value).ptr;
  return std::string(text, end);
}

template <class Range>
std::string joined(const Range &names) {
  std::string text;
  for (const auto &name : names) {
    if (!text.empty()) text += ", ";
    text += name;
  }
  return text.empty() ? std::string("(none)") : text;
}

// Number of single-character edits between two names, to suggest what was meant.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t up = row[j];
      row[j] = std::min({up + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0U : 1U)});
      diagonal = up;
    }
  }
  return row[b.size()];
}

template <class Range>
std::string suggestion(std::string_view wrong, const Range &known) {
  std::size_t best = 3;
  std::string text;
  for (const auto &candidate : known) {
    const std::string_view name(candidate);
    if (wrong.size() > 64 || name.size() < 2) continue;
    const std::size_t distance = edit_distance(wrong, name);
    if (distance < best) {
      best = distance;
      text = "; did you mean " + std::string(name) + "?";
    }
  }
  return text;
}

std::string kind_of(const toml::node &node) {
  switch (node.type()) {
    case toml::node_type::table:
      return "a table";
    case toml::node_type::array:
      return "an array";
    case toml::node_type::string:
      return in_quotes(node.ref<std::string>());
    case toml::node_type::integer:
      return std::to_string(node.ref<int64_t>());
    case toml::node_type::floating_point:
      return number_text(node.ref<double>());
    case toml::node_type::boolean:
      return node.ref<bool>() ? "true" : "false";
    default:
      return "a date or time";
  }
}

bool is_identifier(std::string_view name) {
  if (name.empty() || name.size() > 64) return false;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const char c = name[i];
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
    const bool digit = c >= '0' && c <= '9';
    if (!(letter || (digit && i > 0))) return false;
  }
  return true;
}

// What a value may be.
enum class Sign { any, not_zero, not_negative, positive };

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

bool sign_holds(Sign sign, double value) {
  if (!std::isfinite(value)) return false;
  switch (sign) {
    case Sign::not_zero:
      return value != 0.0;
    case Sign::not_negative:
      return value >= 0.0;
    case Sign::positive:
      return value > 0.0;
    default:
      return true;
  }
}

// Beyond these a double product in the dynamics may overflow or vanish.
constexpr double kLargest = 1e30;
constexpr double kSmallest = 1e-30;

class Loader;

// One table of the file: hands out its keys and in the end refuses those nobody asked for.
class Section {
 public:
  Section(Loader &loader, const toml::table &table, std::string path)
      : loader_(loader), table_(table), path_(std::move(path)) {}

  const std::string &path() const { return path_; }
  std::string key_path(std::string_view key) const {
    return path_.empty() ? std::string(key) : path_ + "." + std::string(key);
  }
  const toml::node *find(std::string_view key) {
    known_.emplace_back(key);
    return table_.get(key);
  }
  const toml::node &require(std::string_view key, std::string_view expected);

  std::string text(std::string_view key, std::string_view expected);
  std::optional<std::string> optional_text(std::string_view key, std::string_view expected);
  std::string name();
  double value(std::string_view key, Dimension dimension, Sign sign);
  std::optional<double> optional_value(std::string_view key, Dimension dimension, Sign sign);
  double value_or(std::string_view key, Dimension dimension, Sign sign, double fallback) {
    return optional_value(key, dimension, sign).value_or(fallback);
  }
  // A number, or a list of them. Empty if the key is absent.
  std::vector<double> values(std::string_view key, Dimension dimension, Sign sign);
  std::vector<double> rising(std::string_view key, Dimension dimension);
  int integer(std::string_view key, int low, int high, std::optional<int> fallback);
  int body(std::string_view key, const std::vector<Body> &bodies, bool ground_allowed,
           std::optional<int> fallback);
  Ends between(const std::vector<Body> &bodies);
  // Every key has been asked for by now; what is left is not known.
  void finish() const;
  [[noreturn]] void fail(std::string_view key, const std::string &message) const;

 private:
  Loader &loader_;
  const toml::table &table_;
  std::string path_;
  std::vector<std::string> known_;
};

class Loader {
 public:
  explicit Loader(const std::filesystem::path &path) : file_(path.string()) {}

  Model load(std::span<const Override> overrides);
  [[noreturn]] void fail(const std::string &key, const std::string &message) const {
    throw InputError(file_, key, message);
  }
  double resolve(const std::string &key, const toml::node &node, Dimension dimension, Sign sign);

 private:
  static toml::table parse(const std::string &file);
  std::vector<Parameter> read_parameters(const toml::node *node);
  void read_shared_parameters(const std::string &name);
  void apply(std::span<const Override> overrides);
  Section element(const toml::node &node, const std::string &path);
  template <class Visit>
  void each(Section &root, const char *key, Visit visit);
  std::string claim_name(Section &section);
  Slopes slopes(Section &section, const char *key, Dimension dimension, Dimension over);
  void read_links(Section &root);
  void read_gravities(Section &root);
  void read_drive(Section &root);
  void read_sensors(Section &root);
  void check_connected() const;
  void check_frictions() const;
  void check_used() const;

  std::string file_;
  Model model_;
  std::set<std::string> names_;
};

const toml::node &Section::require(std::string_view key, std::string_view expected) {
  const toml::node *node = find(key);
  if (node == nullptr)
    fail(key, "expected " + std::string(expected) + ", got nothing; add this key");
  return *node;
}

void Section::fail(std::string_view key, const std::string &message) const {
  loader_.fail(key_path(key), message);
}

std::string Section::text(std::string_view key, std::string_view expected) {
  const toml::node &node = require(key, expected);
  if (!node.is_string())
    fail(key, "expected " + std::string(expected) + ", got " + kind_of(node) + "; give a string");
  return node.ref<std::string>();
}

std::optional<std::string> Section::optional_text(std::string_view key, std::string_view expected) {
  if (table_.get(key) == nullptr) {
    known_.emplace_back(key);
    return std::nullopt;
  }
  return text(key, expected);
}

std::string Section::name() {
  const std::string expected = "a name of letters, digits and _ that begins with a letter or _";
  std::string text_value = text("name", expected);
  if (!is_identifier(text_value))
    fail("name", "expected " + expected + " (at most 64), got " + in_quotes(text_value) +
                     "; rename this element");
  if (text_value == "ground" || text_value == "drive")
    fail("name", "expected a name other than the reserved ground and drive, got " +
                     in_quotes(text_value) + "; rename this element");
  return text_value;
}

double Section::value(std::string_view key, Dimension dimension, Sign sign) {
  const std::string expected =
      std::string(sign_text(sign)) + " in " + std::string(unit_of(dimension)) + " or a parameter";
  return loader_.resolve(key_path(key), require(key, expected), dimension, sign);
}

std::optional<double> Section::optional_value(std::string_view key, Dimension dimension,
                                              Sign sign) {
  const toml::node *node = find(key);
  if (node == nullptr) return std::nullopt;
  return loader_.resolve(key_path(key), *node, dimension, sign);
}

std::vector<double> Section::values(std::string_view key, Dimension dimension, Sign sign) {
  std::vector<double> list;
  const toml::node *node = find(key);
  if (node == nullptr) return list;
  const toml::array *array = node->as_array();
  if (array == nullptr) return {loader_.resolve(key_path(key), *node, dimension, sign)};
  for (std::size_t i = 0; i < array->size(); ++i)
    list.push_back(loader_.resolve(key_path(key) + "[" + std::to_string(i) + "]", *array->get(i),
                                   dimension, sign));
  if (list.empty()) fail(key, "expected at least one value, got an empty list; add values");
  return list;
}

std::vector<double> Section::rising(std::string_view key, Dimension dimension) {
  std::vector<double> list = values(key, dimension, Sign::any);
  for (std::size_t i = 1; i < list.size(); ++i)
    if (!(list[i] > list[i - 1]))
      fail(std::string(key) + "[" + std::to_string(i) + "]",
           "expected more than the value before, " + number_text(list[i - 1]) + ", got " +
               number_text(list[i]) + "; put them in rising order");
  return list;
}

int Section::integer(std::string_view key, int low, int high, std::optional<int> fallback) {
  const toml::node *node = find(key);
  const std::string expected =
      "expected an integer " + std::to_string(low) + ".." + std::to_string(high) + ", got ";
  if (node == nullptr) {
    if (fallback) return *fallback;
    fail(key, expected + "nothing; add this key");
  }
  if (!node->is_integer()) fail(key, expected + kind_of(*node) + "; give an integer");
  const int64_t number = node->ref<int64_t>();
  if (number < low || number > high)
    fail(key, expected + std::to_string(number) + "; choose a value in that range");
  return static_cast<int>(number);
}

int find_body(const std::vector<Body> &bodies, std::string_view name) {
  for (std::size_t i = 0; i < bodies.size(); ++i)
    if (bodies[i].name == name) return static_cast<int>(i);
  return kGround;
}

std::vector<std::string> body_names(const std::vector<Body> &bodies, bool ground_allowed) {
  std::vector<std::string> names;
  for (const Body &body : bodies) names.push_back(body.name);
  if (ground_allowed) names.emplace_back("ground");
  return names;
}

int Section::body(std::string_view key, const std::vector<Body> &bodies, bool ground_allowed,
                  std::optional<int> fallback) {
  if (fallback && table_.get(key) == nullptr) {
    known_.emplace_back(key);
    return *fallback;
  }
  const auto names = body_names(bodies, ground_allowed);
  const std::string expected = "one of " + joined(names);
  const std::string wanted = text(key, expected);
  if (ground_allowed && wanted == "ground") return kGround;
  const int index = find_body(bodies, wanted);
  if (index == kGround)
    fail(key, "expected " + expected + ", got " + in_quotes(wanted) + suggestion(wanted, names) +
                  "; name a body of this file");
  return index;
}

Ends Section::between(const std::vector<Body> &bodies) {
  const auto names = body_names(bodies, true);
  const std::string expected = "two different names out of " + joined(names);
  const toml::node &node = require("between", expected);
  const toml::array *pair = node.as_array();
  if (pair == nullptr || pair->size() != 2)
    fail("between",
         "expected " + expected + ", got " +
             (pair == nullptr ? kind_of(node) : std::to_string(pair->size()) + " entries") +
             "; write [\"a\", \"b\"]");
  int found[2];
  for (std::size_t i = 0; i < 2; ++i) {
    const std::string entry = "between[" + std::to_string(i) + "]";
    const toml::node &end = *pair->get(i);
    if (!end.is_string())
      fail(entry,
           "expected one of " + joined(names) + ", got " + kind_of(end) + "; give a body's name");
    const std::string &wanted = end.ref<std::string>();
    found[i] = wanted == "ground" ? kGround : find_body(bodies, wanted);
    if (found[i] == kGround && wanted != "ground")
      fail(entry, "expected one of " + joined(names) + ", got " + in_quotes(wanted) +
                      suggestion(wanted, names) + "; name a body of this file");
  }
  if (found[0] == found[1])
    fail("between", "expected " + expected + ", got the same name twice; connect two bodies");
  return {found[0], found[1]};
}

void Section::finish() const {
  for (const auto &[key, node] : table_) {
    const std::string_view name = key.str();
    if (std::find(known_.begin(), known_.end(), name) == known_.end())
      fail(one_line(name), "expected one of the keys " + joined(known_) + ", got " +
                               in_quotes(name) + suggestion(name, known_) +
                               "; remove or rename this key");
  }
}

// ---------------------------------------------------------------------------------------------

toml::table Loader::parse(const std::string &file) {
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

std::vector<Parameter> Loader::read_parameters(const toml::node *node) {
  std::vector<Parameter> parameters;
  if (node == nullptr) return parameters;
  const toml::table *table = node->as_table();
  if (table == nullptr)
    fail("parameters",
         "expected a table of parameters, got " + kind_of(*node) + "; write [parameters]");
  for (const auto &[key, entry] : *table) {
    const std::string path = "parameters." + one_line(key.str());
    if (!is_identifier(key.str()))
      fail(path, "expected a name of letters, digits and _ that begins with a letter or _, got " +
                     in_quotes(key.str()) + "; rename this parameter");
    const toml::table *fields = entry.as_table();
    if (fields == nullptr)
      fail(path, "expected a table { value, unit, source }, got " + kind_of(entry) +
                     "; write { value = ..., unit = \"...\", source = \"...\" }");
    Section section(*this, *fields, path);
    Parameter parameter;
    parameter.name = key.str();
    parameter.file = file_;
    const toml::node &value = section.require("value", "a finite number");
    if (!value.is_number() ||
        !std::isfinite(value.value<double>().value_or(std::numeric_limits<double>::quiet_NaN())))
      section.fail("value", "expected a finite number, got " + kind_of(value) +
                                "; give the parameter's value");
    parameter.value = *value.value<double>();
    parameter.unit = section.text("unit", "a unit such as \"kg\" or \"N s/m\"");
    if (!dimension_of(parameter.unit)) {
      std::vector<std::string> units;
      for (const Spelling &spelling : kSpellings) units.emplace_back(spelling.unit);
      section.fail("unit", "expected one of " + joined(units) + ", got " +
                               in_quotes(parameter.unit) + "; use one of these spellings");
    }
    parameter.source = section.optional_text("source", "a text").value_or("");
    section.finish();
    parameters.push_back(std::move(parameter));
  }
  return parameters;
}

void Loader::read_shared_parameters(const std::string &name) {
  const std::filesystem::path shared = std::filesystem::path(file_).parent_path() / name;
  std::error_code status;
  if (name.empty() || !std::filesystem::is_regular_file(shared, status))
    fail("parameters_file",
         "expected a readable file beside this one, got " + in_quotes(name) + "; check the path");
  Loader other(shared);
  const toml::table table = parse(other.file_);
  Section section(other, table, "");
  (void)section.optional_text("title", "a text");
  (void)section.optional_text("shows", "a text");
  model_.parameters = other.read_parameters(section.find("parameters"));
  section.finish();
}

void Loader::apply(std::span<const Override> overrides) {
  for (const Override &change : overrides) {
    const auto found = std::find_if(model_.parameters.begin(), model_.parameters.end(),
                                    [&](const Parameter &p) { return p.name == change.parameter; });
    const std::string key = "parameters." + one_line(change.parameter);
    if (found == model_.parameters.end()) {
      std::vector<std::string> names;
      for (const Parameter &parameter : model_.parameters) names.push_back(parameter.name);
      fail(key, "expected one of the parameters " + joined(names) + ", got " +
                    in_quotes(change.parameter) + suggestion(change.parameter, names) +
                    "; correct the override's name");
    }
    if (!std::isfinite(change.value))
      fail(key + ".value", "expected a finite number, got " + number_text(change.value) +
                               "; correct the override's value");
    found->value = change.value;
    found->overridden = true;
  }
}

double Loader::resolve(const std::string &key, const toml::node &node, Dimension dimension,
                       Sign sign) {
  const std::string wanted =
      std::string(sign_text(sign)) + " in " + std::string(unit_of(dimension));
  double value = 0.0;
  std::string origin;
  if (node.is_number()) {
    value = *node.value<double>();
  } else if (node.is_string()) {
    std::string_view name = node.ref<std::string>();
    const bool negated = !name.empty() && name.front() == '-';
    if (negated) name.remove_prefix(1);
    const auto found = std::find_if(model_.parameters.begin(), model_.parameters.end(),
                                    [&](const Parameter &p) { return p.name == name; });
    if (found == model_.parameters.end()) {
      std::vector<std::string> names;
      for (const Parameter &parameter : model_.parameters) names.push_back(parameter.name);
      fail(key, "expected " + wanted + " or a parameter out of " + joined(names) + ", got " +
                    in_quotes(node.ref<std::string>()) + suggestion(name, names) +
                    "; define the parameter or correct its name");
    }
    found->used = true;
    if (dimension_of(found->unit) != dimension)
      fail(key, "expected a parameter in " + std::string(unit_of(dimension)) + ", got " +
                    found->name + " in " + found->unit + "; correct parameters." + found->name +
                    ".unit or refer to another parameter");
    value = negated ? -found->value : found->value;
    origin = " (parameter " + found->name + ")";
  } else {
    fail(key, "expected " + wanted + " or a parameter's name, got " + kind_of(node) +
                  "; give a number or a string");
  }
  if (!sign_holds(sign, value))
    fail(key, "expected " + wanted + ", got " + number_text(value) + origin +
                  "; correct the value or its sign");
  const double size = std::fabs(value);
  if (size > kLargest || (size != 0.0 && size < kSmallest))
    fail(key, "expected a size between 1e-30 and 1e30, got " + number_text(value) + origin +
                  "; check the exponent");
  return value;
}

Section Loader::element(const toml::node &node, const std::string &path) {
  const toml::table *table = node.as_table();
  if (table == nullptr)
    fail(path, "expected a table, got " + kind_of(node) + "; write [" + path + "]");
  return Section(*this, *table, path);
}

template <class Visit>
void Loader::each(Section &root, const char *key, Visit visit) {
  const toml::node *node = root.find(key);
  if (node == nullptr) return;
  const toml::array *list = node->as_array();
  if (list == nullptr)
    fail(key, std::string("expected a list of tables, got ") + kind_of(*node) + "; write [[" + key +
                  "]]");
  for (std::size_t i = 0; i < list->size(); ++i) {
    Section section = element(*list->get(i), std::string(key) + "[" + std::to_string(i) + "]");
    visit(section);
    section.finish();
  }
}

std::string Loader::claim_name(Section &section) {
  std::string name = section.name();
  if (!names_.insert(name).second)
    section.fail("name", "expected a name that no other element has, got " + in_quotes(name) +
                             " again; rename one of them");
  return name;
}

// A slope, or several with the breaks between them: values of the argument or, for springs, of the
// curve (`loads`).
Slopes Loader::slopes(Section &section, const char *key, Dimension dimension, Dimension over) {
  Slopes curve;
  curve.slopes = section.values(key, dimension, Sign::not_negative);
  if (curve.slopes.empty()) (void)section.value(key, dimension, Sign::not_negative);  // says so
  const bool loadable = dimension == Dimension::stiffness;
  const bool by_load = loadable && section.find("loads") != nullptr;
  curve.breaks = section.rising("breaks", over);
  if (by_load) {
    if (!curve.breaks.empty())
      section.fail("loads", "expected breaks or loads, got both; remove one of them");
    curve.breaks = section.rising("loads", Dimension::force);
  }
  if (curve.breaks.size() + 1 != curve.slopes.size())
    section.fail(by_load                ? "loads"
                 : curve.breaks.empty() ? key
                                        : "breaks",
                 "expected one value fewer in " +
                     std::string(loadable ? "breaks or loads" : "breaks") + " than in " + key +
                     ", got " + std::to_string(curve.breaks.size()) + " and " +
                     std::to_string(curve.slopes.size()) + "; add or remove values");
  if (!by_load) return curve;

  // The deflection at a load: every slope's share of the way there from 0.
  const std::vector<double> loads = curve.breaks;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (double &at : curve.breaks) {
    const double low = std::min(at, 0.0);
    const double high = std::max(at, 0.0);
    double way = 0.0;
    for (std::size_t k = 0; k < curve.slopes.size(); ++k) {
      const double from = std::max(low, k == 0 ? -kInfinity : loads[k - 1]);
      const double to = std::min(high, k == loads.size() ? kInfinity : loads[k]);
      if (!(curve.slopes[k] > 0.0))
        section.fail(key, "expected values > 0 beside loads, got " + number_text(curve.slopes[k]) +
                              "; a spring without stiffness reaches no load");
      if (to > from) way += (to - from) / curve.slopes[k];
    }
    at = at < 0.0 ? -way : way;
  }
  return curve;
}

void Loader::read_links(Section &root) {
  const auto ends = [this](Section &section) { return section.between(model_.bodies); };
  each(root, "spring", [&](Section &section) {
    Spring spring;
    spring.name = claim_name(section);
    spring.ends = ends(section);
    spring.stiffness = slopes(section, "stiffness", Dimension::stiffness, Dimension::length);
    spring.damping = section.value_or("damping", Dimension::damping, Sign::not_negative, 0.0);
    model_.springs.push_back(std::move(spring));
  });
  each(root, "damper", [&](Section &section) {
    Damper damper;
    damper.name = claim_name(section);
    damper.ends = ends(section);
    damper.damping = slopes(section, "damping", Dimension::damping, Dimension::velocity);
    model_.dampers.push_back(std::move(damper));
  });
  each(root, "contact", [&](Section &section) {
    Contact contact;
    contact.name = claim_name(section);
    contact.ends = ends(section);
    contact.stiffness = section.value("stiffness", Dimension::stiffness, Sign::positive);
    contact.damping = section.value_or("damping", Dimension::damping, Sign::not_negative, 0.0);
    contact.gap = section.value_or("gap", Dimension::length, Sign::any, 0.0);
    model_.contacts.push_back(std::move(contact));
  });
  const auto read_stop = [&](Section &section) {
    Stop stop;
    stop.name = claim_name(section);
    stop.ends = ends(section);
    stop.stiffness = section.value("stiffness", Dimension::stiffness, Sign::positive);
    stop.damping = section.value_or("damping", Dimension::damping, Sign::not_negative, 0.0);
    return stop;
  };
  each(root, "backlash", [&](Section &section) {
    Stop backlash = read_stop(section);
    const double width = section.value("width", Dimension::length, Sign::not_negative);
    backlash.low = -0.5 * width;
    backlash.high = 0.5 * width;
    model_.stops.push_back(std::move(backlash));
  });
  each(root, "stop", [&](Section &section) {
    Stop stop = read_stop(section);
    stop.low = section.optional_value("low", Dimension::length, Sign::any);
    stop.high = section.optional_value("high", Dimension::length, Sign::any);
    if (!stop.low && !stop.high)
      section.fail("low", "expected low or high or both in m, got neither; add one of these keys");
    if (stop.low && stop.high && !(*stop.low < *stop.high))
      section.fail("high", "expected more than low, " + number_text(*stop.low) + ", got " +
                               number_text(*stop.high) + "; exchange or correct them");
    model_.stops.push_back(std::move(stop));
  });
  each(root, "friction", [&](Section &section) {
    Friction friction;
    friction.name = claim_name(section);
    friction.ends = ends(section);
    friction.coulomb = section.value("coulomb", Dimension::force, Sign::not_negative);
    friction.stiction =
        section.value_or("stiction", Dimension::force, Sign::not_negative, friction.coulomb);
    if (friction.stiction < friction.coulomb)
      section.fail("stiction", "expected at least coulomb, " + number_text(friction.coulomb) +
                                   ", got " + number_text(friction.stiction) +
                                   "; friction at rest is never less than sliding");
    model_.frictions.push_back(std::move(friction));
  });
}

void Loader::read_gravities(Section &root) {
  each(root, "gravity", [&](Section &section) {
    Gravity gravity;
    gravity.name = claim_name(section);
    gravity.body = section.body("body", model_.bodies, false, std::nullopt);
    gravity.accelerations = section.values("acceleration", Dimension::acceleration, Sign::any);
    if (gravity.accelerations.empty())
      (void)section.value("acceleration", Dimension::acceleration, Sign::any);  // says so
    gravity.positions = section.rising("positions", Dimension::length);
    const std::size_t wanted = gravity.accelerations.size() == 1 ? 0 : gravity.accelerations.size();
    if (gravity.positions.size() != wanted)
      section.fail("positions", "expected " + std::to_string(wanted) +
                                    " values, one for each of a list in acceleration, got " +
                                    std::to_string(gravity.positions.size()) +
                                    "; add or remove values");
    model_.gravities.push_back(std::move(gravity));
  });
}

void Loader::read_drive(Section &root) {
  const toml::node *node = root.find("drive");
  if (node == nullptr) return;
  Section section = element(*node, "drive");
  Drive drive;
  const std::string kinds = "one of dc_motor, first_order, perfect";
  const std::string type = section.text("type", kinds);
  drive.body = section.body("body", model_.bodies, false, std::nullopt);
  drive.reaction = section.body("reaction", model_.bodies, true, kGround);
  if (drive.body == drive.reaction)
    section.fail("reaction",
                 "expected another body than drive.body or ground, got " +
                     in_quotes(model_.bodies[static_cast<std::size_t>(drive.body)].name) +
                     "; choose what the drive pushes against");
  if (type == "dc_motor") {
    DcMotor motor;
    const std::string inputs = "one of command, tach";
    const std::string input = section.optional_text("input", inputs).value_or("command");
    if (input != "command" && input != "tach")
      section.fail("input", "expected " + inputs + ", got " + in_quotes(input) +
                                "; choose where the DAC's volts go");
    motor.input_tach = input == "tach";
    motor.k_preamp_cmd = section.value("k_preamp_cmd", Dimension::ratio, Sign::not_zero);
    motor.k_preamp_fdbk = section.value("k_preamp_fdbk", Dimension::ratio, Sign::not_negative);
    motor.a_preamp_fdbk = section.value("a_preamp_fdbk", Dimension::rate, Sign::positive);
    motor.k_tach = section.value("k_tach", Dimension::speed_constant, Sign::not_negative);
    motor.k_torque = section.value("k_torque", Dimension::torque_constant, Sign::positive);
    motor.k_back_emf = section.value("k_back_emf", Dimension::speed_constant, Sign::not_negative);
    motor.inductance = section.value("L", Dimension::inductance, Sign::positive);
    motor.resistance = section.value("R", Dimension::resistance, Sign::not_negative);
    motor.r_trans = section.value("r_trans", Dimension::transmission, Sign::positive);
    motor.b_m = section.value_or("b_m", Dimension::rotary_damping, Sign::not_negative, 0.0);
    motor.k_current = section.value("k_current", Dimension::volt_per_amp, Sign::not_negative);
    motor.current_feedback_limit =
        section.optional_value("current_feedback_limit", Dimension::voltage, Sign::positive);
    motor.preamp_limit = section.optional_value("preamp_limit", Dimension::voltage, Sign::positive);
    motor.k_amp = section.value("k_amp", Dimension::ratio, Sign::positive);
    motor.amp_break = section.optional_value("amp_break", Dimension::voltage, Sign::positive);
    if (motor.amp_break) {
      motor.k_amp_outer = section.value("k_amp_outer", Dimension::ratio, Sign::not_negative);
    } else if (section.find("k_amp_outer") != nullptr) {
      section.fail("amp_break",
                   "expected a finite number > 0 in V beside k_amp_outer, got nothing; "
                   "add this key or remove k_amp_outer");
    } else {
      motor.k_amp_outer = motor.k_amp;
    }
    motor.supply_limit = section.optional_value("supply_limit", Dimension::voltage, Sign::positive);
    drive.type = motor;
  } else if (type == "first_order") {
    FirstOrderDrive simple;
    simple.k_act = section.value("k_act", Dimension::damping, Sign::positive);
    simple.a_act = section.value("a_act", Dimension::rate, Sign::positive);
    simple.velocity_per_volt =
        section.value("velocity_per_volt", Dimension::velocity_per_volt, Sign::not_zero);
    simple.force_limit = section.optional_value("force_limit", Dimension::force, Sign::positive);
    drive.type = simple;
  } else if (type == "perfect") {
    PerfectDrive perfect;
    perfect.force_per_volt =
        section.value("force_per_volt", Dimension::force_per_volt, Sign::not_zero);
    perfect.force_limit = section.optional_value("force_limit", Dimension::force, Sign::positive);
    drive.type = perfect;
  } else {
    section.fail("type",
                 "expected " + kinds + ", got " + in_quotes(type) + "; choose a drive type");
  }
  section.finish();
  model_.drive = drive;
}

std::optional<Dimension> per_count(Dimension dimension) {
  switch (dimension) {
    case Dimension::force:
      return Dimension::force_per_count;
    case Dimension::current:
      return Dimension::current_per_count;
    case Dimension::voltage:
      return Dimension::voltage_per_count;
    case Dimension::length:
      return Dimension::length_per_count;
    case Dimension::velocity:
      return Dimension::velocity_per_count;
    case Dimension::acceleration:
      return Dimension::acceleration_per_count;
    case Dimension::force_rate:
      return Dimension::force_rate_per_count;
    default:
      return std::nullopt;
  }
}

void Loader::read_sensors(Section &root) {
  if (const toml::node *node = root.find("encoder"); node != nullptr) {
    Section section = element(*node, "encoder");
    Encoder encoder;
    encoder.body = section.body("body", model_.bodies, false, std::nullopt);
    encoder.reference = section.body("reference", model_.bodies, true, kGround);
    if (encoder.body == encoder.reference)
      section.fail("reference",
                   "expected another body than encoder.body or ground, got the same; "
                   "choose what the encoder counts against");
    encoder.scale = section.value("scale", Dimension::count_per_length, Sign::not_zero);
    section.finish();
    model_.encoder = encoder;
  }
  const std::vector<SignalInfo> signals = model_.signal_list();
  each(root, "adc", [&](Section &section) {
    const auto channel = static_cast<std::size_t>(section.integer("channel", 0, 1, std::nullopt));
    if (model_.adc[channel])
      section.fail("channel", "expected a channel not used before, got " + std::to_string(channel) +
                                  " again; there are channels 0 and 1");
    std::vector<std::string> names;
    for (const SignalInfo &signal : signals) names.push_back(signal.name);
    Adc adc;
    adc.signal = section.text("signal", "a signal's name");
    const auto found = std::find(names.begin(), names.end(), adc.signal);
    if (found == names.end())
      section.fail("signal", "expected one of " + joined(names) + ", got " + in_quotes(adc.signal) +
                                 suggestion(adc.signal, names) + "; name a signal of this model");
    const SignalInfo &signal = signals[static_cast<std::size_t>(found - names.begin())];
    const Dimension unit = signal.dimension;
    adc.sensor_limit = section.optional_value("sensor_limit", unit, Sign::positive);
    adc.filter = section.optional_value("filter", Dimension::rate, Sign::positive);
    constexpr double kFastestFilter = 1e6;
    if (adc.filter && *adc.filter > kFastestFilter)
      section.fail("filter", "expected at most 1e6 rad/s, got " + number_text(*adc.filter) +
                                 "; leave out a filter that no tick can tell from none");
    adc.conditioning_limit = section.optional_value("conditioning_limit", unit, Sign::positive);
    adc.noise = section.value_or("noise", unit, Sign::not_negative, 0.0);
    adc.per_count = section.value("per_count", *per_count(unit), Sign::not_zero);
    adc.bits = section.integer("bits", 8, 16, 8);
    const double zero = section.value_or("zero_code", Dimension::count, Sign::any, 0.0);
    const int top = (1 << adc.bits) - 1;
    if (!(zero >= 0.0 && zero <= top && zero == static_cast<int>(zero)))
      section.fail("zero_code", "expected a whole number 0.." + std::to_string(top) + ", got " +
                                    number_text(zero) + "; choose a code of this ADC");
    adc.zero_code = static_cast<int>(zero);
    model_.adc[channel] = adc;
  });
  if (const toml::node *node = root.find("dac"); node != nullptr) {
    Section section = element(*node, "dac");
    model_.dac.bits = section.integer("bits", 8, 16, model_.dac.bits);
    model_.dac.range =
        section.value_or("range", Dimension::voltage, Sign::positive, model_.dac.range);
    model_.dac.offset = section.value_or("offset", Dimension::voltage, Sign::any, 0.0);
    model_.dac.noise = section.value_or("noise", Dimension::voltage, Sign::not_negative, 0.0);
    section.finish();
  }
}

// Follows everything with two ends from ground; what is not reached floats freely.
void Loader::check_connected() const {
  std::vector<Ends> links;
  for (const Spring &spring : model_.springs) links.push_back(spring.ends);
  for (const Damper &damper : model_.dampers) links.push_back(damper.ends);
  for (const Contact &contact : model_.contacts) links.push_back(contact.ends);
  for (const Stop &stop : model_.stops) links.push_back(stop.ends);
  for (const Friction &friction : model_.frictions) links.push_back(friction.ends);
  if (model_.drive) links.push_back({model_.drive->body, model_.drive->reaction});
  std::vector<bool> reached(model_.bodies.size() + 1, false);  // [0] is ground
  reached[0] = true;
  for (bool grown = true; grown;) {
    grown = false;
    for (const Ends &link : links) {
      const auto a = static_cast<std::size_t>(link.a + 1);
      const auto b = static_cast<std::size_t>(link.b + 1);
      if (reached[a] != reached[b]) reached[a] = reached[b] = grown = true;
    }
  }
  for (std::size_t i = 0; i < model_.bodies.size(); ++i)
    if (!reached[i + 1])
      fail("body[" + std::to_string(i) + "].name",
           "expected a body tied to ground by springs, other elements or the drive, got " +
               in_quotes(model_.bodies[i].name) + " disconnected; connect or remove it");
}

// Each friction may stick, and then its ends move as one; a loop would hold them twice over.
void Loader::check_frictions() const {
  std::vector<int> group(model_.bodies.size() + 1);  // [0] is ground
  for (std::size_t i = 0; i < group.size(); ++i) group[i] = static_cast<int>(i);
  for (std::size_t i = 0; i < model_.frictions.size(); ++i) {
    const Friction &friction = model_.frictions[i];
    const int a = group[static_cast<std::size_t>(friction.ends.a + 1)];
    const int b = group[static_cast<std::size_t>(friction.ends.b + 1)];
    if (a == b)
      fail("friction[" + std::to_string(i) + "].between",
           "expected frictions that form no loop, got a second way between the ends of " +
               in_quotes(friction.name) + "; remove one friction of the loop");
    std::replace(group.begin(), group.end(), a, b);
  }
}

void Loader::check_used() const {
  for (const Parameter &parameter : model_.parameters)
    if (!parameter.used && parameter.file == file_)
      fail("parameters." + parameter.name,
           "expected a parameter that this model uses, got one nothing refers to; remove it or use "
           "its name");
}

Model Loader::load(std::span<const Override> overrides) {
  const toml::table table = parse(file_);
  Section root(*this, table, "");
  model_.file = file_;
  model_.title = root.optional_text("title", "a text").value_or("");
  model_.shows = root.optional_text("shows", "a text").value_or("");
  if (const auto shared = root.optional_text("parameters_file", "a file name"))
    read_shared_parameters(*shared);
  for (Parameter &own : read_parameters(root.find("parameters"))) {
    const auto found = std::find_if(model_.parameters.begin(), model_.parameters.end(),
                                    [&](const Parameter &p) { return p.name == own.name; });
    if (found != model_.parameters.end())
      *found = std::move(own);
    else
      model_.parameters.push_back(std::move(own));
  }
  apply(overrides);

  each(root, "body", [&](Section &section) {
    Body body;
    body.name = claim_name(section);
    body.mass = section.value("mass", Dimension::mass, Sign::positive);
    body.position = section.value_or("position", Dimension::length, Sign::any, 0.0);
    body.velocity = section.value_or("velocity", Dimension::velocity, Sign::any, 0.0);
    model_.bodies.push_back(std::move(body));
  });
  constexpr std::size_t kMostBodies = 32;
  if (model_.bodies.empty() || model_.bodies.size() > kMostBodies)
    fail("body", "expected 1.." + std::to_string(kMostBodies) + " bodies, got " +
                     std::to_string(model_.bodies.size()) + "; add or remove [[body]] tables");
  read_links(root);
  read_gravities(root);
  read_drive(root);
  read_sensors(root);
  root.finish();
  check_connected();
  check_frictions();
  check_used();
  return std::move(model_);
}

}  // namespace

InputError::InputError(std::string file_name, std::string key_name, std::string text)
    : std::runtime_error(one_line(file_name) + ": " + one_line(key_name) + ": " + one_line(text)),
      file(one_line(file_name)),
      key(one_line(key_name)),
      message(one_line(text)) {}

std::string_view unit_of(Dimension dimension) {
  for (const Spelling &spelling : kSpellings)
    if (spelling.dimension == dimension) return spelling.unit;
  return "1";
}

std::optional<Dimension> dimension_of(std::string_view unit) {
  for (const Spelling &spelling : kSpellings)
    if (spelling.unit == unit) return spelling.dimension;
  return std::nullopt;
}

std::vector<SignalInfo> Model::signal_list() const {
  std::vector<SignalInfo> list;
  for (const Body &body : bodies) {
    list.push_back({body.name + ".position", Dimension::length});
    list.push_back({body.name + ".velocity", Dimension::velocity});
    list.push_back({body.name + ".acceleration", Dimension::acceleration});
  }
  const auto add_link = [&list](const std::string &name) {
    list.push_back({name + ".force", Dimension::force});
    list.push_back({name + ".spring_force", Dimension::force});
    list.push_back({name + ".spring_force_rate", Dimension::force_rate});
    list.push_back({name + ".deflection", Dimension::length});
  };
  for (const Spring &spring : springs) add_link(spring.name);
  for (const Damper &damper : dampers) add_link(damper.name);
  for (const Contact &contact : contacts) add_link(contact.name);
  for (const Stop &stop : stops) add_link(stop.name);
  for (const Friction &friction : frictions) add_link(friction.name);
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
  return Loader(path).load(overrides);
}

}  // namespace forceaxis::sim
