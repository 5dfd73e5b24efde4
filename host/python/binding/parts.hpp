#pragma once
// Each of these functions adds a group of functions or classes to the Python module, from one
// source file.
#include <pybind11/pybind11.h>

void add_bench(pybind11::module_ &m);     // defined in bench.cpp
void add_contacts(pybind11::module_ &m);  // defined in contacts.cpp
void add_cycle(pybind11::module_ &m);     // defined in cycle.cpp
void add_drive402(pybind11::module_ &m);  // defined in drive402.cpp
void add_excite(pybind11::module_ &m);    // defined in excite.cpp
void add_fmu(pybind11::module_ &m);       // defined in fmu.cpp
void add_laws(pybind11::module_ &m);      // defined in laws.cpp
void add_linear(pybind11::module_ &m);    // defined in linear.cpp
void add_link(pybind11::module_ &m);      // defined in link.cpp
void add_live(pybind11::module_ &m);      // defined in live.cpp
void add_objects(pybind11::module_ &m);   // objects.cpp defines this function
void add_plant(pybind11::module_ &m);     // plant.cpp defines this function
void add_toml(pybind11::module_ &m);      // toml.cpp defines this function

/// SHA-256 of the source files of the firmware and of the simulator. hashes.cpp defines them, so
/// that only this file must be compiled again after a change of a hash.
extern const char *const kFirmwareHash;
extern const char *const kSimulatorHash;
