#pragma once
// The format of an experiment's file. [expect] is declared where it is read, in
// forceaxis.experiments.expect.
#include "sim/model/format.hpp"

namespace forceaxis::host {

inline constexpr double kLongestRun_s = 600;

extern const sim::TableFormat kExperimentFormat;

}  // namespace forceaxis::host
