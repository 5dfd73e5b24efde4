#include "host/run/experiment.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <list>
#include <map>
#include <mutex>
#include <set>
#include <sstream>

#include "firmware/port/host/axis_host.h"
#include "host/run/experiment_format.hpp"
#include "host/run/held_force.hpp"
#include "host/run/objects.hpp"
#include "host/run/sha256.hpp"
#include "sim/model/elements/adc.hpp"
#include "sim/model/elements/contact.hpp"
#include "sim/model/elements/dac.hpp"
#include "sim/model/elements/drive.hpp"
#include "sim/model/elements/encoder.hpp"
#include "sim/model/read.hpp"
#include "sim/model/section.hpp"
#include "sim/model/toml.hpp"

namespace forceaxis::host {
namespace {

using sim::InputError;
using sim::Section;

// Returns the text of a key. The text must not be empty.
std::string words(Section &section, std::string_view key) {
  std::string text = section.text(key, "a text");
  if (text.empty()) section.fail(key, "expected a text, got an empty text; write a text");
  return text;
}

std::string optional_words(Section &section, std::string_view key) {
  return section.has(key) ? words(section, key) : std::string();
}

std::int64_t tick_at(double time_s) {
  return static_cast<std::int64_t>(std::ceil(time_s * sim::kTickRateHz - 1e-9));
}

// Returns the struct that a table describes by the rows of the struct.
template <class T>
T read_rows(Section &section) {
  sim::Names names;
  return sim::read_table<T>(section, names);
}

ForceSensor read_force_sensor(Section &section, const sim::Model &model) {
  section.finish();
  const auto failure = read_rows<SensorFailure>(section);
  if (!model.adc[0])
    section.fail("force",
                 "expected a model with ADC 0, got a model without ADC 0; remove this sensor");
  return failure.force;
}

sim::DriveFailure read_drive_failure(Section &section, const sim::Model &model) {
  section.finish();
  const auto state = read_rows<DriveState>(section);
  if (!model.drive || !model.drive->enable_ticks)
    section.fail("failure",
                 "expected a model whose [drive] has enable_ticks, got a drive that reports "
                 "nothing; add enable_ticks to the model or remove this failure");
  return state.failure;
}

Action read_action(Section &section, double duration_s, const sim::Model &model,
                   const std::vector<ObjectWrite> &initial) {
  section.finish();
  Action action{};
  action.tick = tick_at(section.within("time_s", sim::Dimension::time, 0, duration_s));
  section.one("firmware",
              [&](Section &objects) { action.writes = read_objects(objects, model, initial); });
  section.one("impulse", [&](Section &impulse) {
    impulse.finish();
    const std::string body = words(impulse, "body");
    const std::vector<std::string> names = model.point_names();
    if (sim::find_point(names, body) == sim::kGround)
      impulse.fail("body", "expected one of " + sim::joined(names) + ", got " +
                               sim::in_quotes(body) + sim::suggestion(body, names) +
                               "; name a body of the model");
    action.impulses.push_back({body, impulse.number("N_s")});
  });
  section.one("sensor",
              [&](Section &sensor) { action.force_sensor = read_force_sensor(sensor, model); });
  section.one("drive", [&](Section &drive) { action.drive = read_drive_failure(drive, model); });
  if (action.writes.empty() && action.impulses.empty() && !action.force_sensor && !action.drive)
    section.fail("time_s",
                 "expected one of the keys firmware, impulse, sensor and drive too, got none; add "
                 "a key or remove this [[at]]");
  return action;
}

// Reads the key contact_held, whose value is true, false, the name of a contact or a list of names.
void read_contact_held(Section &section, const sim::Model &model, Criterion &criterion) {
  const toml::node *node = section.find("contact_held");
  if (node == nullptr) return;
  criterion.contact_held = node->value_exact<bool>().value_or(true);
  if (node->is_boolean()) return;
  std::vector<std::string> known;
  for (const sim::Contact &contact : model.contacts) known.push_back(contact.name);
  const auto take = [&](const toml::node &name) {
    const std::string contact = name.value_exact<std::string>().value_or("");
    if (std::find(known.begin(), known.end(), contact) == known.end())
      section.fail("contact_held", "expected true, false or contacts of the model (" +
                                       (known.empty() ? "the model has none" : sim::joined(known)) +
                                       "), got " + sim::kind_of(name) +
                                       sim::suggestion(contact, known) + "; name a contact");
    criterion.contacts.push_back(contact);
  };
  if (const toml::array *names = node->as_array(); names != nullptr && !names->empty()) {
    for (const toml::node &name : *names) take(name);
  } else {
    take(*node);
  }
}

// Shortens the default window to the duration of the run. Refuses a given window that is longer.
void fit_window(const Section &section, Criterion &criterion, double duration_s) {
  if (!section.has("window_s")) criterion.window_s = std::min(criterion.window_s, duration_s);
  if (criterion.window_s > duration_s)
    section.fail("window_s", "expected at most the duration of the run, " +
                                 sim::number_text(duration_s) + " s, got " +
                                 sim::number_text(criterion.window_s) + "; shorten the window");
}

Criterion read_criterion(Section &section, const sim::Model &model, double duration_s) {
  section.finish();
  auto criterion = read_rows<Criterion>(section);
  fit_window(section, criterion, duration_s);
  read_contact_held(section, model, criterion);
  if (model.contacts.empty() && (criterion.peak_force_max_N || criterion.peak_force_max_percent ||
                                 criterion.contact_losses_max))
    section.fail(criterion.contact_losses_max ? "contact_losses_max"
                 : criterion.peak_force_max_N ? "peak_force_max_N"
                                              : "peak_force_max_percent",
                 "expected a model with a contact, got a model without contact; remove this key");
  if (!criterion.contact_held && !criterion.force_ripple_max_count &&
      !criterion.limits_position() && !criterion.limits_force() && !criterion.limits_run())
    section.fail("contact_held",
                 "expected at least one limit, got none; add contact_held = true, "
                 "force_ripple_max_count or position_ripple_max_count");
  return criterion;
}

std::vector<std::uint16_t> read_traced(Section &section, const sim::Model &model) {
  section.finish();
  const toml::node *node = section.find("objects");
  const toml::array *names = node != nullptr ? node->as_array() : nullptr;
  if (names == nullptr || names->empty())
    section.fail("objects", "expected a list of firmware objects, got " +
                                (node != nullptr ? sim::kind_of(*node) : "nothing") +
                                "; write [\"statusword\", \"force_demand\"]");
  const std::vector<std::string> columns = trace_columns(model);
  std::vector<std::uint16_t> traced;
  for (const toml::node &entry : *names) {
    const std::string name = entry.value_exact<std::string>().value_or("");
    const auto object = find_object(name);
    std::vector<std::string> known;
    for (const axis_object_meta_t &meta : axis_objects_meta)
      if (std::string_view(meta.kind) != "command") known.emplace_back(meta.name);
    if (!object || std::find(known.begin(), known.end(), name) == known.end())
      section.fail("objects", "expected firmware objects with a value, got " + sim::kind_of(entry) +
                                  sim::suggestion(name, known) + "; `list_objects` lists them");
    if (std::find(columns.begin(), columns.end(), name) != columns.end() ||
        std::find(traced.begin(), traced.end(), *object) != traced.end())
      section.fail("objects", "expected each column once, got " + sim::in_quotes(name) +
                                  ", which is a column of the trace already; remove this name");
    traced.push_back(*object);
  }
  return traced;
}

Plot read_plot(Section &section, const sim::Model &model,
               const std::vector<std::uint16_t> &traced) {
  section.finish();
  Plot plot;
  constexpr double kAlways_s = 1e7;
  plot.from_s = section.optional_number("from_s");
  plot.to_s = section.optional_number("to_s");
  if (plot.from_s.value_or(0.0) >= plot.to_s.value_or(kAlways_s))
    section.fail("from_s", "expected a time before to_s, got " +
                               sim::number_text(plot.from_s.value_or(0.0)) +
                               "; correct from_s or to_s");
  const toml::node *node = section.find("rows");
  if (node == nullptr) return plot;
  const auto refuse = [&](const std::string &obtained) {
    section.fail("rows", "expected a list of lists of columns, got " + obtained +
                             "; write [[\"encoder\"], [\"adc0\"]]");
  };
  const toml::array *rows = node->as_array();
  if (rows == nullptr) refuse(sim::kind_of(*node));
  if (rows->empty()) refuse("an empty list");
  std::vector<std::string> columns = trace_columns(model);
  for (const std::uint16_t object : traced) columns.emplace_back(object_meta(object).name);
  for (const toml::node &row : *rows) {
    if (!row.is_array() || row.as_array()->empty()) refuse("a row without columns");
    auto &names = plot.rows.emplace_back();
    for (const toml::node &name : *row.as_array()) {
      names.push_back(name.value_exact<std::string>().value_or(""));
      if (std::find(columns.begin(), columns.end(), names.back()) == columns.end())
        section.fail("rows", "expected columns of the trace (" + sim::joined(columns) + "), got " +
                                 sim::kind_of(name) + sim::suggestion(names.back(), columns) +
                                 "; name a column");
    }
  }
  return plot;
}

// Sets `key` of `table` to the value of an override: a number, true, false or a text.
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
  if (table == nullptr)
    throw InputError("`overrides`", std::string(key),
                     "expected a table of this name in the experiment");
  return *table;
}

void apply_overrides(toml::table &root, std::span<const std::string> overrides) {
  std::map<std::string, std::string> given;
  for (const std::string &text : overrides) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0 || equals + 1 == text.size())
      throw InputError("`overrides`", text, "expected NAME=VALUE");
    const std::string name = text.substr(0, equals);
    const std::string value = text.substr(equals + 1);
    if (const auto [first, fresh] = given.emplace(name, value); !fresh)
      throw InputError(
          "`overrides`", name,
          "expected one value, got " + first->second + " and " + value + "; remove one value");
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
          "`overrides`", name,
          "expected a model parameter, firmware.OBJECT, experiment.KEY or verdict.KEY" +
              sim::suggestion(room, {"experiment", "firmware", "verdict"}));
    }
  }
}

