#pragma once
// The TOML reader for Python. C++ and Python use the same parser.
#include <pybind11/pybind11.h>

#include "sim/model/toml_forward.hpp"

// Returns values of type dict, list, str, int, float or bool. Keys have the order of the file.
// Dates and times become texts.
pybind11::dict to_dict(const toml::table &table);
