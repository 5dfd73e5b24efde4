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
using sim::KeyFormat;
using sim::Section;

std::int64_t tick_at(double time_s) {
  return static_cast<std::int64_t>(std::ceil(time_s * sim::kTickRateHz - 1e-9));
}

}  // namespace

struct ExperimentNames : sim::Names {
  explicit ExperimentNames(const Experiment &one) : experiment(one) {}
  const Experiment &experiment;  // the experiment, with the contents of all tables before the
                                 // present one
};

// sim::read_table() calls the functions value_of() for the members of these types.
static std::optional<std::vector<sim::Override>> value_of(Section &root, ExperimentNames &,
                                                          const KeyFormat &key,
                                                          std::vector<sim::Override> *) {
  std::vector<sim::Override> overrides;
  root.one(key.key, [&](Section &section) {
    for (const auto &[entry, value] : section.table()) {
      const std::string name(entry.str());
      if (value.is_number())
        overrides.push_back({name, *value.value<double>()});
      else if (value.is_string())
        overrides.push_back({name, value.ref<std::string>()});
      else
        section.fail(name, "expected a number, a quantity or a parameter's name, got " +
                               sim::kind_of(value) + "; give a number or a string");
    }
  });
  return overrides;
}

static std::optional<std::vector<ObjectWrite>> value_of(Section &section, ExperimentNames &names,
                                                        const KeyFormat &key,
                                                        std::vector<ObjectWrite> *) {
  std::vector<ObjectWrite> writes;
  section.one(key.key, [&](Section &objects) {
    writes = read_objects(objects, *names.experiment.model, names.experiment.initial);
  });
  return writes;
}

// The value of contact_held is true, false, the name of a contact or a list of names.
static std::optional<HeldContacts> value_of(Section &section, ExperimentNames &names,
                                            const KeyFormat &key, HeldContacts *) {
  const toml::node *node = section.find(key.key);
  if (node == nullptr) return std::nullopt;
  if (node->is_boolean()) return node->ref<bool>() ? std::optional(HeldContacts{}) : std::nullopt;
  std::vector<std::string> known;
  for (const sim::Contact &contact : names.experiment.model->contacts)
    known.push_back(contact.name);
  HeldContacts held;
  const auto take = [&](const toml::node &name) {
    const std::string contact = name.value_exact<std::string>().value_or("");
    if (std::find(known.begin(), known.end(), contact) == known.end())
      section.fail(key.key, "expected true, false or contacts of the model (" +
                                (known.empty() ? "the model has none" : sim::joined(known)) +
                                "), got " + sim::kind_of(name) + sim::suggestion(contact, known) +
                                "; name a contact");
    held.names.push_back(contact);
  };
  if (const toml::array *list = node->as_array(); list != nullptr && !list->empty()) {
    for (const toml::node &name : *list) take(name);
  } else {
    take(*node);
  }
  return held;
}

// Returns the objects whose names are in a list.
static std::optional<std::vector<std::uint16_t>> value_of(Section &section, ExperimentNames &names,
                                                          const KeyFormat &key,
                                                          std::vector<std::uint16_t> *) {
  const toml::node *node = section.find(key.key);
  const toml::array *list = node != nullptr ? node->as_array() : nullptr;
  if (list == nullptr || list->empty())
    section.fail(key.key, "expected a list of firmware objects, got " +
                              (node != nullptr ? sim::kind_of(*node) : "nothing") +
                              "; write [\"statusword\", \"force_demand\"]");
  const std::vector<std::string> columns = trace_columns(*names.experiment.model);
  std::vector<std::string> known;
  for (const axis_object_meta_t &meta : axis_objects_meta)
    if (std::string_view(meta.kind) != "command") known.emplace_back(meta.name);
  std::vector<std::uint16_t> traced;
  for (const toml::node &entry : *list) {
    const std::string name = entry.value_exact<std::string>().value_or("");
    const auto object = find_object(name);
    if (!object || std::find(known.begin(), known.end(), name) == known.end())
      section.fail(key.key, "expected firmware objects with a value, got " + sim::kind_of(entry) +
                                sim::suggestion(name, known) + "; `list_objects` lists them");
    if (std::find(columns.begin(), columns.end(), name) != columns.end() ||
        std::find(traced.begin(), traced.end(), *object) != traced.end())
      section.fail(key.key, "expected each column once, got " + sim::in_quotes(name) +
                                ", which is a column of the trace already; remove this name");
    traced.push_back(*object);
  }
  return traced;
}

