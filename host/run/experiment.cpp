#include "host/run/experiment.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <list>
#include <mutex>
#include <set>
#include <sstream>

#define TOML_EXCEPTIONS 1
#include <toml++/toml.h>

#include "host/run/objects.hpp"
#include "host/run/sha256.hpp"

namespace forceaxis::host {
namespace {

using sim::InputError;

constexpr double kLongestRun_s = 600;
constexpr double kLargest = 1e18;

const sim::Parameter *find_parameter(const sim::Model &model, std::string_view name) {
  const auto at = std::find_if(model.parameters.begin(), model.parameters.end(),
                               [name](const sim::Parameter &p) { return p.name == name; });
  return at == model.parameters.end() ? nullptr : &*at;
}

bool has_body(const sim::Model &model, std::string_view name) {
  return std::any_of(model.bodies.begin(), model.bodies.end(),
                     [name](const sim::Body &b) { return b.name == name; });
}

std::string plain(double value) {
  char buffer[32];
  return {buffer, std::to_chars(buffer, buffer + sizeof buffer, value).ptr};
}

// A table of the experiment that knows where it stands: every complaint names file and whole key.
class Section {
 public:
  Section(const std::string &file, const toml::table &table, std::string where = "")
      : file_(file), table_(table), where_(std::move(where)) {}

  [[noreturn]] void fail(const std::string &key, const std::string &message) const {
    throw InputError(file_, where_ + key, message);
  }

  const toml::table &table() const { return table_; }

  void only(std::initializer_list<std::string_view> known) const {
    for (const auto &[key, node] : table_) {
      if (std::find(known.begin(), known.end(), key.str()) != known.end()) continue;
      std::string names;
      for (const std::string_view name : known) {
        names += (names.empty() ? "" : ", ") + std::string(name);
      }
      fail(std::string(key.str()), "expected one of " + names + "; remove or rename this key");
    }
  }

  std::optional<Section> section(const std::string &key) const {
    const toml::node *node = table_.get(key);
    if (node == nullptr) return std::nullopt;
    if (!node->is_table()) fail(key, "expected a table, " + key + " = { ... } or [" + key + "]");
    return Section(file_, *node->as_table(), where_ + key + ".");
  }

  std::vector<Section> sections(const std::string &key) const {
    std::vector<Section> list;
    const toml::node *node = table_.get(key);
    if (node == nullptr) return list;
    const toml::array *array = node->as_array();
    if (array == nullptr) fail(key, "expected tables, write [[" + key + "]]");
    for (std::size_t i = 0; i < array->size(); ++i) {
      const std::string name = key + "[" + std::to_string(i) + "]";
      const toml::table *table = array->get(i)->as_table();
      if (table == nullptr) fail(name, "expected a table, write [[" + key + "]]");
      list.emplace_back(file_, *table, where_ + name + ".");
    }
    return list;
  }

  std::string text(const std::string &key, bool required) const {
    const toml::node *node = table_.get(key);
    if (node == nullptr) {
      if (required) fail(key, "expected a text, the key is missing; add " + key + " = \"...\"");
      return {};
    }
    const auto value = node->value_exact<std::string>();
    if (!value || value->empty()) fail(key, "expected a text that is not empty");
    return *value;
  }

  std::optional<double> optional_number(const std::string &key, double low, double high) const {
    const toml::node *node = table_.get(key);
    if (node == nullptr) return std::nullopt;
    return as_number(*node, key, low, high);
  }

  double number(const std::string &key, double low, double high) const {
    const auto value = optional_number(key, low, high);
    if (!value) fail(key, "expected a number, the key is missing; add " + key + " = ...");
    return *value;
  }

  double as_number(const toml::node &node, const std::string &key, double low, double high) const {
    const auto value = node.is_number() ? node.value<double>() : std::nullopt;
    if (!value || !std::isfinite(*value) || *value < low || *value > high) {
      fail(key, "expected a number from " + plain(low) + " to " + plain(high));
    }
    return *value;
  }

