#pragma once
// Loads a model with the overrides that a Python program has given.
#include <filesystem>
#include <map>
#include <string>
#include <variant>
#include <vector>

#include "sim/model/model.hpp"
#include "sim/model/text.hpp"

// New values of parameters, with the names of the parameters as keys. A value is a number in the
// unit of the parameter, or a text with a quantity or the name of another parameter.
using Overrides = std::map<std::string, std::variant<double, std::string>>;

// Returns the model of a file with these overrides. Throws InputError, also for an override of a
// parameter that the model does not use.
inline forceaxis::sim::Model load(const forceaxis::sim::ModelFile &file,
                                  const Overrides &overrides) {
  std::vector<forceaxis::sim::Override> values;
  for (const auto &[name, value] : overrides) values.push_back({name, value});
  forceaxis::sim::Model model = file.model(values);
  std::vector<std::string> idle;
  std::vector<std::string> used;
  for (const auto &p : model.parameters) {
    if (p.used) used.push_back(p.name);
    if (p.overridden && !p.used) idle.push_back(p.name);
  }
  if (!idle.empty())
    throw forceaxis::sim::InputError(
        model.file, "parameters." + idle.front(),
        "expected a parameter that the model uses (" + forceaxis::sim::joined(used) + "), " +
            (idle.size() == 1 ? std::string("this override has no effect")
                              : "got " + forceaxis::sim::joined(idle) + ", which have no effect"));
  return model;
}

inline forceaxis::sim::Model load(const std::filesystem::path &file, const Overrides &overrides) {
  return load(forceaxis::sim::ModelFile(file), overrides);
}