// Returns the names of the columns in each list of a list.
static std::optional<std::vector<std::vector<std::string>>> value_of(
    Section &section, ExperimentNames &names, const KeyFormat &key,
    std::vector<std::vector<std::string>> *) {
  const toml::node *node = section.find(key.key);
  if (node == nullptr) return std::nullopt;
  const auto refuse = [&](const std::string &obtained) {
    section.fail(key.key, "expected a list of lists of columns, got " + obtained +
                              "; write [[\"encoder\"], [\"adc0\"]]");
  };
  const toml::array *rows = node->as_array();
  if (rows == nullptr) refuse(sim::kind_of(*node));
  if (rows->empty()) refuse("an empty list");
  std::vector<std::string> columns = trace_columns(*names.experiment.model);
  for (const std::uint16_t object : names.experiment.trace.objects)
    columns.emplace_back(object_meta(object).name);
  std::vector<std::vector<std::string>> found;
  for (const toml::node &row : *rows) {
    if (!row.is_array() || row.as_array()->empty()) refuse("a row without columns");
    auto &shown = found.emplace_back();
    for (const toml::node &name : *row.as_array()) {
      shown.push_back(name.value_exact<std::string>().value_or(""));
      if (std::find(columns.begin(), columns.end(), shown.back()) == columns.end())
        section.fail(key.key, "expected columns of the trace (" + sim::joined(columns) + "), got " +
                                  sim::kind_of(name) + sim::suggestion(shown.back(), columns) +
                                  "; name a column");
    }
  }
  return found;
}

static std::optional<std::shared_ptr<const toml::table>> value_of(
    Section &root, ExperimentNames &, const KeyFormat &key, std::shared_ptr<const toml::table> *) {
  std::shared_ptr<const toml::table> expect;
  root.one(key.key, [&](Section &section) {
    expect = std::make_shared<const toml::table>(section.table());
  });
  return expect;
}

void SensorFailure::complete(const Section &section, const ExperimentNames &names) const {
  if (!names.experiment.model->adc[0])
    section.fail("force",
                 "expected a model with ADC 0, got a model without ADC 0; remove this sensor");
}

void DriveState::complete(const Section &section, const ExperimentNames &names) const {
  const sim::Model &model = *names.experiment.model;
  if (!model.drive || !model.drive->enable_ticks)
    section.fail("failure",
                 "expected a model whose [drive] has enable_ticks, got a drive that reports "
                 "nothing; add enable_ticks to the model or remove this failure");
}

void Action::complete(Section &section, const ExperimentNames &names) {
  tick = tick_at(section.within("time_s", sim::Dimension::time, 0, names.experiment.duration_s));
  if (writes.empty() && !impulse && !sensor && !drive)
    section.fail("time_s",
                 "expected one of the keys firmware, impulse, sensor and drive too, got none; add "
                 "a key or remove this [[at]]");
}

void Criterion::complete(const Section &section, const ExperimentNames &names) {
  const double duration_s = names.experiment.duration_s;
  if (!section.has("window_s")) window_s = std::min(window_s, duration_s);
  if (window_s > duration_s)
    section.fail("window_s", "expected at most the duration of the run, " +
                                 sim::number_text(duration_s) + " s, got " +
                                 sim::number_text(window_s) + "; shorten the window");
  if (names.experiment.model->contacts.empty() &&
      (peak_force_max_N || peak_force_max_percent || contact_losses_max))
    section.fail(contact_losses_max ? "contact_losses_max"
                 : peak_force_max_N ? "peak_force_max_N"
                                    : "peak_force_max_percent",
                 "expected a model with a contact, got a model without contact; remove this key");
  if (!limits_any())
    section.fail("contact_held",
                 "expected at least one limit, got none; add contact_held = true, "
                 "force_ripple_max_count or position_ripple_max_count");
}

void Plot::complete(const Section &section, const ExperimentNames &) const {
  if (from_s.value_or(0.0) >= to_s.value_or(HUGE_VAL))
    section.fail("from_s", "expected a time before to_s, got " +
                               sim::number_text(from_s.value_or(0.0)) + "; correct from_s or to_s");
}

