#include "host/link/experiment.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <set>

#define TOML_EXCEPTIONS 1
#include <toml++/toml.h>

#include "host/link/objects.hpp"
#include "host/link/sha256.hpp"

namespace forceaxis::host {
namespace {

using sim::InputError;

constexpr double kLongestRun_s = 600;

std::optional<double> parameter_value(const sim::Model &model, std::string_view name) {
  for (const sim::Parameter &p : model.parameters) {
    if (p.name == name) return p.value;
  }
  return std::nullopt;
}

bool has_body(const sim::Model &model, std::string_view name) {
  return std::any_of(model.bodies.begin(), model.bodies.end(),
                     [name](const sim::Body &b) { return b.name == name; });
}

// One experiment file while it is being read: every complaint carries its name.
class Reader {
 public:
  explicit Reader(std::filesystem::path file) : file_(std::move(file)) {}

  [[noreturn]] void fail(const std::string &key, const std::string &message) const {
    throw InputError(file_.string(), key, message);
  }

  void only(const toml::table &table, const std::string &where,
            std::initializer_list<std::string_view> known) const {
    for (const auto &[key, node] : table) {
      if (std::find(known.begin(), known.end(), key.str()) != known.end()) continue;
      std::string names;
      for (const std::string_view name : known)
        names += (names.empty() ? "" : ", ") + std::string(name);
      fail(where + std::string(key.str()),
           "expected one of " + names + "; remove or rename this key");
    }
  }

  const toml::table *table(const toml::table &parent, const std::string &key) const {
    const toml::node *node = parent.get(key);
    if (node == nullptr) return nullptr;
    if (!node->is_table()) fail(key, "expected a table, write [" + key + "]");
    return node->as_table();
  }

  std::string text(const toml::table &parent, const std::string &key, bool required) const {
    const toml::node *node = parent.get(key);
    if (node == nullptr) {
      if (required) fail(key, "expected a text, the key is missing; add " + key + " = \"...\"");
      return {};
    }
    const auto value = node->value_exact<std::string>();
    if (!value || value->empty()) fail(key, "expected a text that is not empty");
    return *value;
  }

  double number(const toml::node &node, const std::string &key, double low, double high) const {
    const auto value = node.is_number() ? node.value<double>() : std::nullopt;
    if (!value || !std::isfinite(*value) || *value < low || *value > high) {
      fail(key, "expected a number from " + plain(low) + " to " + plain(high));
    }
    return *value;
  }

  // A number, or the name of a model parameter.
  double quantity(const toml::node &node, const std::string &key, const sim::Model &model) const {
    if (const auto name = node.value_exact<std::string>()) {
      if (const auto value = parameter_value(model, *name)) return *value;
      fail(key, "expected a number or the name of a model parameter, got \"" + *name +
                    "\", which the model does not have");
    }
    return number(node, key, -1e18, 1e18);
  }

  static std::string plain(double value) {
    char buffer[32];
    const auto end = std::to_chars(buffer, buffer + sizeof buffer, value).ptr;
    return {buffer, end};
  }

