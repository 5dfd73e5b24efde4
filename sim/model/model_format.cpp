#include "sim/model/model_format.hpp"

#include <algorithm>

#include "sim/model/elements/all.hpp"

namespace forceaxis::sim {
namespace {

using format::other;
using format::table;

constexpr KeyFormat kParameterKeys[] = {
    other("value", "number, quantity or product", "",
          "Value of the parameter: a number in `unit`; a quantity such as \"12 mm\"; or a "
          "product or quotient of other parameters and numbers, such as \"m / tau\", with the "
          "dimension of `unit`."),
    other("unit", "unit", "", "Unit of the parameter, one of the units of this page."),
    other("source", "text", "none", "Source of the value."),
    other("documentation", "true or false", "false",
          "true: the parameter is for information only, and the model need not use it."),
};
constexpr TableFormat kParameter{"A parameter: a named value to which keys may refer.",
                                 kParameterKeys};

constexpr TableFormat kParameters{
    "Parameters by name. A parameter of this file takes precedence over one of "
    "parameters_file, and the model must use it.",
    {},
    true,
    {},
    {}};

constexpr KeyFormat kTitle = other("title", "text", "empty", "Title of the file.");
constexpr KeyFormat kShows = other("shows", "text", "empty", "What the file demonstrates.");

constexpr KeyFormat kModelKeys[] = {
    kTitle,
    kShows,
    other("parameters_file", "file name", "none",
          "A file in the same folder that has the table [parameters] for several models."),
    table("parameters", kParameters),
    table("body", kFormat<Body>, true),
    table("structure", kFormat<Structure>, true),
    table("spring", kFormat<Spring>, true),
    table("damper", kFormat<Damper>, true),
    table("contact", kFormat<Contact>, true),
    table("backlash", kFormat<Backlash>, true),
    table("stop", kFormat<Stop>, true),
    table("friction", kFormat<Friction>, true),
    table("brake", kFormat<Brake>, true),
    table("gravity", kFormat<Gravity>, true),
    table("cogging", kFormat<Cogging>, true),
    table("external", kFormat<External>, true),
    table("drive", kFormat<Drive>),
    table("machine_controller", kFormat<MachineController>),
    table("encoder", kFormat<Encoder>),
    table("switches", kFormat<Switches>),
    table("adc", kFormat<Adc>, true),
    table("dac", kFormat<Dac>),
};

constexpr KeyFormat kSharedKeys[] = {kTitle, kShows, table("parameters", kParameters)};

}  // namespace

constexpr TableFormat kParameterFormat = kParameter;
constexpr TableFormat kSharedParametersFormat{"Parameters of several models.", kSharedKeys};
constexpr TableFormat kModelFormat{"The model of a plant.", kModelKeys};

std::string_view sign_text(Sign sign) {
  switch (sign) {
    case Sign::not_zero:
      return "a finite number other than 0";
    case Sign::not_negative:
      return "a finite number >= 0";
    case Sign::positive:
      return "a finite number > 0";
    default:
      return "a finite number";
  }
}

const KeyFormat *TableFormat::find(std::string_view key) const {
  const auto found = std::find_if(keys.begin(), keys.end(),
                                  [key](const KeyFormat &format) { return format.key == key; });
  return found == keys.end() ? nullptr : &*found;
}

}  // namespace forceaxis::sim
