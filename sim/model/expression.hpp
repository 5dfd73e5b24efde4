#pragma once
// Values of parameters that are products and quotients of others: "m / tau", "0.5 * k * r / 2".
//
// An expression is names of parameters and plain numbers with * or / between them, worked from left
// to right. Its dimension must be that of the parameter. Angles in rad are numbers; a frequency in
// Hz is no rate in rad/s, because it lacks the 2 pi.
#include <string>
#include <string_view>
#include <vector>

#include "sim/model/section.hpp"

namespace forceaxis::sim {

/// Whether a text is meant as an expression: a * or / follows its first name or number.
bool is_expression(std::string_view text);

/// The parameters that an expression names; none of a text that is no expression.
std::vector<std::string> names_in(std::string_view expression);

/// Computes the value of every parameter with an expression, those first that it refers to. Throws
/// InputError at parameters.NAME, or at set.NAME of `overrides_file` where an override gave it: an
/// unknown name, another dimension, a circle (its names), a value that is not finite.
void compute_expressions(Source &source, const std::string &overrides_file);

/// Marks what the expressions of used parameters refer to as used.
void use_expressions(Source &source);

}  // namespace forceaxis::sim
