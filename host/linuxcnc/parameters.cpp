// Reads a file of `forceaxis axis params dump` for the component of LinuxCNC.
// host/python/forceaxis/axis/parameter_file.py describes the format.
#include "firmware/port/linuxcnc/parameters.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include "host/run/objects.hpp"
#include "sim/model/section.hpp"
#include "sim/model/text.hpp"
#include "sim/model/toml.hpp"

namespace forceaxis::host {
namespace {

struct Write {
  std::string key;
  std::uint16_t object;
  std::int64_t raw;
};

class ParameterFile {
 public:
  explicit ParameterFile(std::string file) : file_(std::move(file)) {}

  // Returns the writes of all values in the file. The last write selects the bank of the force law.
  std::vector<Write> read() {
    tables_ = sim::parse_toml(file_);
    for (const auto &[group, node] : tables_) {
      if (group == "about" || group == "objects" || group == "canopen") continue;
      const toml::table *table = node.as_table();
      if (table == nullptr)
        fail(group.str(), "expected a table such as [axis], got " + sim::kind_of(node) +
                              "; move this line into a table");
      for (const auto &[key, value] : *table) read_entry(std::string(key.str()), value);
    }
    std::stable_partition(writes_.begin(), writes_.end(),
                          [](const Write &write) { return write.object != AXIS_OBJ_FORCE_BANK; });
    return std::move(writes_);
  }

  [[noreturn]] void fail(std::string_view key, const std::string &message) const {
    throw sim::InputError(file_, std::string(key), message);
  }

 private:
  void read_entry(const std::string &key, const toml::node &node) {
    const toml::array *list = node.as_array();
    if (list == nullptr) return read_value(key, key, node);
    for (std::size_t i = 0; i < list->size(); ++i)
      read_value(key, key + "_" + std::to_string(i + 1), *list->get(i));
  }

  void read_value(const std::string &key, const std::string &name, const toml::node &node) {
    const auto object = find_object(name);
    if (!object || object_meta(*object).stored == 0)
      fail(key, "expected a parameter that the axis can store, got " + sim::in_quotes(name) +
                    "; correct the name or remove this line");
    expect_same(key, object_meta(*object));
    writes_.push_back({key, *object, raw_value(key, *object, node)});
  }

  // Checks that the value has the meaning that it had when the file was written.
  void expect_same(const std::string &key, const axis_object_meta_t &meta) const {
    const toml::table *described = tables_["objects"][key].as_table();
    if (described == nullptr) return;
    const auto type = (*described)["type"].value_or(std::string(meta.type));
    const auto unit = (*described)["unit"].value_or(std::string(meta.unit));
    const double scale = (*described)["scale"].value_or(meta.scale);
    if (type != meta.type || unit != meta.unit || scale != meta.scale)
      fail(key,
           "expected type, unit and scale of this version in [objects], got others; dump "
           "the parameters again with this version");
  }

  std::int64_t raw_value(const std::string &key, std::uint16_t object,
                         const toml::node &node) const {
    const axis_object_meta_t &meta = object_meta(object);
    const auto text = node.value_exact<std::string>();
    const auto choice = text ? enum_value(object, *text) : std::nullopt;
    if (choice) return *choice;
    const std::vector<std::string> choices = enum_texts(object);
    const auto number = node.is_number() ? node.value<double>() : std::nullopt;
    if (!number || !choices.empty() || !std::isfinite(*number))
      fail(key, "expected " + (choices.empty() ? "a number" : "one of " + sim::joined(choices)) +
                    ", got " + (text ? sim::in_quotes(*text) : sim::kind_of(node)) +
                    "; correct this value");
    const double raw = std::nearbyint(*number / meta.scale);
    if (raw < static_cast<double>(meta.min) || raw > static_cast<double>(meta.max))
      fail(key, "expected a number from " + bound(meta, meta.min) + " to " + bound(meta, meta.max) +
                    ", got " + sim::number_text(*number) + "; correct this value");
    return static_cast<std::int64_t>(raw);
  }

  static std::string bound(const axis_object_meta_t &meta, std::int64_t raw) {
    return sim::number_text(static_cast<double>(raw) * meta.scale);
  }

  std::string file_;
  toml::table tables_;
  std::vector<Write> writes_;
};

// Writes all values. Values that limit each other are written in several rounds.
void load(fw_t *firmware, const char *name) {
  ParameterFile file(name);
  std::vector<Write> remaining = file.read();
  while (!remaining.empty()) {
    const std::size_t before = remaining.size();
    std::erase_if(remaining, [firmware](const Write &write) {
      return fw_object_write(firmware, FW_SOURCE_LOCAL, write.object,
                             static_cast<std::int32_t>(write.raw)) == FW_OK;
    });
    if (remaining.size() == before)
      file.fail(remaining.front().key,
                "expected a value that the firmware accepts with the other values, got " +
                    std::to_string(remaining.front().raw) + " (raw); correct this value");
  }
}

}  // namespace
}  // namespace forceaxis::host

const char *parameters_load(fw_t *firmware, const char *file) {
  static std::string text;
  try {
    forceaxis::host::load(firmware, file);
    return nullptr;
  } catch (const std::exception &error) {
    text = error.what();
    return text.c_str();
  }
}