// Returns the overrides of the table [set]. Parameters whose names are values in [set] are added to
// `named`.
std::vector<sim::Override> read_set(Section &section, std::set<std::string> &named) {
  std::vector<sim::Override> overrides;
  for (const auto &[key, entry] : section.table()) {
    const std::string name(key.str());
    const toml::node &node = *section.find(name);
    if (node.is_number()) {
      overrides.push_back({name, *node.value<double>()});
    } else if (node.is_string()) {
      const std::string &text = node.ref<std::string>();
      overrides.push_back({name, text});
      if (!sim::is_quantity(text)) named.insert(text);
    } else {
      section.fail(name, "expected a number, a quantity or a parameter's name, got " +
                             sim::kind_of(node) + "; give a number or a string");
    }
  }
  return overrides;
}

// Returns the value of an object after the initial writes, or nothing without such a write.
std::optional<std::int64_t> written(const Experiment &experiment, std::uint16_t object) {
  std::optional<std::int64_t> value;
  for (const ObjectWrite &w : experiment.initial) {
    if (w.object == object) value = w.raw;
  }
  return value;
}

// Sets the resolution of the firmware's output to that of the model's DAC, unless the experiment
// sets this resolution. Refuses an output that is finer than the DAC, and a DAC that is coarser
// than any output.
void match_dac(const Section &root, Experiment &experiment) {
  const sim::Model &model = *experiment.model;
  if (model.dac->bits < AXIS_DAC_BITS_MIN) {
    throw InputError(model.file, "dac.bits",
                     "expected 12 to 16, the resolution of the firmware's output in bits, got " +
                         std::to_string(model.dac->bits));
  }
  const std::optional<std::int64_t> bits = written(experiment, AXIS_OBJ_DAC_BITS);
  if (!bits && model.dac->bits != AXIS_DAC_BITS_MIN) {
    experiment.initial.insert(experiment.initial.begin(), {AXIS_OBJ_DAC_BITS, model.dac->bits});
  } else if (bits.value_or(AXIS_DAC_BITS_MIN) > model.dac->bits) {
    root.fail("firmware.dac_bits", "expected at most " + std::to_string(model.dac->bits) +
                                       ", the resolution of the model's DAC in bits, got " +
                                       std::to_string(*bits));
  }
}

