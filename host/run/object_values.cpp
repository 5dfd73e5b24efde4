#include "host/run/object_values.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <variant>

#include "firmware/objects/generated/axis_objects.h"
#include "host/run/bank_values.hpp"
#include "host/run/objects.hpp"
#include "host/run/shaper_values.hpp"
#include "sim/hybrid/mode.hpp"
#include "sim/model/elements/adc.hpp"
#include "sim/model/elements/contact.hpp"
#include "sim/model/elements/dac.hpp"
#include "sim/model/elements/drive.hpp"
#include "sim/model/elements/encoder.hpp"
#include "sim/model/elements/force.hpp"
#include "sim/model/toml.hpp"

namespace forceaxis::host {
namespace {

using sim::Dimension;

// The scale from a physical quantity to an object: value in the unit of the object = quantity in SI
// units * per_unit.
struct Scale {
  Dimension dimension;
  double per_unit;
};

// Text for a message that states why a quantity cannot be converted for an object.
using Obstacle = std::string;

class Scales {
 public:
  Scales(const sim::Model &model, std::int32_t force_sign, bool drive_moved)
      : encoder_(model.encoder),
        codes_per_volt_(1.0 / model.dac->volts_per_code()),
        drive_moved_(drive_moved) {
    if (const auto &adc = model.adc[0]) {
      for (const sim::SignalInfo &signal : model.signal_list())
        if (signal.name == adc->signal) reading_ = signal.dimension;
      counts_per_reading_ = force_sign / (adc->per_count * (1 << (adc->bits - 8)));
    }
  }

  std::variant<Scale, Obstacle> of(const axis_object_meta_t &meta) const {
    const std::string_view unit = meta.unit;
    if (unit == "Hz") return Scale{Dimension::frequency, 1.0};
    if (unit == "Hz/s") return Scale{Dimension::sweep, 1.0};
    if (unit == "ms") return Scale{Dimension::time, 1e3};
    if (unit == "us") return Scale{Dimension::time, 1e6};
    if (unit == "tick") return Scale{Dimension::time, kTicks};
    if (unit == "mN") return Scale{Dimension::force, 1e3};
    if (unit == "uN") return Scale{Dimension::force, 1e6};
    if (unit == "code") return Scale{Dimension::voltage, codes_per_volt_};
    if (of_rated_force(meta.name)) return Scale{Dimension::force, 1e6 / rated_force_mN_};
    auto found =
        unit.substr(0, 5) == "count" || unit.substr(0, 4) == "code"
            ? of_counts(meta)
            : std::variant<Scale, Obstacle>("the object measures no quantity of the model");
    if (auto *scale = std::get_if<Scale>(&found); scale != nullptr && meta.min >= 0)
      scale->per_unit = std::fabs(scale->per_unit);
    return found;
  }

  /// Sets the rated force in mN. Forces in per mille are relative to the rated force.
  void set_rated_force(double rated_force_mN) { rated_force_mN_ = rated_force_mN; }

 private:
  static constexpr double kTicks = sim::kTickRateHz;

  static bool of_rated_force(std::string_view name) {
    return name == "target_force" || name == "force_offset" || name == "force_limit" ||
           name == "force_limit_positive" || name == "force_limit_negative";
  }

  std::variant<Scale, Obstacle> of_counts(const axis_object_meta_t &meta) const {
    const std::string_view unit = meta.unit;
    const std::string_view name = meta.name;
    const bool of_force = std::string_view(meta.quantity) == "force";
    const bool gain = unit == "code/count" && of_force;
    const bool of_reading = unit == "count" && of_force;
    const bool of_both = name == "stiffness" || name == "damping";
    if (gain || of_reading || of_both) {
      if (!reading_) return "the model has no ADC 0";
      if (of_reading) return Scale{*reading_, counts_per_reading_};
      if (*reading_ != Dimension::force) return "ADC 0 of the model does not measure a force";
      if (gain) return Scale{Dimension::volt_per_force, codes_per_volt_ / counts_per_reading_};
    }
    if (!encoder_) return "the model has no encoder";
    if (name == "encoder_increments") return "the object is not a position";
    const double scale = encoder_->scale;
    if (name == "stiffness") return Scale{Dimension::stiffness, counts_per_reading_ / scale};
    if (name == "damping") return Scale{Dimension::damping, counts_per_reading_ * kTicks / scale};
    if (unit == "code/count") return Scale{Dimension::volt_per_length, codes_per_volt_ / scale};
    if (unit == "code tick/count")
      return Scale{Dimension::volt_per_velocity, codes_per_volt_ * kTicks / scale};
    if (drive_moved_ && std::string_view(meta.part) == "drive" && meta.min < 0 &&
        name != "home_offset")
      return "polarity or home_offset is not 0, so the object differs from the position of the "
             "model";
    if (unit == "count") return Scale{Dimension::length, scale};
    if (unit == "count/s") return Scale{Dimension::velocity, scale};
    if (unit == "count/s^2") return Scale{Dimension::acceleration, scale};
    if (unit == "count/tick") return Scale{Dimension::velocity, scale / kTicks};
    if (unit == "count/tick^2") return Scale{Dimension::acceleration, scale / (kTicks * kTicks)};
    return "the unit of this object has no conversion";
  }