namespace {

// Sets `key` of `table` to the value of an override: a number, true, false or a text. `format`
// declares the keys of the table.
void put(toml::table &table, const sim::TableFormat &format, std::string_view key,
         const std::string &text) {
  const KeyFormat *declared = format.find(key);
  const std::string_view form = declared != nullptr ? declared->form : "";
  double number = 0;
  const char *end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, number);
  const bool is_number = parsed.ec == std::errc() && parsed.ptr == end;
  if (form == "text" || form == "file name" || !(is_number || text == "true" || text == "false"))
    table.insert_or_assign(key, text);
  else if (!is_number)
    table.insert_or_assign(key, text == "true");
  else if (form == "integer" && number == std::floor(number) && std::fabs(number) < 1e15)
    table.insert_or_assign(key, static_cast<std::int64_t>(number));
  else
    table.insert_or_assign(key, number);
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
      put(subtable(root, "set"), kSetFormat, name, value);
    } else if (room == "experiment") {
      put(root, sim::kFormat<Experiment>, name.substr(dot + 1), value);
    } else if (room == "firmware" || room == "verdict") {
      put(subtable(root, room), *sim::kFormat<Experiment>.find(room)->table, name.substr(dot + 1),
          value);
    } else {
      throw InputError(
          "`overrides`", name,
          "expected a model parameter, firmware.OBJECT, experiment.KEY or verdict.KEY" +
              sim::suggestion(room, {"experiment", "firmware", "verdict"}));
    }
  }
}

// Returns the objects of the firmware whose values are overrides.
std::vector<std::uint16_t> overridden_objects(std::span<const std::string> overrides) {
  std::vector<std::uint16_t> objects;
  for (const std::string &text : overrides) {
    const std::size_t dot = text.find('.');
    if (text.substr(0, dot) != "firmware") continue;
    if (const auto object = find_object(text.substr(dot + 1, text.find('=') - dot - 1)))
      objects.push_back(*object);
  }
  return objects;
}

// Returns true if the value of an override is the name of this parameter.
bool names_parameter(const std::vector<sim::Override> &set, const std::string &parameter) {
  return std::any_of(set.begin(), set.end(), [&](const sim::Override &one) {
    const auto *text = std::get_if<std::string>(&one.value);
    return text != nullptr && *text == parameter;
  });
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
std::shared_ptr<const CycleProgram> program_of(const std::filesystem::path &folder,
                                               const Experiment &experiment) {
  if (experiment.cycle_file.empty()) return nullptr;
  const auto file = (folder / experiment.cycle_file).lexically_normal();
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
  Section root(source, table, "", sim::kFormat<Experiment>);
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
  ExperimentNames names(experiment);
  sim::read_rows(root, names, experiment, Experiment::head());
  if (experiment.duration_s > kLongestRun_s)  // a longer run would need too much memory for traces
    root.fail("duration_s",
              "expected at most " + sim::number_text(kLongestRun_s) + " s, got " +
                  sim::number_text(experiment.duration_s) +
                  "; `axis_node` and `plant_node` run for longer as an endless session");
  experiment.ticks = tick_at(experiment.duration_s);

  const std::filesystem::path folder = contents_->file.parent_path();
  const std::filesystem::path path = (folder / experiment.model_file).lexically_normal();
  std::ostringstream key;
  key << path;
  if (const toml::node *set = table.get("set")) key << '\n' << toml::node_view(*set);
  const std::shared_ptr<Variant> plant = variant(key.str());
  std::call_once(plant->read, [&] {
    plant->model =
        std::make_shared<const sim::Model>(sim::load_model(path, experiment.set, source.file));
    plant->modes = std::make_shared<sim::ModeCache>(plant->model);
  });
  experiment.model = plant->model;
  experiment.modes = plant->modes;
  // From here on, Parameter::used is true for a parameter whose name is a value in the experiment.
  source.parameters = experiment.model->parameters;
  for (sim::Parameter &p : source.parameters) p.used = names_parameter(experiment.set, p.name);
  names.points = experiment.model->point_names();
  sim::read_rows(root, names, experiment, Experiment::tables());
  experiment.overridden = overridden_objects(overrides);
  expect_no_mode(root, experiment);
  experiment.cycle = program_of(folder, experiment);
  match_dac(root, experiment);
  check_adcs(root, experiment);
  std::stable_sort(experiment.actions.begin(), experiment.actions.end(),
                   [](const Action &a, const Action &b) { return a.tick < b.tick; });
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
  experiment.duration_s = static_cast<double>(kEndlessTicks) / sim::kTickRateHz;
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

Experiment load_cycle_experiment(const std::filesystem::path &file,
                                 std::span<const std::string> overrides) {
  Experiment experiment = load_experiment(file, overrides);
  if (!experiment.cycle)
    throw sim::InputError(file.string(), "cycle",
                          "expected an experiment that names a program in this key; add it, or "
                          "give another experiment");
  return experiment;
}

}  // namespace forceaxis::host
