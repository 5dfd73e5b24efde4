#pragma once
// The TOML reader for Python, which uses the same parser as the C++ code.
#include <pybind11/pybind11.h>

#include "sim/model/toml_forward.hpp"

// Converts a TOML table to Python values of type dict, list, str, int, float or bool. The keys have
// the same order as in the file. Dates and times become texts.
pybind11::dict to_dict(const toml::table &table);
