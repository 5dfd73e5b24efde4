#pragma once
// TOML for Python: the product has one reader of it.
#include <pybind11/pybind11.h>
#include <toml++/impl/forward_declarations.h>

// dict, list, str, int, float, bool; keys in the order of the file; dates and times as text.
pybind11::dict to_dict(const toml::table &table);
