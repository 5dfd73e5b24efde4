#include "host/python/binding/toml.hpp"

#include <pybind11/stl/filesystem.h>
#include <toml++/toml.h>

#include <algorithm>
#include <sstream>
#include <tuple>
#include <utility>
#include <vector>

#include "host/python/binding/parts.hpp"
#include "sim/model/section.hpp"
#include "sim/model/units.hpp"

namespace py = pybind11;

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
  m.def(
      "read_toml",
      [](const std::filesystem::path &file) {
        return to_dict(forceaxis::sim::parse_toml(file.string()));
      },
      py::arg("file"),
      "A TOML file as a dict in its order. Raises InputError: file, line, what was expected.");
  m.def(
      "parse_toml",
      [](const std::string &text) {
        return to_dict(forceaxis::sim::parse_toml_text(text, "text"));
      },
      py::arg("text"), "The same of a text.");
  m.def("quantity", &quantity, py::arg("text"),
        "\"400 kN/m\" in the unit that sim/model/units.hpp names first. Raises InputError.");
}
