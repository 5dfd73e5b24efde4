#pragma once
// The format of a model file.
#include "sim/model/format.hpp"

namespace forceaxis::sim {

extern const TableFormat kModelFormat;
/// The format of one parameter in the table [parameters].
extern const TableFormat kParameterFormat;
/// The format of the file whose name is the value of the key parameters_file.
extern const TableFormat kSharedParametersFormat;

}  // namespace forceaxis::sim
