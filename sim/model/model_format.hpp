#pragma once
// The format of a model file.
#include "sim/model/format.hpp"

namespace forceaxis::sim {

extern const TableFormat kModelFormat;
/// The format of one entry of [parameters].
extern const TableFormat kParameterFormat;
/// The format of the file that the key parameters_file names.
extern const TableFormat kSharedParametersFormat;
/// The keys that the type of a [drive] adds to its table.
extern const TableFormat kDcMotorFormat;
extern const TableFormat kFirstOrderFormat;
extern const TableFormat kPerfectFormat;

}  // namespace forceaxis::sim