  // A number, or the value of a model parameter of one of these dimensions, which is added to
  // `named`.
  double quantity(const toml::node &node, const std::string &key, const sim::Model &model,
                  std::initializer_list<sim::Dimension> dimensions,
                  std::set<std::string> &named) const {
    const auto name = node.value_exact<std::string>();
    if (!name) return as_number(node, key, -kLargest, kLargest);
    const sim::Parameter *parameter = find_parameter(model, *name);
    if (parameter == nullptr) {
      fail(key, "expected a number or the name of a model parameter, got \"" + *name +
                    "\", which the model does not have");
    }
    const auto dimension = sim::dimension_of(parameter->unit);
    if (!dimension ||
        std::find(dimensions.begin(), dimensions.end(), *dimension) == dimensions.end()) {
      fail(key, "expected a parameter in " + std::string(sim::unit_of(*dimensions.begin())) +
                    ", got " + *name + " in " + parameter->unit);
    }
    named.insert(*name);
    return parameter->value;
  }

 private:
  const std::string &file_;
  const toml::table &table_;
  std::string where_;
};

ObjectWrite read_object(const Section &section, const std::string &name, const toml::node &node,
                        const sim::Model &model, std::set<std::string> &named) {
  const auto object = find_object(name);
  if (!object) {
    section.fail(name, "expected the name of a firmware object; see `forceaxis objects`");
  }
  const axis_object_meta_t &meta = object_meta(*object);
  if (!object_writable(*object)) {
    section.fail(name, "expected an object that can be written, this one is a signal");
  }
  const std::string texts = meta.enum_texts;
  if (const auto text = node.value_exact<std::string>(); text && !texts.empty()) {
    const auto value = enum_value(*object, *text);
    if (!value) section.fail(name, "expected one of " + texts + ", got \"" + *text + "\"");
    return {*object, *value};
  }
  if (const auto flag = node.value_exact<bool>(); flag && meta.max == 1) {
    return {*object, *flag ? 1 : 0};
  }
  const double value =
      section.quantity(node, name, model, {sim::Dimension::count, sim::Dimension::ratio}, named);
  const double low = static_cast<double>(meta.min) * meta.scale;
  const double high = static_cast<double>(meta.max) * meta.scale;
  const bool whole = meta.scale != 1.0 || value == std::floor(value);
  if (!(value >= low && value <= high && whole)) {
    section.fail(name, std::string("expected ") + (meta.scale == 1.0 ? "a whole number " : "") +
                           plain(low) + " to " + plain(high) + " " + meta.unit + ", got " +
                           plain(value));
  }
  // Up to 2^32 - 1, which travels as the same 32 bits.
  const auto raw = static_cast<std::int64_t>(std::floor(value / meta.scale + 0.5));
  return {*object, static_cast<std::int32_t>(static_cast<std::uint32_t>(raw))};
}

// An axis is set up before commands are given, and switched on last.
std::vector<ObjectWrite> read_objects(const std::optional<Section> &section,
                                      const sim::Model &model, std::set<std::string> &named) {
  std::vector<ObjectWrite> writes;
  if (!section) return writes;
  for (const auto &[key, node] : section->table()) {
    writes.push_back(read_object(*section, std::string(key.str()), node, model, named));
  }
  const auto stage = [](const ObjectWrite &w) {
    const axis_object_meta_t &meta = object_meta(w.object);
    return std::string_view(meta.name) == "mode" ? 2 : std::string_view(meta.kind) == "command";
  };
  std::stable_sort(writes.begin(), writes.end(),
                   [&](const ObjectWrite &a, const ObjectWrite &b) { return stage(a) < stage(b); });
  return writes;
}

std::int64_t tick_at(double time_s) {
  return static_cast<std::int64_t>(std::ceil(time_s * sim::kTickRateHz - 1e-9));
}

Action read_action(const Section &section, double duration_s, const sim::Model &model,
                   std::set<std::string> &named) {
  section.only({"time_s", "impulse", "firmware"});
  Action action{};
  action.tick = tick_at(section.number("time_s", 0, duration_s));
  action.writes = read_objects(section.section("firmware"), model, named);
  if (const auto impulse = section.section("impulse")) {
    impulse->only({"body", "N_s"});
    const std::string body = impulse->text("body", true);
    if (!has_body(model, body)) {
      impulse->fail("body", "expected a body of the model, got \"" + body + "\"");
    }
    const toml::node *size = impulse->table().get("N_s");
    if (size == nullptr) impulse->fail("N_s", "expected an impulse in N s, the key is missing");
    action.impulses.push_back(
        {body, impulse->quantity(*size, "N_s", model, {sim::Dimension::impulse}, named)});
  }
  if (action.writes.empty() && action.impulses.empty()) {
    section.fail("time_s", "expected firmware or impulse beside it; add one or remove this [[at]]");
  }
  return action;
}

Criterion read_criterion(const Section &section, double duration_s) {
  section.only({"window_s", "force_ripple_max_count", "position_ripple_max_count", "contact_held"});
  Criterion criterion;
  criterion.window_s = section.optional_number("window_s", 1.0 / sim::kTickRateHz, kLongestRun_s)
                           .value_or(std::min(criterion.window_s, duration_s));
  if (criterion.window_s > duration_s) {
    section.fail("window_s", "expected at most the duration of the run, " + plain(duration_s) +
                                 " s, got " + plain(criterion.window_s));
  }
  criterion.force_ripple_max_count = section.optional_number("force_ripple_max_count", 0, 1e9);
  criterion.position_ripple_max_count =
      section.optional_number("position_ripple_max_count", 0, 1e12);
  if (const toml::node *node = section.table().get("contact_held")) {
    const auto held = node->value_exact<bool>();
    if (!held) section.fail("contact_held", "expected true or false");
    criterion.contact_held = *held;
  }
  if (!criterion.contact_held && !criterion.force_ripple_max_count &&
      !criterion.position_ripple_max_count) {
    section.fail("contact_held",
                 "expected at least one limit: contact_held = true, force_ripple_max_count or "
                 "position_ripple_max_count");
  }
  return criterion;
}

// Sets `key` of `table` from an override's text: a number, true, false, or a text.
void put(toml::table &table, std::string_view key, const std::string &text) {
  double number = 0;
  const char *end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, number);
  const bool is_text = key == "title" || key == "figure" || key == "shows" || key == "model";
  if (!is_text && parsed.ec == std::errc() && parsed.ptr == end) {
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
  std::error_code unreadable;
  if (!std::filesystem::is_regular_file(file, unreadable)) {
    throw InputError(file.string(), "file", "expected a readable experiment file, there is none");
  }
  try {
    return toml::parse_file(file.string());
  } catch (const toml::parse_error &error) {
    throw InputError(file.string(), "line " + std::to_string(error.source().begin.line),
                     "expected valid TOML, " + std::string(error.description()));
  }
}

std::filesystem::path model_path(const Section &root, const std::filesystem::path &file) {
  return (file.parent_path() / root.text("model", true)).lexically_normal();
}

std::shared_ptr<const sim::Model> read_model(const Section &root, const std::filesystem::path &path,
                                             std::set<std::string> &named) {
  const auto set = root.section("set");
  const auto load = [&](const sim::Model *known) {
    std::vector<sim::Override> overrides;
    if (!set) return std::make_shared<const sim::Model>(sim::load_model(path));
    for (const auto &[key, node] : set->table()) {
      const std::string name(key.str());
      if (!node.is_string()) {
        overrides.push_back({name, set->as_number(node, name, -kLargest, kLargest)});
        continue;
      }
      // Another parameter's value: known once the model has been read without these.
      if (known == nullptr) continue;
      const sim::Parameter *parameter = find_parameter(*known, name);
      if (parameter == nullptr) set->fail(name, "expected a parameter of the model");
      const auto dimension = sim::dimension_of(parameter->unit);
      overrides.push_back({name, set->quantity(node, name, *known, {*dimension}, named)});
    }
    return std::make_shared<const sim::Model>(sim::load_model(path, overrides));
  };
  auto model = load(nullptr);
  const bool by_name =
      set && std::any_of(set->table().begin(), set->table().end(),
                         [](const auto &entry) { return entry.second.is_string(); });
  return by_name ? load(model.get()) : model;
}

// The firmware's converters are what the model must have.
void check_converters(const Section &root, const Experiment &experiment) {
  const sim::Model &model = *experiment.model;
  if (model.dac.bits != 12) {
    throw InputError(model.file, "dac.bits", "expected 12, the width of the firmware's codes");
  }
  const std::uint16_t adc_bits = *find_object("adc_bits");
  std::int64_t bits = object_meta(adc_bits).initial;
  for (const ObjectWrite &w : experiment.initial) {
    if (w.object == adc_bits) bits = w.raw;
  }
  for (const auto &adc : model.adc) {
    if (adc && adc->bits != bits) {
      root.fail("firmware.adc_bits", "expected " + std::to_string(adc->bits) +
                                         ", the width of the model's ADC, got " +
                                         std::to_string(bits));
    }
  }
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

// What [set] makes of the model, and what belongs to that.
struct ExperimentFile::Variant {
  std::string key;
  std::once_flag read;
  std::shared_ptr<const sim::Model> model;
  std::shared_ptr<sim::ModeCache> modes;
  std::set<std::string> named;  // parameters that [set] refers to by name
};

struct ExperimentFile::Contents {
  std::filesystem::path file;
  std::string name;
  toml::table table;
  std::mutex mutex;
  std::list<std::shared_ptr<Variant>> variants;  // the one used last first
};

ExperimentFile::ExperimentFile(const std::filesystem::path &file)
    : contents_(std::make_unique<Contents>()) {
  contents_->file = file;
  contents_->name = file.string();
  contents_->table = parse(file);
}

ExperimentFile::~ExperimentFile() = default;

std::shared_ptr<ExperimentFile::Variant> ExperimentFile::variant(const std::string &key) {
  const std::lock_guard lock(contents_->mutex);
  auto &list = contents_->variants;
  const auto known =
      std::find_if(list.begin(), list.end(), [&key](const auto &v) { return v->key == key; });
  if (known != list.end()) {
    list.splice(list.begin(), list, known);
  } else {
    list.push_front(std::make_shared<Variant>());
    list.front()->key = key;
    if (list.size() > kKeptModels) list.pop_back();
  }
  return list.front();
}

Experiment ExperimentFile::with(std::span<const std::string> overrides) {
  toml::table table = contents_->table;
  apply_overrides(table, overrides);
  const Section root(contents_->name, table);
  root.only({"title", "figure", "shows", "model", "duration_s", "seed", "set", "firmware", "at",
             "verdict", "plot", "expect"});
  Experiment experiment;
  experiment.file = contents_->file;
  experiment.title = root.text("title", true);
  experiment.figure = root.text("figure", false);
  experiment.shows = root.text("shows", false);
  const double duration_s = root.number("duration_s", 1.0 / sim::kTickRateHz, kLongestRun_s);
  experiment.ticks = tick_at(duration_s);
  const double seed = root.optional_number("seed", 0, 0x7FFFFFFF).value_or(0);
  if (seed != std::floor(seed)) root.fail("seed", "expected a whole number");
  experiment.seed = static_cast<std::uint64_t>(seed);

  const std::filesystem::path path = model_path(root, contents_->file);
  std::ostringstream key;
  key << path;
  if (const toml::node *set = table.get("set")) key << '\n' << toml::node_view(*set);
  const std::shared_ptr<Variant> plant = variant(key.str());
  std::call_once(plant->read, [&] {
    plant->model = read_model(root, path, plant->named);
    plant->modes = std::make_shared<sim::ModeCache>(plant->model);
  });
  experiment.model = plant->model;
  experiment.modes = plant->modes;
  std::set<std::string> named = plant->named;
  experiment.initial = read_objects(root.section("firmware"), *experiment.model, named);
  check_converters(root, experiment);
  for (const Section &at : root.sections("at")) {
    experiment.actions.push_back(read_action(at, duration_s, *experiment.model, named));
  }
  std::stable_sort(experiment.actions.begin(), experiment.actions.end(),
                   [](const Action &a, const Action &b) { return a.tick < b.tick; });
  if (const auto verdict = root.section("verdict")) {
    experiment.criterion = read_criterion(*verdict, duration_s);
  }
  for (const sim::Parameter &p : experiment.model->parameters) {
    if (p.overridden && !p.used && !named.contains(p.name)) experiment.unused.push_back(p.name);
  }
  return experiment;
}

Experiment load_experiment(const std::filesystem::path &file,
                           std::span<const std::string> overrides) {
  Experiment experiment = ExperimentFile(file).with(overrides);
  experiment.hash = hash_inputs(file, *experiment.model, overrides);
  return experiment;
}

}  // namespace forceaxis::host