// Refuses a model whose ADCs do not have the resolution of the firmware's converters.
void check_adcs(const Section &root, const Experiment &experiment) {
  const sim::Model &model = *experiment.model;
  const std::int64_t bits =
      written(experiment, AXIS_OBJ_ADC_BITS).value_or(object_meta(AXIS_OBJ_ADC_BITS).initial);
  for (const auto &adc : model.adc) {
    if (adc && adc->bits != bits) {
      root.fail("firmware.adc_bits", "expected " + std::to_string(adc->bits) +
                                         ", the resolution of the model's ADC in bits, got " +
                                         std::to_string(bits));
    }
  }
}

// Returns the program of the press cycle that the experiment names, or nothing.
std::shared_ptr<const CycleProgram> program_of(Section &root, const std::filesystem::path &folder,
                                               const Experiment &experiment) {
  if (!root.has("cycle")) return nullptr;
  const auto file = (folder / words(root, "cycle")).lexically_normal();
  return std::make_shared<const CycleProgram>(
      read_cycle(file, *experiment.model, experiment.initial));
}

std::string hash_inputs(const std::filesystem::path &file, const sim::Model &model,
                        const CycleProgram *cycle, std::span<const std::string> overrides,
                        const std::optional<std::string> &text) {
  std::set<std::string> files{model.file};
  // The hash is computed from the contents of the files and does not depend on their paths.
  std::set<std::string> contents;
  if (text)
    contents.insert(*text);
  else
    files.insert(file.string());
  for (const sim::Parameter &p : model.parameters) files.insert(p.file);
  for (const std::string &name : files) {
    std::ifstream stream(name, std::ios::binary);
    contents.insert({std::istreambuf_iterator<char>(stream), {}});
  }
  Sha256 hash;
  for (const std::string &content : contents) hash.update(content);
  for (const std::string &change : overrides) hash.update(change);
  if (cycle)
    hash.update({reinterpret_cast<const char *>(cycle->record.data()), 4 * cycle->record.size()});
  return hash.hex();
}

