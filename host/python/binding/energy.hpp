#pragma once
// Converts the energy balance to Python.
#include <pybind11/pybind11.h>

#include "sim/hybrid/plant.hpp"

inline pybind11::dict energy_dict(const forceaxis::sim::EnergyAudit &e) {
  pybind11::dict dissipated;
  for (const auto &damper : e.dissipated) dissipated[pybind11::str(damper.element)] = damper.energy;
  pybind11::dict d;
  d["initial_J"] = e.initial;
  d["supplied_J"] = e.supplied;
  d["dissipated_J"] = dissipated;
  d["kinetic_J"] = e.kinetic;
  d["stored_J"] = e.stored;
  d["discarded_J"] = e.discarded;
  d["residual_J"] = e.residual;
  return d;
}
