#pragma once
// TOML for Python: the product has one reader of it.
#include <pybind11/pybind11.h>

#include "sim/model/toml_forward.hpp"

// dict, list, str, int, float, bool; keys in the order of the file; dates and times as text.
pybind11::dict to_dict(const toml::table &table);