// Refuses a mode of operation if the model has a controller of the machine.
void expect_no_mode(Section &root, const Experiment &experiment) {
  const auto selected = [&](std::uint16_t object) {
    return written(experiment, object).value_or(0) != 0;
  };
  if (experiment.model->machine_controller &&
      (selected(AXIS_OBJ_MODE) || selected(AXIS_OBJ_MODES_OF_OPERATION)))
    root.fail("firmware",
              "expected no mode of operation, because the model has a [machine_controller] that "
              "commands the drive in place of the firmware; remove the mode");
}

}  // namespace

struct ExperimentFile::Variant {
  // A model with the overrides of the table [set], and the cache of the modes of this model.
  std::string key;
  std::once_flag read;
  std::shared_ptr<const sim::Model> model;
  std::shared_ptr<sim::ModeCache> modes;
  std::set<std::string> named;  // model parameters whose names are used as values in the table
                                // [set]
};

struct ExperimentFile::Contents {
  std::filesystem::path file;
  std::string name;
  toml::table table;
  std::mutex mutex;
  // Variants of the experiment, sorted by the time of their last use. The first variant is the last
  // one used.
  std::list<std::shared_ptr<Variant>> variants;
};

ExperimentFile::ExperimentFile(const std::filesystem::path &file,
                               const std::optional<std::string> &text)
    : contents_(std::make_unique<Contents>()) {
  contents_->file = file;
  contents_->name = file.string();
  contents_->table =
      text ? sim::parse_toml_text(*text, file.string()) : sim::parse_toml(file.string());
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
  sim::Source source{contents_->name, {}};
  Section root(source, table, "", kExperimentFormat);
  if (table.contains("body") && !table.contains("model"))
    root.fail(
        "body",
        "expected an experiment, got a model; give an experiment with this model, or use a command "
        "that takes a model");
  if (table.contains("output") && !table.contains("duration_s"))
    root.fail("output", "expected an experiment, got a measurement; use `measure_response`");
  root.finish();
  Experiment experiment;
  experiment.file = contents_->file;
  experiment.title = words(root, "title");
  experiment.figure = optional_words(root, "figure");
  experiment.shows = optional_words(root, "shows");
  const double duration_s = root.number("duration_s");
  if (duration_s > kLongestRun_s)  // a longer run would need too much memory for the trace
    root.fail("duration_s",
              "expected at most " + sim::number_text(kLongestRun_s) + " s, got " +
                  sim::number_text(duration_s) +
                  "; `axis_node` and `plant_node` run for longer as an endless session");
  experiment.ticks = tick_at(duration_s);
  const double seed = root.number("seed");
  if (seed != std::floor(seed))
    root.fail("seed", "expected a whole number, got " + sim::number_text(seed) + "; round it");
  experiment.seed = static_cast<std::uint64_t>(seed);

  const std::filesystem::path path =
      (contents_->file.parent_path() / words(root, "model")).lexically_normal();
  std::ostringstream key;
  key << path;
  if (const toml::node *set = table.get("set")) key << '\n' << toml::node_view(*set);
  const std::shared_ptr<Variant> plant = variant(key.str());
  std::call_once(plant->read, [&] {
    std::vector<sim::Override> set;
    root.one("set", [&](Section &section) { set = read_set(section, plant->named); });
    plant->model = std::make_shared<const sim::Model>(sim::load_model(path, set, source.file));
    plant->modes = std::make_shared<sim::ModeCache>(plant->model);
  });
  experiment.model = plant->model;
  experiment.modes = plant->modes;
  // From here on, Parameter::used is true for a parameter whose name is a value in the experiment.
  source.parameters = experiment.model->parameters;
  for (sim::Parameter &p : source.parameters) p.used = plant->named.contains(p.name);
  root.one("firmware", [&](Section &section) {
    experiment.initial = read_objects(section, *experiment.model, {});
  });
  expect_no_mode(root, experiment);
  experiment.cycle = program_of(root, contents_->file.parent_path(), experiment);
  match_dac(root, experiment);
  check_adcs(root, experiment);
  root.each("at", [&](Section &section) {
    experiment.actions.push_back(
        read_action(section, duration_s, *experiment.model, experiment.initial));
  });
  std::stable_sort(experiment.actions.begin(), experiment.actions.end(),
                   [](const Action &a, const Action &b) { return a.tick < b.tick; });
  root.one("verdict", [&](Section &section) {
    experiment.criterion = read_criterion(section, *experiment.model, duration_s);
  });
  root.one("trace",
           [&](Section &section) { experiment.traced = read_traced(section, *experiment.model); });
  root.one("plot", [&](Section &section) {
    experiment.plot = read_plot(section, *experiment.model, experiment.traced);
  });
  if (const toml::node *expect = root.find("expect")) {
    if (!expect->is_table())
      root.fail("expect", "expected a table, got " + sim::kind_of(*expect) + "; write [expect]");
    experiment.expect = std::make_shared<const toml::table>(*expect->as_table());
  }
  for (std::size_t i = 0; i < source.parameters.size(); ++i) {
    const sim::Parameter &p = experiment.model->parameters[i];
    if (p.overridden && !p.used && !source.parameters[i].used) experiment.unused.push_back(p.name);
  }
  return experiment;
}

