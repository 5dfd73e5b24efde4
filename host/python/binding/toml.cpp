#include "host/python/binding/toml.hpp"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <sstream>
#include <tuple>
#include <utility>
#include <vector>

#include "host/axis_linux/settings_format.hpp"
#include "host/python/binding/parts.hpp"
#include "host/python/binding/table.hpp"
#include "host/run/cycle_file.hpp"
#include "host/run/experiment.hpp"
#include "host/run/item.hpp"
#include "sim/model/model_format.hpp"
#include "sim/model/section.hpp"
#include "sim/model/text.hpp"
#include "sim/model/toml.hpp"
#include "sim/model/units.hpp"

namespace py = pybind11;
using forceaxis::host::item;
using forceaxis::host::Within;
using forceaxis::sim::KeyFormat;
using forceaxis::sim::TableFormat;

namespace {

py::object to_python(const toml::node &node);

double quantity(const std::string &text) {
  for (const std::string &unit : forceaxis::sim::unit_spellings()) {
    if (!forceaxis::sim::is_quantity(text)) break;
    const auto dimension = *forceaxis::sim::dimension_of(unit);
    if (const auto found = forceaxis::sim::read_quantity(text, dimension); found.value)
      return *found.value;
  }
  throw forceaxis::sim::InputError("quantity", text, "expected a number with a unit");
}

// Returns the permitted range of a key, such as "> 0" or "0 to 600", or an empty text.
std::string range_of(const KeyFormat &key) {
  using forceaxis::sim::Sign;
  if (!key.dimension) return "";
  if (key.high < forceaxis::sim::kUnlimited)
    return forceaxis::sim::number_text(key.low) + " to " + forceaxis::sim::number_text(key.high);
  switch (key.sign) {
    case Sign::not_zero:
      return "not 0";
    case Sign::not_negative:
      return ">= 0";
    case Sign::positive:
      return "> 0";
    default:
      return "";
  }
}

struct KeyTable {
  static constexpr const char *kName = "KeyTable";
  static constexpr const char *kMeaning =
      "A key of a table of an input file, as its reader declares it.";
  static constexpr bool kDict = true;
  KeyFormat k;

  std::string unit() const {
    const bool in_text = !k.dimension || k.form == "integer";
    return in_text ? "" : std::string(forceaxis::sim::unit_of(*k.dimension));
  }
  std::string range() const { return range_of(k); }
  bool required() const { return k.required(); }
  std::string default_text() const {
    return k.fallback ? forceaxis::sim::number_text(*k.fallback) : std::string(k.absent);
  }
  static constexpr auto items() {
    constexpr auto k = &KeyTable::k;
    return std::tuple{item("key", Within{k, &KeyFormat::key}),
                      item("form", Within{k, &KeyFormat::form}, "kind of value"),
                      item("unit", &KeyTable::unit),
                      item("range", &KeyTable::range),
                      item("required", &KeyTable::required),
                      item("default", &KeyTable::default_text, "value or effect without the key"),
                      item("meaning", Within{k, &KeyFormat::meaning})};
  }
};

struct FormatTable {
  static constexpr const char *kName = "FormatTable";
  static constexpr const char *kMeaning = "A table of an input file, as its reader declares it.";
  static constexpr bool kDict = true;
  std::string path;
  std::string header;
  TableFormat format;

