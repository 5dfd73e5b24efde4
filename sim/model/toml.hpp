#pragma once

// The complete library toml++, with the assertions of toml_forward.hpp.

#include "sim/model/toml_forward.hpp"

#pragma push_macro("NDEBUG")
#undef NDEBUG
#include <toml++/toml.h>
#pragma pop_macro("NDEBUG")