  sim::Boxed<sim::Encoder> encoder_;
  double codes_per_volt_;
  bool drive_moved_;
  double rated_force_mN_ = 0.0;
  std::optional<Dimension> reading_;
  double counts_per_reading_ = 0.0;
};

// A value for an object, and the text in the file from which the value was converted.
struct Value {
  double number;
  bool converted;      // true: the number was converted from a quantity and must be rounded
  std::string origin;  // Text of the value in the file, for error messages: " (\"75 N\")", or
                       // empty.
};

// Refuses a text that is not a quantity and not the name of a parameter.
[[noreturn]] void fail_unknown(sim::Section &section, const std::string &name,
                               const std::string &text, const axis_object_meta_t &meta,
                               const std::variant<Scale, Obstacle> &scale) {
  const auto names = section.source().parameter_names();
  std::string expected = "a number in " + std::string(meta.unit);
  if (const auto *known = std::get_if<Scale>(&scale))
    expected += ", a quantity in " + std::string(sim::unit_of(known->dimension));
  section.fail(name, "expected " + expected + " or a parameter out of " + sim::joined(names) +
                         ", got " + sim::in_quotes(text) + sim::suggestion(text, names) +
                         "; define the parameter or correct its name");
}

Value read_value(sim::Section &section, const std::string &name, const toml::node &node,
                 const axis_object_meta_t &meta, const Scales &scales) {
  if (node.is_number()) return {*node.value<double>(), false, ""};
  const std::string advice = "; write a number in " + std::string(meta.unit);
  if (!node.is_string())
    section.fail(name, "expected a number in " + std::string(meta.unit) + ", got " +
                           sim::kind_of(node) + advice);
  const std::string &text = node.ref<std::string>();
  std::optional<Dimension> dimension;
  if (sim::is_quantity(text)) {
    const sim::QuantityText parts = sim::split_quantity(text);
    if (parts.unit == meta.unit) return {parts.number, false, ""};
  } else {
    const sim::Parameter *parameter = section.source().find(text);
    dimension = parameter != nullptr ? sim::dimension_of(parameter->unit) : std::nullopt;
    if (dimension == Dimension::count || dimension == Dimension::ratio)
      return {section.value(name, *dimension, sim::Sign::any), false, ""};
  }
  const auto scale = scales.of(meta);
  if (!sim::is_quantity(text) && !dimension) fail_unknown(section, name, text, meta, scale);
  if (const auto *obstacle = std::get_if<Obstacle>(&scale)) {
    section.fail(name, "expected a number in " + std::string(meta.unit) + ", got " +
                           sim::in_quotes(text) + ", and " + *obstacle + advice);
  }
  const auto [measures, per_unit] = std::get<Scale>(scale);
  return {section.value(name, measures, sim::Sign::any) * per_unit, true,
          " (" + sim::in_quotes(text) + ")"};
}

ObjectWrite read_object(sim::Section &section, const std::string &name, const toml::node &node,
                        const Scales &scales) {
  const std::uint16_t object = *find_object(name);
  const axis_object_meta_t &meta = object_meta(object);
  if (!object_writable(object))
    section.fail(name, "expected an object that can be written, got a signal; remove this key");
  const std::string texts = meta.enum_texts;
  if (const auto text = node.value_exact<std::string>(); text && !texts.empty()) {
    const auto value = enum_value(object, *text);
    if (!value)
      section.fail(name, "expected one of " + texts + ", got " + sim::in_quotes(*text) +
                             sim::suggestion(*text, enum_texts(object)) +
                             "; choose one of these texts");
    return {object, *value};
  }
  if (const auto flag = node.value_exact<bool>(); flag && meta.max == 1)
    return {object, *flag ? 1 : 0};
  const Value value = read_value(section, name, node, meta, scales);
  const bool whole =
      value.converted || meta.scale != 1.0 || value.number == std::floor(value.number);
  const double raw = std::floor(value.number / meta.scale + 0.5);
  const bool inside =
      value.converted || (value.number >= meta.scale * static_cast<double>(meta.min) &&
                          value.number <= meta.scale * static_cast<double>(meta.max));
  if (!(inside && whole && raw >= static_cast<double>(meta.min) &&
        raw <= static_cast<double>(meta.max)))
    section.fail(name, std::string("expected a ") + (meta.scale == 1.0 ? "whole " : "") +
                           "number " +
                           sim::number_text(meta.scale * static_cast<double>(meta.min)) + " to " +
                           sim::number_text(meta.scale * static_cast<double>(meta.max)) + " " +
                           meta.unit + ", got " + sim::number_text(value.number) + value.origin +
                           "; choose a value in that range");
  return {object,
          static_cast<std::int32_t>(static_cast<std::uint32_t>(static_cast<std::int64_t>(raw)))};
}

bool is_table_of_objects(std::string_view key) { return bank_of_key(key) || shaper_of_key(key); }

// Returns the keys of the table, without the keys of banks and shapers. Each returned key must be
// the name of an object.
std::vector<std::string> object_names(const sim::Section &section) {
  std::vector<std::string> names;
  std::vector<std::string> unknown;
  for (const auto &[key, node] : section.table()) {
    if (is_table_of_objects(key.str())) continue;
    names.emplace_back(key.str());
    if (!find_object(names.back())) unknown.push_back(names.back());
  }
  if (!unknown.empty()) {
    std::vector<std::string> known;
    for (const axis_object_meta_t &meta : axis_objects_meta) known.emplace_back(meta.name);
    for (const sim::KeyFormat &key : section.format().keys) known.emplace_back(key.key);
    section.fail(unknown.front(), "expected the name of a firmware object, got " +
                                      sim::wrong_names(unknown, known) +
                                      "; `list_objects` lists them");
  }
  return names;
}

}  // namespace

std::vector<ObjectWrite> read_objects(sim::Section &section, const sim::Model &model,
                                      const std::vector<ObjectWrite> &before) {
  const std::vector<std::string> names = object_names(section);
  const auto written = [&](std::string_view name) -> double {
    const std::uint16_t object = *find_object(name);
    if (const toml::node *node = section.table().get(name); node != nullptr)
      // If the value is a quantity or the name of a parameter, it is assumed to differ from 0.
      return node->value<double>().value_or(1.0);
    for (const ObjectWrite &w : before)
      if (w.object == object) return w.raw;
    return static_cast<double>(object_meta(object).initial);
  };
  Scales scales(model, written("force_sign") < 0 ? -1 : 1,
                written("polarity") != 0.0 || written("home_offset") != 0.0);
  // The value of rated_force in the table can be a quantity.
  const std::string rated = "rated_force";
  const toml::node *own = section.table().get(rated);
  scales.set_rated_force(own == nullptr ? written(rated)
                                        : read_object(section, rated, *own, scales).raw);
  std::vector<ObjectWrite> writes;
  std::vector<BankValues> banks;
  const auto add = [&writes](const std::vector<ObjectWrite> &more) {
    writes.insert(writes.end(), more.begin(), more.end());
  };
  for (const auto &[key, node] : section.table()) {
    if (!is_table_of_objects(key.str())) continue;
    section.one(key.str(), [&, &key = key](sim::Section &values) {
      if (const auto bank = bank_of_key(key.str())) {
        banks.push_back(read_bank(values, *bank));
        add(banks.back().writes);
      } else {
        add(read_shaper(values, *shaper_of_key(key.str())));
      }
    });
  }
  for (const std::string &name : names)
    writes.push_back(read_object(section, name, *section.find(name), scales));
  const auto raw = [&](std::uint16_t object) -> std::int32_t {
    for (const std::vector<ObjectWrite> *list : {&std::as_const(writes), &before})
      for (const ObjectWrite &w : *list)
        if (w.object == object) return w.raw;
    return static_cast<std::int32_t>(object_meta(object).initial);
  };
  for (const BankValues &bank : banks)
    if (bank.certified)
      add(certificate_of_bank(bank, raw(AXIS_OBJ_ADC_BITS), raw(AXIS_OBJ_FORCE_SCALE)));
  const auto stage = [](const ObjectWrite &w) {
    const axis_object_meta_t &meta = object_meta(w.object);
    return std::string_view(meta.name) == "mode" ? 2 : std::string_view(meta.kind) == "command";
  };
  std::stable_sort(writes.begin(), writes.end(),
                   [&](const ObjectWrite &a, const ObjectWrite &b) { return stage(a) < stage(b); });
  return writes;
}

}  // namespace forceaxis::host
