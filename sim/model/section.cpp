#include "sim/model/section.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <deque>
#include <fstream>
#include <iterator>
#include <memory>
#include <stdexcept>

#include "sim/model/toml.hpp"

namespace forceaxis::sim {
namespace {

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

// Range of the magnitudes of numbers in a file. Outside this range, a product of doubles in the
// equations of motion could overflow or become 0.
constexpr double kLargest = 1e30;
constexpr double kSmallest = 1e-30;

constexpr std::string_view kNameText =
    "a name of letters, digits and _ that begins with a letter or _";

std::vector<std::string> end_names(std::vector<std::string> points, bool ground_allowed) {
  if (ground_allowed) points.emplace_back("ground");
  return points;
}

bool stops(std::string_view text) {
  try {
    (void)toml::parse(text);
  } catch (const TomlParserStopped &) {
    return true;
  } catch (const toml::parse_error &) {
  }
  return false;
}

// Returns the number of the line, counted from 1, at which the parser stops with an assertion. The
// parser does not report the line. This function therefore parses longer and longer parts of the
// text, up to the first part at which the parser stops.
std::size_t line_that_stops(std::string_view text) {
  std::size_t line = 1;
  for (std::size_t end = text.find('\n'); end != text.npos; end = text.find('\n', end + 1), ++line)
    if (stops(text.substr(0, end + 1))) break;
  return line;
}

}  // namespace

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

namespace {

std::string text_of(const std::string &file) {
  std::error_code status;
  if (!std::filesystem::is_regular_file(file, status))
    throw InputError(file, "file", "expected a readable file, got none; check the path");
  std::ifstream stream(file, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  if (!stream.good() && !stream.eof())
    throw InputError(file, "file", "expected a readable file, got a read error; check the file");
  return text;
}

}  // namespace

toml::table parse_toml(const std::string &file) { return parse_toml_text(text_of(file), file); }

std::shared_ptr<const toml::table> shared_toml(const std::string &file) {
  struct Parsed {
    std::string file, text;
    std::shared_ptr<const toml::table> table;
  };
  constexpr std::size_t kKept = 8;
  // the last parsed files; the newest one is the first element
  thread_local std::deque<Parsed> parsed;
  std::string text = text_of(file);
  const auto same = [&](const Parsed &one) { return one.file == file && one.text == text; };
  const auto found = std::find_if(parsed.begin(), parsed.end(), same);
  if (found != parsed.end()) return found->table;
  auto table = std::make_shared<const toml::table>(parse_toml_text(text, file));
  parsed.push_front({file, std::move(text), table});
  if (parsed.size() > kKept) parsed.pop_back();
  return table;
}

toml::table parse_toml_text(std::string_view text, const std::string &file) {
  try {
    return toml::parse(text, std::string_view(file));
  } catch (const TomlParserStopped &) {
    throw InputError(file, "line " + std::to_string(line_that_stops(text)),
                     "expected a value, got a character that starts no value; correct this line");
  } catch (const toml::parse_error &error) {
    const auto where = error.source().begin;
    throw InputError(
        file, "line " + std::to_string(where.line) + ", column " + std::to_string(where.column),
        "expected valid TOML, got: " + one_line(error.description()) +
            "; correct this line (is the file complete?)");
  }
}

int find_point(const std::vector<std::string> &points, std::string_view name) {
  const auto found = std::find(points.begin(), points.end(), name);
  return found == points.end() ? kGround : static_cast<int>(found - points.begin());
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

const KeyFormat &Section::declared(std::string_view key) const {
  static constexpr KeyFormat kAny = format::other("", "", "none", "");
  for (const TableFormat *format : formats_) {
    if (const KeyFormat *found = format->find(key); found != nullptr) return *found;
    if (format->open) return kAny;
  }
  throw std::logic_error("no declaration of the key " + key_path(key));
}

std::vector<std::string> Section::keys() const {
  std::vector<std::string> names;
  for (const TableFormat *format : formats_)
    for (const KeyFormat &key : format->keys) names.emplace_back(key.key);
  return names;
}

const toml::node *Section::find(std::string_view key) const {
  (void)declared(key);
  return table_.get(key);
}

const toml::node &Section::require(std::string_view key, std::string_view expected) const {
  const toml::node *node = find(key);
  if (node == nullptr) {
    std::string obtained = "nothing";
    const auto known = keys();
    for (const auto &[name, other] : table_)
      if (std::find(known.begin(), known.end(), name.str()) == known.end())
        if (const std::string meant = suggestion(name.str(), {std::string(key)}); !meant.empty())
          obtained = in_quotes(name.str()) + meant;
    fail(key, "expected " + std::string(expected) + ", got " + obtained + "; add this key");
  }
  return *node;
}

std::string Section::text(std::string_view key, std::string_view expected) {
  const toml::node &node = require(key, expected);
  if (!node.is_string())
    fail(key, "expected " + std::string(expected) + ", got " + kind_of(node) + "; give a string");
  return node.ref<std::string>();
}

std::optional<std::string> Section::optional_text(std::string_view key, std::string_view expected) {
  if (!has(key)) return std::nullopt;
  return text(key, expected);
}

std::size_t Section::choice(std::string_view key, std::string_view advice) {
  const KeyFormat &format = declared(key);
  std::vector<std::string> names;
  std::string_view rest = format.form;
  for (std::size_t end = 0; end != std::string_view::npos; rest.remove_prefix(end + 2)) {
    end = rest.find(", ");
    names.emplace_back(rest.substr(0, end));
    if (end == std::string_view::npos) break;
  }
  const std::string expected = "one of " + std::string(format.form);
  const std::string wanted =
      format.required() ? text(key, expected)
                        : optional_text(key, expected).value_or(std::string(format.absent));
  const auto found = std::find(names.begin(), names.end(), wanted);
  if (found == names.end())
    fail(key, "expected " + expected + ", got " + in_quotes(wanted) + suggestion(wanted, names) +
                  "; " + std::string(advice));
  return static_cast<std::size_t>(found - names.begin());
}

double Section::number(std::string_view key) {
  const KeyFormat &format = declared(key);
  if (format.fallback) return optional_number(key).value_or(*format.fallback);
  if (format.high < kUnlimited) return within(key, *format.dimension, format.low, format.high);
  return value(key, *format.dimension, format.sign);
}

std::optional<double> Section::optional_number(std::string_view key) {
  const KeyFormat &format = declared(key);
  if (format.high < kUnlimited)
    return optional_within(key, *format.dimension, format.low, format.high);
  return optional_value(key, *format.dimension, format.sign);
}

std::string Section::checked_name(std::string_view key, const std::string &text) const {
  if (!is_identifier(text))
    fail(key, "expected " + std::string(kNameText) + " (at most 64), got " + in_quotes(text) +
                  "; rename this element");
  if (text == "ground" || text == "drive")
    fail(key, "expected a name other than the reserved ground and drive, got " + in_quotes(text) +
                  "; rename this element");
  return text;
}

std::string Section::name() { return checked_name("name", text("name", kNameText)); }

std::vector<std::string> Section::texts(std::string_view key, std::string_view expected) {
  const toml::node &node = require(key, "a list of names");
  const toml::array *list = node.as_array();
  if (list == nullptr || list->empty())
    fail(key, "expected a list of names, got " +
                  (list == nullptr ? kind_of(node) : std::string("an empty list")) +
                  "; write [\"a\", \"b\"]");
  std::vector<std::string> found;
  for (std::size_t i = 0; i < list->size(); ++i) {
    const toml::node &text = *list->get(i);
    if (!text.is_string())
      fail(std::string(key) + "[" + std::to_string(i) + "]",
           "expected " + std::string(expected) + ", got " + kind_of(text) + "; give a string");
    found.push_back(text.ref<std::string>());
  }
  return found;
}

std::vector<std::string> Section::names(std::string_view key) {
  std::vector<std::string> found = texts(key, kNameText);
  for (std::size_t i = 0; i < found.size(); ++i)
    (void)checked_name(std::string(key) + "[" + std::to_string(i) + "]", found[i]);
  return found;
}

Section::Resolved Section::resolve(const std::string &key, const toml::node &node,
                                   Dimension dimension, const std::string &wanted) {
  if (node.is_number()) return {*node.value<double>(), ""};
  if (!node.is_string())
    source_.fail(key, "expected " + wanted + " or a parameter's name, got " + kind_of(node) +
                          "; give a number or a string");
  const std::string &text = node.ref<std::string>();
  if (is_quantity(text)) {
    const QuantityResult quantity = read_quantity(text, dimension);
    if (!quantity.value)
      source_.fail(key, "expected " + phrase_of(dimension) + ", got " + quantity.obtained +
                            "; correct the value or its unit");
    return {*quantity.value, " (" + in_quotes(text) + ")"};
  }
  std::string_view name = text;
  const bool negated = !name.empty() && name.front() == '-';
  if (negated) name.remove_prefix(1);
  Parameter *const found = source_.find(name);
  if (found == nullptr) {
    const auto names = source_.parameter_names();
    source_.fail(key, "expected " + wanted + " or a parameter out of " + joined(names) + ", got " +
                          in_quotes(text) + suggestion(name, names) +
                          "; define the parameter or correct its name");
  }
  found->used = true;
  if (dimension_of(found->unit) != dimension)
    source_.fail(key, "expected a parameter in " + std::string(unit_of(dimension)) + ", got " +
                          found->name + " in " + found->unit + "; correct parameters." +
                          found->name + ".unit or refer to another parameter");
  return {negated ? -found->value : found->value, " (parameter " + found->name + ")"};
}

double Section::resolve(const std::string &key, const toml::node &node, Dimension dimension,
                        Sign sign) {
  const std::string wanted =
      std::string(sign_text(sign)) + " in " + std::string(unit_of(dimension));
  const auto [value, origin] = resolve(key, node, dimension, wanted);
  if (!sign_holds(sign, value))
    source_.fail(key, "expected " + wanted + ", got " + number_text(value) + origin +
                          "; correct the value or its sign");
  const double size = std::fabs(value);
  if (size > kLargest || (size != 0.0 && size < kSmallest))
    source_.fail(key, "expected a size between 1e-30 and 1e30, got " + number_text(value) + origin +
                          "; check the exponent");
  return value;
}

double Section::within(std::string_view key, Dimension dimension, double low, double high) {
  if (const auto value = optional_within(key, dimension, low, high)) return *value;
  fail(key, "expected a number from " + number_text(low) + " to " + number_text(high) + " in " +
                std::string(unit_of(dimension)) + ", got nothing; add this key");
}

std::optional<double> Section::optional_within(std::string_view key, Dimension dimension,
                                               double low, double high) {
  const toml::node *node = find(key);
  if (node == nullptr) return std::nullopt;
  const std::string wanted = "a number from " + number_text(low) + " to " + number_text(high) +
                             " in " + std::string(unit_of(dimension));
  const auto [value, origin] = resolve(key_path(key), *node, dimension, wanted);
  if (!(value >= low && value <= high))
    fail(key, "expected " + wanted + ", got " + number_text(value) + origin +
                  "; choose a value in that range");
  return value;
}

bool Section::flag(std::string_view key) {
  const toml::node *node = find(key);
  if (node == nullptr) return declared(key).absent == "true";
  if (!node->is_boolean())
    fail(key, "expected true or false, got " + kind_of(*node) + "; write true or false");
  return node->ref<bool>();
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

std::vector<double> Section::numbers(std::string_view key) {
  const KeyFormat &format = declared(key);
  std::vector<double> found = list(key, *format.dimension, format.sign);
  if (found.empty())
    // This call throws InputError, because the key is missing.
    (void)value(key, *format.dimension, format.sign);
  return found;
}

std::vector<double> Section::rising(std::string_view key) {
  std::vector<double> breaks = list(key, *declared(key).dimension, declared(key).sign);
  for (std::size_t i = 1; i < breaks.size(); ++i)
    if (!(breaks[i] > breaks[i - 1]))
      fail(std::string(key) + "[" + std::to_string(i) + "]",
           "expected more than the value before, " + number_text(breaks[i - 1]) + ", got " +
               number_text(breaks[i]) + "; sort the values in ascending order");
  return breaks;
}

int Section::integer(std::string_view key) {
  const KeyFormat &format = declared(key);
  const int low = static_cast<int>(format.low);
  const int high = static_cast<int>(format.high);
  const toml::node *node = find(key);
  const std::string expected =
      "expected an integer " + std::to_string(low) + ".." + std::to_string(high) + ", got ";
  if (node == nullptr) {
    if (format.fallback) return static_cast<int>(*format.fallback);
    fail(key, expected + "nothing; add this key");
  }
  if (!node->is_integer()) fail(key, expected + kind_of(*node) + "; give an integer");
  const int64_t number = node->ref<int64_t>();
  if (number < low || number > high)
    fail(key, expected + std::to_string(number) + "; choose a value in that range");
  return static_cast<int>(number);
}

int Section::point(std::string_view key, const std::vector<std::string> &points,
                   bool ground_allowed, std::optional<int> fallback) {
  if (fallback && !has(key)) return *fallback;
  const auto names = end_names(points, ground_allowed);
  const std::string expected = "one of " + joined(names);
  const std::string wanted = text(key, expected);
  if (ground_allowed && wanted == "ground") return kGround;
  const int index = find_point(points, wanted);
  if (index == kGround)
    fail(key, "expected " + expected + ", got " + in_quotes(wanted) + suggestion(wanted, names) +
                  "; give one of these names");
  return index;
}

Ends Section::between(const std::vector<std::string> &points) {
  const auto names = end_names(points, true);
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
      fail(entry, "expected one of " + joined(names) + ", got " + kind_of(end) +
                      "; give the name of a body");
    const std::string &wanted = end.ref<std::string>();
    found[i] = wanted == "ground" ? kGround : find_point(points, wanted);
    if (found[i] == kGround && wanted != "ground")
      fail(entry, "expected one of " + joined(names) + ", got " + in_quotes(wanted) +
                      suggestion(wanted, names) + "; give one of these names");
  }
  if (found[0] == found[1])
    fail("between", "expected " + expected + ", got the same name twice; connect two bodies");
  return {found[0], found[1]};
}

void Section::child(const toml::node &node, std::string_view key, const std::string &path,
                    const std::function<void(Section &)> &visit) const {
  const toml::table *table = node.as_table();
  if (table == nullptr)
    source_.fail(path, "expected a table, got " + kind_of(node) + "; write [" + path + "]");
  Section section(source_, *table, path, *declared(key).table);
  visit(section);
  section.finish();
}

void Section::one(std::string_view key, const std::function<void(Section &)> &visit) {
  if (const toml::node *node = find(key); node != nullptr) child(*node, key, key_path(key), visit);
}

void Section::each(std::string_view key, const std::function<void(Section &)> &visit) {
  const toml::node *node = find(key);
  if (node == nullptr) return;
  const toml::array *tables = node->as_array();
  if (tables == nullptr)
    fail(key, "expected a list of tables, got " + kind_of(*node) + "; write [[" + std::string(key) +
                  "]]");
  for (std::size_t i = 0; i < tables->size(); ++i)
    child(*tables->get(i), key, key_path(key) + "[" + std::to_string(i) + "]", visit);
}

void Section::finish() const {
  for (const TableFormat *format : formats_)
    if (format->open) return;
  const std::vector<std::string> known = keys();
  std::vector<std::string> unknown;
  for (const auto &[key, node] : table_)
    if (std::find(known.begin(), known.end(), key.str()) == known.end())
      unknown.emplace_back(key.str());
  if (unknown.empty()) return;
  fail(one_line(unknown.front()),
       "expected one of the keys " + joined(known) + ", got " + wrong_names(unknown, known) +
           (unknown.size() == 1 ? "; remove or rename this key" : "; remove or rename these keys"));
}

}  // namespace forceaxis::sim