std::vector<std::string> trace_columns(const sim::Model &model) {
  std::vector<std::string> columns = {"tick", "time_s", "encoder", "adc0",  "adc1",
                                      "din",  "dac",    "out",     "fault", "limit_reason"};
  for (const sim::SignalInfo &signal : model.signal_list()) columns.push_back(signal.name);
  return columns;
}

void make_endless(Experiment &experiment) {
  experiment.ticks = kEndlessTicks;
  experiment.criterion.reset();
}

void expect_evaluable(const Experiment &experiment) {
  const auto &criterion = experiment.criterion;
  if (!criterion || !criterion->limits_force() || force_task(experiment)) return;
  throw InputError(experiment.file.string(), "verdict.held_force_error_max_percent",
                   "expected an experiment whose last force set-point is not 0 and whose ADC 0 "
                   "measures a force; remove the limits of force, overshoot and settling time");
}

void expect_used(const Experiment &experiment) {
  const std::vector<std::string> &idle = experiment.unused;
  if (idle.empty()) return;
  throw InputError(experiment.file.string(), "set." + idle.front(),
                   idle.size() == 1
                       ? "expected a parameter that the model or the experiment uses, got a "
                         "parameter without effect; remove this parameter"
                       : "expected parameters that the model or the experiment uses, got " +
                             sim::joined(idle) + ", which have no effect; remove these parameters");
}

Experiment load_experiment(const std::filesystem::path &file,
                           std::span<const std::string> overrides,
                           const std::optional<std::string> &text) {
  Experiment experiment = ExperimentFile(file, text).with(overrides);
  experiment.hash = hash_inputs(file, *experiment.model, experiment.cycle.get(), overrides, text);
  return experiment;
}

}  // namespace forceaxis::host
