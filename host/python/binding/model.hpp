#pragma once
// A model as Python asks for it.
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "sim/model/model.hpp"

using Overrides = std::map<std::string, double>;  // parameter -> value, in its own unit

// The model of a file under these overrides. Throws InputError, also for an override that nothing
// in the model refers to: it would change nothing unnoticed.
inline forceaxis::sim::Model load(const std::filesystem::path &file, const Overrides &overrides) {
  std::vector<forceaxis::sim::Override> values;
  for (const auto &[name, value] : overrides) values.push_back({name, value});
  forceaxis::sim::Model model = forceaxis::sim::load_model(file, values);
  for (const auto &idle : model.parameters) {
    if (!idle.overridden || idle.used) continue;
    std::string names;
    for (const auto &p : model.parameters)
      if (p.used) names += (names.empty() ? "" : ", ") + p.name;
    throw forceaxis::sim::InputError(
        file.string(), "parameters." + idle.name,
        "expected a parameter that the model uses (" + names + "), this one changes nothing here");
  }
  return model;
}
