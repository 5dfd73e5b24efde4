#pragma once
#include "sim/model/format.hpp"

namespace forceaxis::axis_linux {

// The declared format of the file of settings of axis_linux.
extern const sim::TableFormat kSettingsFormat;

}  // namespace forceaxis::axis_linux