 private:
  std::filesystem::path file_;
};

ObjectWrite object_write(const Reader &reader, const std::string &name, const toml::node &node,
                         const sim::Model &model) {
  const std::string key = "firmware." + name;
  const auto object = find_object(name);
  if (!object) reader.fail(key, "expected the name of a firmware object; see `forceaxis objects`");
  const axis_object_meta_t &meta = object_meta(*object);
  if (!object_writable(*object)) {
    reader.fail(key, "expected an object that can be written, this one is a signal");
  }
  if (const auto text = node.value_exact<std::string>()) {
    if (const auto value = enum_value(*object, *text)) return {*object, *value};
  }
  const double value =
      node.is_boolean() ? (*node.value_exact<bool>() ? 1 : 0) : reader.quantity(node, key, model);
  const double raw = std::floor(value / meta.scale + 0.5);
  if (!(raw >= static_cast<double>(meta.min) && raw <= static_cast<double>(meta.max))) {
    reader.fail(key, "expected " + Reader::plain(static_cast<double>(meta.min) * meta.scale) +
                         " to " + Reader::plain(static_cast<double>(meta.max) * meta.scale) + " " +
                         meta.unit + ", got " + Reader::plain(value));
  }
  return {*object, static_cast<std::int32_t>(raw)};
}

// `mode` comes last: an axis is set up before it is switched on.
std::vector<ObjectWrite> object_writes(const Reader &reader, const toml::table *table,
                                       const sim::Model &model) {
  std::vector<ObjectWrite> writes;
  if (table == nullptr) return writes;
  for (const auto &[key, node] : *table) {
    writes.push_back(object_write(reader, std::string(key.str()), node, model));
  }
  std::stable_partition(writes.begin(), writes.end(),
                        [](const ObjectWrite &w) { return w.object != *find_object("mode"); });
  return writes;
}

std::int64_t tick_at(double time_s) {
  return static_cast<std::int64_t>(std::ceil(time_s * sim::kTickRateHz - 1e-9));
}

Action read_action(const Reader &reader, const toml::node &node, std::size_t index,
                   const sim::Model &model) {
  const std::string where = "at[" + std::to_string(index) + "].";
  const toml::table *table = node.as_table();
  if (table == nullptr) reader.fail("at", "expected tables, write [[at]]");
  reader.only(*table, where, {"time_s", "impulse", "firmware"});
  Action action{};
  const toml::node *time = table->get("time_s");
  if (time == nullptr) reader.fail(where + "time_s", "expected a time in s, the key is missing");
  action.tick = tick_at(reader.number(*time, where + "time_s", 0, kLongestRun_s));
  action.writes = object_writes(reader, reader.table(*table, "firmware"), model);
  if (const toml::table *impulse = reader.table(*table, "impulse")) {
    reader.only(*impulse, where + "impulse.", {"body", "N_s"});
    const std::string body = reader.text(*impulse, "body", true);
    if (!has_body(model, body)) {
      reader.fail(where + "impulse.body", "expected a body of the model, got \"" + body + "\"");
    }
    const toml::node *size = impulse->get("N_s");
    if (size == nullptr) reader.fail(where + "impulse.N_s", "expected N s, the key is missing");
    action.impulses.push_back({body, reader.quantity(*size, where + "impulse.N_s", model)});
  }
  return action;
}

Criterion read_criterion(const Reader &reader, const toml::table &table) {
  reader.only(table, "verdict.",
              {"window_s", "force_ripple_max_count", "position_ripple_max_count", "contact_held"});
  Criterion criterion;
  const auto number = [&](const char *name, double low, double high) -> std::optional<double> {
    const toml::node *node = table.get(name);
    if (node == nullptr) return std::nullopt;
    return reader.number(*node, std::string("verdict.") + name, low, high);
  };
  criterion.window_s = number("window_s", 1.0 / sim::kTickRateHz, kLongestRun_s).value_or(1.0);
  criterion.force_ripple_max_count = number("force_ripple_max_count", 0, 1e9);
  criterion.position_ripple_max_count = number("position_ripple_max_count", 0, 1e12);
  if (const toml::node *node = table.get("contact_held")) {
    const auto held = node->value_exact<bool>();
    if (!held) reader.fail("verdict.contact_held", "expected true or false");
    criterion.contact_held = *held;
  }
  return criterion;
}

// Sets `key` of `table` from an override's text: a number, true, false, or a text.
void put(toml::table &table, std::string_view key, const std::string &text) {
  double number = 0;
  const char *end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, number);
  if (parsed.ec == std::errc() && parsed.ptr == end) {
    table.insert_or_assign(key, number);
  } else if (text == "true" || text == "false") {
    table.insert_or_assign(key, text == "true");
  } else {
    table.insert_or_assign(key, text);
  }
}

toml::table &subtable(toml::table &root, std::string_view key) {
  if (root.get(key) == nullptr) root.insert(key, toml::table{});
  toml::table *table = root.get(key)->as_table();
  if (table == nullptr) {
    throw InputError("--set", std::string(key), "expected a table of this name in the experiment");
  }
  return *table;
}

void apply_overrides(toml::table &root, std::span<const std::string> overrides) {
  for (const std::string &text : overrides) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0 || equals + 1 == text.size()) {
      throw InputError("--set", text, "expected NAME=VALUE");
    }
    const std::string name = text.substr(0, equals);
    const std::string value = text.substr(equals + 1);
    const std::size_t dot = name.find('.');
    const std::string room = dot == std::string::npos ? "" : name.substr(0, dot);
    if (room.empty()) {
      put(subtable(root, "set"), name, value);
    } else if (room == "experiment") {
      put(root, name.substr(dot + 1), value);
    } else if (room == "firmware" || room == "verdict") {
      put(subtable(root, room), name.substr(dot + 1), value);
    } else {
      throw InputError(
          "--set", name,
          "expected a model parameter, firmware.OBJECT, experiment.KEY or verdict.KEY");
    }
  }
}

