#include "host/fmu/unit.hpp"

#include <limits>
#include <optional>

#include "host/fmu/firmware_unit.hpp"
#include "host/fmu/plant_unit.hpp"
#include "host/run/objects.hpp"
#include "sim/model/section.hpp"
#include "sim/model/toml.hpp"

extern "C" {
#include "firmware/core/axis_state.h"
}

namespace forceaxis::fmu {
namespace {

// Reads the values of forceaxis.unit. forceaxis has written this file, so a wrong value means that
// the file is damaged.
class Reader {
 public:
  explicit Reader(const std::filesystem::path &file)
      : file_(file.string()), table_(sim::parse_toml(file_)) {}

  std::string text(const char *key) const {
    return required(table_[key].value_exact<std::string>(), key);
  }
  std::int64_t number(const toml::node *node, const char *key, std::int64_t low,
                      std::int64_t high) const {
    if (node == nullptr) fail(key);
    const std::int64_t value = required(node->value_exact<std::int64_t>(), key);
    if (value < low || value > high) fail(key);
    return value;
  }
  const toml::array &array(const char *key) const {
    const toml::array *found = table_[key].as_array();
    if (found == nullptr) fail(key);
    return *found;
  }
  std::vector<sim::Override> overrides() const {
    const toml::table *set = table_["set"].as_table();
    if (set == nullptr) fail("set");
    std::vector<sim::Override> found;
    for (const auto &[name, node] : *set) {
      if (const auto text = node.value_exact<std::string>())
        found.push_back({std::string(name.str()), *text});
      else
        found.push_back({std::string(name.str()), required(node.value<double>(), "set")});
    }
    return found;
  }
  // Reads an object and its raw value from two elements of a row. `first` is the index of the first
  // of these elements.
  host::ObjectWrite write(const toml::node &row, std::size_t first, const char *key) const {
    const toml::array *places = row.as_array();
    if (places == nullptr || places->size() != first + 2) fail(key);
    const std::uint16_t object = this->object(*places->get(first), key);
    const std::int64_t raw =
        number(places->get(first + 1), key, std::numeric_limits<std::int32_t>::min(), UINT32_MAX);
    return {object, static_cast<std::int32_t>(raw)};
  }
  std::uint16_t object(const toml::node &name, const char *key) const {
    return required(host::find_object(required(name.value_exact<std::string>(), key)), key);
  }
  [[noreturn]] void fail(const char *key) const {
    throw sim::InputError(file_, key, "expected a unit of this version; write the unit again");
  }

  const std::string &file() const { return file_; }
  const toml::table &table() const { return table_; }

 private:
  template <class T>
  T required(const std::optional<T> &value, const char *key) const {
    if (!value) fail(key);
    return *value;
  }

  std::string file_;
  toml::table table_;
};

std::unique_ptr<Unit> read_firmware(const Reader &reader) {
  FirmwareFacts facts;
  facts.experiment.file = reader.file();
  for (const toml::node &row : reader.array("initial"))
    facts.experiment.initial.push_back(reader.write(row, 0, "initial"));
  for (const toml::node &row : reader.array("at")) {
    const host::ObjectWrite write = reader.write(row, 1, "at");
    host::Action &action = facts.experiment.actions.emplace_back();
    action.tick = reader.number(row.as_array()->get(0), "at", 0, host::kEndlessTicks);
    action.writes.push_back(write);
  }
  for (const toml::node &word : reader.array("program"))
    facts.program.push_back(
        static_cast<std::uint32_t>(reader.number(&word, "program", 0, UINT32_MAX)));
  for (const toml::node &name : reader.array("inputs"))
    facts.inputs.push_back(reader.object(name, "inputs"));
  facts.dac_bits = static_cast<int>(reader.number(reader.table().get("dac_bits"), "dac_bits",
                                                  AXIS_DAC_BITS_MIN, AXIS_DAC_BITS_MAX));
  return firmware_unit(std::move(facts));
}

}  // namespace

OpenedUnit open_unit(const std::filesystem::path &resources) {
  const Reader reader(resources / "forceaxis.unit");
  const std::string kind = reader.text("kind");
  if (kind == "firmware") return {read_firmware(reader), reader.text("token")};
  if (kind != "plant") reader.fail("kind");
  const std::int64_t seed = reader.number(reader.table().get("seed"), "seed", 0, INT32_MAX);
  return {plant_unit(resources / reader.text("model"), reader.overrides(),
                     static_cast<std::int32_t>(seed)),
          reader.text("token")};
}

}  // namespace forceaxis::fmu
