#pragma once
// The format of an experiment file. The table [expect] is declared in the Python module
// forceaxis.experiments.expect, which reads this table.
#include "sim/model/format.hpp"

namespace forceaxis::host {

inline constexpr double kLongestRun_s = 600;

extern const sim::TableFormat kExperimentFormat;

}  // namespace forceaxis::host
