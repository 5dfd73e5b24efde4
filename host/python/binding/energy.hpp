#pragma once
// Converts the energy balance of a plant or a run for Python.
#include "host/python/binding/table.hpp"
#include "host/run/item.hpp"
#include "sim/hybrid/plant.hpp"

struct Energy {
  static constexpr const char *kName = "Energy";
  static constexpr const char *kMeaning = "Balance of the mechanical energy of a plant or a run.";
  forceaxis::sim::EnergyAudit audit;

  table::Ordered<double> dissipated() const {
    table::Ordered<double> all;
    for (const auto &damper : audit.dissipated) all.emplace_back(damper.element, damper.energy);
    return all;
  }
  static constexpr auto items() {
    using A = forceaxis::sim::EnergyAudit;
    using forceaxis::host::item;
    using forceaxis::host::Within;
    return std::tuple{
        item("initial_J", Within{&Energy::audit, &A::initial}),
        item("supplied_J", Within{&Energy::audit, &A::supplied}),
        item("dissipated_J", &Energy::dissipated, "{element of the model: dissipated energy in J}"),
        item("kinetic_J", Within{&Energy::audit, &A::kinetic}),
        item("stored_J", Within{&Energy::audit, &A::stored}),
        item("discarded_J", Within{&Energy::audit, &A::discarded}),
        item("residual_J", Within{&Energy::audit, &A::residual})};
  }
};