toml::table parse(const std::filesystem::path &file) {
  if (!std::filesystem::is_regular_file(file)) {
    throw InputError(file.string(), "file", "expected a readable experiment file, there is none");
  }
  try {
    return toml::parse_file(file.string());
  } catch (const toml::parse_error &error) {
    throw InputError(file.string(), "line " + std::to_string(error.source().begin.line),
                     "expected valid TOML, " + std::string(error.description()));
  }
}

std::shared_ptr<const sim::Model> read_model(const Reader &reader, const toml::table &root,
                                             const std::filesystem::path &file) {
  const std::filesystem::path path =
      (file.parent_path() / reader.text(root, "model", true)).lexically_normal();
  std::vector<sim::Override> overrides;
  const toml::table *set = reader.table(root, "set");
  std::vector<std::pair<std::string, std::string>> by_name;
  if (set != nullptr) {
    for (const auto &[key, node] : *set) {
      const std::string name(key.str());
      if (const auto other = node.value_exact<std::string>()) {
        by_name.emplace_back(name, *other);
      } else {
        overrides.push_back({name, reader.number(node, "set." + name, -1e18, 1e18)});
      }
    }
  }
  auto model = std::make_shared<const sim::Model>(sim::load_model(path, overrides));
  if (by_name.empty()) return model;
  for (const auto &[name, other] : by_name) {
    const auto value = parameter_value(*model, other);
    if (!value) {
      reader.fail("set." + name,
                  "expected a number or the name of a model parameter, got \"" + other + "\"");
    }
    overrides.push_back({name, *value});
  }
  return std::make_shared<const sim::Model>(sim::load_model(path, overrides));
}

std::string hash_inputs(const std::filesystem::path &file, const sim::Model &model,
                        std::span<const std::string> overrides) {
  std::set<std::string> files{file.string(), model.file};
  for (const sim::Parameter &p : model.parameters) files.insert(p.file);
  std::set<std::string> contents;  // by content: the hash does not depend on where files are
  for (const std::string &name : files) {
    std::ifstream stream(name, std::ios::binary);
    contents.insert({std::istreambuf_iterator<char>(stream), {}});
  }
  Sha256 hash;
  for (const std::string &text : contents) hash.update(text);
  for (const std::string &text : overrides) hash.update(text);
  return hash.hex();
}

}  // namespace

Experiment load_experiment(const std::filesystem::path &file,
                           std::span<const std::string> overrides) {
  toml::table root = parse(file);
  apply_overrides(root, overrides);
  const Reader reader(file);
  reader.only(root, "",
              {"title", "figure", "shows", "model", "duration_s", "set", "firmware", "at",
               "verdict", "plot"});
  Experiment experiment;
  experiment.file = file;
  experiment.title = reader.text(root, "title", true);
  experiment.figure = reader.text(root, "figure", false);
  experiment.shows = reader.text(root, "shows", false);
  const toml::node *duration = root.get("duration_s");
  if (duration == nullptr) reader.fail("duration_s", "expected a time in s, the key is missing");
  experiment.ticks =
      tick_at(reader.number(*duration, "duration_s", 1.0 / sim::kTickRateHz, kLongestRun_s));
  experiment.model = read_model(reader, root, file);
  experiment.initial = object_writes(reader, reader.table(root, "firmware"), *experiment.model);
  if (const toml::node *node = root.get("at")) {
    const toml::array *list = node->as_array();
    if (list == nullptr) reader.fail("at", "expected tables, write [[at]]");
    for (std::size_t i = 0; i < list->size(); ++i) {
      experiment.actions.push_back(read_action(reader, *list->get(i), i, *experiment.model));
    }
  }
  std::stable_sort(experiment.actions.begin(), experiment.actions.end(),
                   [](const Action &a, const Action &b) { return a.tick < b.tick; });
  if (const toml::table *verdict = reader.table(root, "verdict")) {
    experiment.criterion = read_criterion(reader, *verdict);
  }
  experiment.hash = hash_inputs(file, *experiment.model, overrides);
  return experiment;
}

}  // namespace forceaxis::host
