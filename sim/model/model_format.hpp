#pragma once
// The format of a model file.
#include "sim/model/format.hpp"

namespace forceaxis::sim {

extern const TableFormat kModelFormat;
/// One entry of [parameters].
extern const TableFormat kParameterFormat;
/// The file of parameters_file.
extern const TableFormat kSharedParametersFormat;
/// What the type of a [drive] adds to it.
extern const TableFormat kDcMotorFormat;
extern const TableFormat kFirstOrderFormat;
extern const TableFormat kPerfectFormat;

}  // namespace forceaxis::sim
