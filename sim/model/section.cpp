#include "sim/model/section.hpp"

#include <toml++/toml.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>

namespace forceaxis::sim {
namespace {

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

std::vector<std::string> body_names(const std::vector<Body> &bodies, bool ground_allowed) {
  std::vector<std::string> names;
  for (const Body &body : bodies) names.push_back(body.name);
  if (ground_allowed) names.emplace_back("ground");
  return names;
}

}  // namespace

std::string one_line(std::string_view text) {
  std::string line(text);
  for (char &c : line) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x20 || byte == 0x7f) c = ' ';
  }
  return line;
}

std::string in_quotes(std::string_view text) { return '"' + one_line(text) + '"'; }

std::string number_text(double value) {
  char text[40];
  const auto end = std::to_chars(text, text + sizeof text, value).ptr;
  return std::string(text, end);
}

std::string joined(const std::vector<std::string> &names) {
  std::string text;
  for (const std::string &name : names) {
    if (!text.empty()) text += ", ";
    text += name;
  }
  return text.empty() ? std::string("(none)") : text;
}

std::string suggestion(std::string_view wrong, const std::vector<std::string> &known) {
  std::size_t best = 3;
  std::string text;
  for (const std::string &name : known) {
    if (wrong.size() > 64 || name.size() < 2) continue;
    const std::size_t distance = edit_distance(wrong, name);
    if (distance < best) {
      best = distance;
      text = "; did you mean " + name + "?";
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

int find_body(const std::vector<Body> &bodies, std::string_view name) {
  for (std::size_t i = 0; i < bodies.size(); ++i)
    if (bodies[i].name == name) return static_cast<int>(i);
  return kGround;
}

Parameter *Source::find(std::string_view name) {
  const auto found = std::find_if(parameters.begin(), parameters.end(),
                                  [&](const Parameter &p) { return p.name == name; });
  return found == parameters.end() ? nullptr : &*found;
}

std::vector<std::string> Source::parameter_names() const {
  std::vector<std::string> names;
  for (const Parameter &parameter : parameters) names.push_back(parameter.name);
  return names;
}

std::string Section::key_path(std::string_view key) const {
  return path_.empty() ? std::string(key) : path_ + "." + std::string(key);
}

void Section::fail(std::string_view key, const std::string &message) const {
  source_.fail(key_path(key), message);
}

const toml::node *Section::find(std::string_view key) {
  known_.emplace_back(key);
  return table_.get(key);
}

const toml::node &Section::require(std::string_view key, std::string_view expected) {
  const toml::node *node = find(key);
  if (node == nullptr)
    fail(key, "expected " + std::string(expected) + ", got nothing; add this key");
  return *node;
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

double Section::resolve(const std::string &key, const toml::node &node, Dimension dimension,
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
    Parameter *const found = source_.find(name);
    if (found == nullptr) {
      const auto names = source_.parameter_names();
      source_.fail(key, "expected " + wanted + " or a parameter out of " + joined(names) +
                            ", got " + in_quotes(node.ref<std::string>()) +
                            suggestion(name, names) + "; define the parameter or correct its name");
    }
    found->used = true;
    if (dimension_of(found->unit) != dimension)
      source_.fail(key, "expected a parameter in " + std::string(unit_of(dimension)) + ", got " +
                            found->name + " in " + found->unit + "; correct parameters." +
                            found->name + ".unit or refer to another parameter");
    value = negated ? -found->value : found->value;
    origin = " (parameter " + found->name + ")";
  } else {
    source_.fail(key, "expected " + wanted + " or a parameter's name, got " + kind_of(node) +
                          "; give a number or a string");
  }
  if (!sign_holds(sign, value))
    source_.fail(key, "expected " + wanted + ", got " + number_text(value) + origin +
                          "; correct the value or its sign");
  const double size = std::fabs(value);
  if (size > kLargest || (size != 0.0 && size < kSmallest))
    source_.fail(key, "expected a size between 1e-30 and 1e30, got " + number_text(value) + origin +
                          "; check the exponent");
  return value;
}

double Section::value(std::string_view key, Dimension dimension, Sign sign) {
  const std::string expected =
      std::string(sign_text(sign)) + " in " + std::string(unit_of(dimension)) + " or a parameter";
  return resolve(key_path(key), require(key, expected), dimension, sign);
}

std::optional<double> Section::optional_value(std::string_view key, Dimension dimension,
                                              Sign sign) {
  const toml::node *node = find(key);
  if (node == nullptr) return std::nullopt;
  return resolve(key_path(key), *node, dimension, sign);
}

std::vector<double> Section::list(std::string_view key, Dimension dimension, Sign sign) {
  std::vector<double> found;
  const toml::node *node = find(key);
  if (node == nullptr) return found;
  const toml::array *array = node->as_array();
  if (array == nullptr) return {resolve(key_path(key), *node, dimension, sign)};
  for (std::size_t i = 0; i < array->size(); ++i)
    found.push_back(
        resolve(key_path(key) + "[" + std::to_string(i) + "]", *array->get(i), dimension, sign));
  if (found.empty()) fail(key, "expected at least one value, got an empty list; add values");
  return found;
}

std::vector<double> Section::values(std::string_view key, Dimension dimension, Sign sign) {
  std::vector<double> found = list(key, dimension, sign);
  if (found.empty()) (void)value(key, dimension, sign);  // says that it is missing
  return found;
}

std::vector<double> Section::rising(std::string_view key, Dimension dimension) {
  std::vector<double> breaks = list(key, dimension, Sign::any);
  for (std::size_t i = 1; i < breaks.size(); ++i)
    if (!(breaks[i] > breaks[i - 1]))
      fail(std::string(key) + "[" + std::to_string(i) + "]",
           "expected more than the value before, " + number_text(breaks[i - 1]) + ", got " +
               number_text(breaks[i]) + "; put them in rising order");
  return breaks;
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

void Section::child(const toml::node &node, const std::string &path,
                    const std::function<void(Section &)> &visit) const {
  const toml::table *table = node.as_table();
  if (table == nullptr)
    source_.fail(path, "expected a table, got " + kind_of(node) + "; write [" + path + "]");
  Section section(source_, *table, path);
  visit(section);
  section.finish();
}

void Section::one(std::string_view key, const std::function<void(Section &)> &visit) {
  if (const toml::node *node = find(key); node != nullptr) child(*node, key_path(key), visit);
}

void Section::each(std::string_view key, const std::function<void(Section &)> &visit) {
  const toml::node *node = find(key);
  if (node == nullptr) return;
  const toml::array *tables = node->as_array();
  if (tables == nullptr)
    fail(key, "expected a list of tables, got " + kind_of(*node) + "; write [[" + std::string(key) +
                  "]]");
  for (std::size_t i = 0; i < tables->size(); ++i)
    child(*tables->get(i), key_path(key) + "[" + std::to_string(i) + "]", visit);
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

}  // namespace forceaxis::sim
