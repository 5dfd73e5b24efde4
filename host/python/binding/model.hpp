#pragma once
// Loads a model with the overrides of a Python caller.
#include <filesystem>
#include <map>
#include <string>
#include <variant>
#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/text.hpp"

// Parameter name to a number in its own unit, or to a text: a quantity or another parameter's name.
using Overrides = std::map<std::string, std::variant<double, std::string>>;

// The model of a file with these overrides. Throws InputError, also for an override that nothing in
// the model uses: it would have no effect.
inline forceaxis::sim::Model load(const std::filesystem::path &file, const Overrides &overrides) {
  std::vector<forceaxis::sim::Override> values;
  for (const auto &[name, value] : overrides) values.push_back({name, value});
  forceaxis::sim::Model model = forceaxis::sim::load_model(file, values);
  std::vector<std::string> idle;
  std::vector<std::string> used;
  for (const auto &p : model.parameters) {
    if (p.used) used.push_back(p.name);
    if (p.overridden && !p.used) idle.push_back(p.name);
  }
  if (!idle.empty())
    throw forceaxis::sim::InputError(
        file.string(), "parameters." + idle.front(),
        "expected a parameter that the model uses (" + forceaxis::sim::joined(used) + "), " +
            (idle.size() == 1
                 ? std::string("this one changes nothing here")
                 : "got " + forceaxis::sim::joined(idle) + ", which change nothing here"));
  return model;
}
