#pragma once
// Parameters whose value is a product or quotient of other parameters, such as "m / tau" or "0.5 *
// k * r / 2".
//
// An expression consists of names of parameters and plain numbers with * or / between them.
// Expressions are evaluated from left to right. The dimension of the result must be the dimension
// of the parameter. The unit rad is ignored. A frequency in Hz is not accepted as a rate in rad/s,
// because the factor 2 pi is missing.
#include <string>
#include <string_view>
#include <vector>

#include "sim/model/section.hpp"

namespace forceaxis::sim {

/// Returns true if a text has the form of an expression: the operator * or / follows the first name
/// or number.
bool is_expression(std::string_view text);

/// Returns the names of the parameters in an expression, or an empty list if the text is not an
/// expression.
std::vector<std::string> names_in(std::string_view expression);

/// Computes the value of every parameter that has an expression, in the order of their dependence.
/// Throws InputError for an unknown name, a wrong dimension, a circular reference or a value that
/// is not finite. The key of the error is parameters.NAME, or set.NAME of the file `overrides_file`
/// for an expression from an override.
void compute_expressions(Source &source, const std::string &overrides_file);

/// Marks every parameter as used whose name is in the expression of a used parameter.
void use_expressions(Source &source);

}  // namespace forceaxis::sim