  std::vector<KeyTable> keys() const {
    std::vector<KeyTable> all;
    for (const KeyFormat &key : format.keys) all.push_back({key});
    return all;
  }
  static constexpr auto items() {
    using F = FormatTable;
    constexpr auto format = &F::format;
    return std::tuple{item("path", &F::path),
                      item("header", &F::header, "as it is written in a file; empty for the file"),
                      item("meaning", Within{format, &TableFormat::meaning}),
                      item("when", Within{format, &TableFormat::when},
                           "condition under which a table has these keys"),
                      item("open", Within{format, &TableFormat::open},
                           "True if the table accepts keys with any name"),
                      item("keys", &F::keys)};
  }
};

// Adds a table, followed by the tables that it contains in the order of their declaration.
void add_tables(std::vector<FormatTable> &tables, const std::string &path,
                const std::string &header, const TableFormat &format) {
  tables.push_back({path, header, format});
  for (const auto *added : format.added) add_tables(tables, path, header, *added);
  for (const auto &key : format.keys) {
    if (key.table == nullptr) continue;
    const std::string name = (path.empty() ? "" : path + ".") + std::string(key.key);
    add_tables(tables, name, key.list ? "[[" + name + "]]" : "[" + name + "]", *key.table);
  }
}

py::object tables_of(const TableFormat &format, const TableFormat *parameter = nullptr) {
  std::vector<FormatTable> tables;
  add_tables(tables, "", "", format);
  if (parameter != nullptr)
    add_tables(tables, "parameters.NAME", "[parameters] NAME = { ... }", *parameter);
  return table::object(tables);
}

py::object to_python(const toml::node &node) {
  switch (node.type()) {
    case toml::node_type::table:
      return ::to_dict(*node.as_table());
    case toml::node_type::array: {
      py::list list;
      for (const toml::node &item : *node.as_array()) list.append(to_python(item));
      return list;
    }
    case toml::node_type::string:
      return py::str(node.ref<std::string>());
    case toml::node_type::integer:
      return py::int_(node.ref<std::int64_t>());
    case toml::node_type::floating_point:
      return py::float_(node.ref<double>());
    case toml::node_type::boolean:
      return py::bool_(node.ref<bool>());
    default: {
      std::ostringstream text;
      text << toml::node_view(node);
      return py::str(text.str());
    }
  }
}

}  // namespace

py::dict to_dict(const toml::table &table) {
  std::vector<std::pair<const toml::key *, const toml::node *>> entries;
  for (const auto &[key, node] : table) entries.emplace_back(&key, &node);
  std::stable_sort(entries.begin(), entries.end(), [](const auto &a, const auto &b) {
    const auto place = [](const toml::key *key) {
      const toml::source_position at = key->source().begin;
      return std::make_tuple(at.line, at.column);
    };
    return place(a.first) < place(b.first);
  });
  py::dict d;
  for (const auto &[key, node] : entries)
    d[py::str(key->str().data(), key->str().size())] = to_python(*node);
  return d;
}

void add_toml(py::module_ &m) {
  table::add_results<KeyTable, FormatTable>();
  m.def(
      "read_toml",
      [](const std::filesystem::path &file) {
        return to_dict(forceaxis::sim::parse_toml(file.string()));
      },
      py::arg("file"),
      "Returns a TOML file as a dict in the order of the file. Raises InputError with file, line "
      "and expected text.");
  m.def(
      "parse_toml",
      [](const std::string &text) {
        return to_dict(forceaxis::sim::parse_toml_text(text, "text"));
      },
      py::arg("text"), "Returns a TOML text as a dict, like read_toml().");
  m.def("quantity", &quantity, py::arg("text"),
        "Returns the value of a quantity such as \"400 kN/m\" in the SI unit of its dimension. "
        "Raises "
        "InputError.");
  m.def(
      "quantity_in",
      [](const std::string &text, const std::string &unit) -> std::optional<double> {
        const auto dimension = forceaxis::sim::dimension_of(unit);
        if (!dimension || !forceaxis::sim::is_quantity(text)) return std::nullopt;
        return forceaxis::sim::read_quantity(text, *dimension).value;
      },
      py::arg("text"), py::arg("unit"),
      "Returns the value of a quantity such as \"12 mm\" in a unit of units.hpp. Returns None if "
      "the "
      "text is not a quantity of this dimension.");
  m.def(
      "model_format",
      [] { return tables_of(forceaxis::sim::kModelFormat, &forceaxis::sim::kParameterFormat); },
      "Returns the declared tables of a model file.");
  m.def(
      "experiment_format",
      [] { return tables_of(forceaxis::sim::kFormat<forceaxis::host::Experiment>); },
      "Returns the declared tables of an experiment file.");
  m.def(
      "cycle_format",
      [] { return tables_of(forceaxis::sim::kFormat<forceaxis::host::CycleProgram>); },
      "Returns the declared tables of the program of a cycle.");
  m.def(
      "axis_linux_format", [] { return tables_of(forceaxis::axis_linux::kSettingsFormat); },
      "Returns the declared tables of the settings of axis_linux.");
  m.def(
      "units",
      [] {
        std::vector<std::pair<std::string, std::string>> units;
        for (const std::string &unit : forceaxis::sim::unit_spellings())
          units.emplace_back(unit, forceaxis::sim::phrase_of(*forceaxis::sim::dimension_of(unit)));
        return units;
      },
      "Returns every unit that a file may contain, with its dimension and the first unit of this "
      "dimension.");
}
