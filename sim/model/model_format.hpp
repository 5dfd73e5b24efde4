#pragma once
// The format of a model file.
#include "sim/model/format.hpp"

namespace forceaxis::sim {

extern const TableFormat kModelFormat;
/// The format of one parameter in the table [parameters].
extern const TableFormat kParameterFormat;
/// The format of the file whose name is the value of the key parameters_file.
extern const TableFormat kSharedParametersFormat;
/// The further keys of the table [drive] for each type of drive.
extern const TableFormat kDcMotorFormat;
extern const TableFormat kFirstOrderFormat;
extern const TableFormat kPerfectFormat;
extern const TableFormat kTorqueFormat;
extern const TableFormat kVelocityFormat;
extern const TableFormat kStepperFormat;

}  // namespace forceaxis::sim
