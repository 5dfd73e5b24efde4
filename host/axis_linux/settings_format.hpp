#pragma once
#include "sim/model/format.hpp"

namespace forceaxis::axis_linux {

// The declared format of the settings file that axis_linux reads.
extern const sim::TableFormat kSettingsFormat;

}  // namespace forceaxis::axis_linux
