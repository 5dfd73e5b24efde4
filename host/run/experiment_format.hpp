#pragma once
// The format of an experiment file. The Python module forceaxis.experiments.expect declares the
// table [expect], because it reads it.
#include "sim/model/format.hpp"

namespace forceaxis::host {

inline constexpr double kLongestRun_s = 600;

extern const sim::TableFormat kExperimentFormat;

}  // namespace forceaxis::host
