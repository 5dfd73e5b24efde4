#pragma once
#include <pybind11/pybind11.h>

/// Adds `linear`, a model's matrices in one mode, to the module.
void add_linear(pybind11::module_ &m);
