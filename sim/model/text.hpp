#pragma once
// Pieces of messages.
#include <string>
#include <string_view>
#include <vector>

namespace forceaxis::sim {

/// A text from a file or a bus for a terminal: control characters, also those of U+0080 to U+009F
/// in UTF-8, become blanks.
std::string one_line(std::string_view text);
std::string in_quotes(std::string_view text);
/// The shortest decimal that reads back the same.
std::string number_text(double value);
/// "a, b, c", or "(none)".
std::string joined(const std::vector<std::string> &names);
/// "; did you mean NAME?" for the nearest of the known names, or nothing.
std::string suggestion(std::string_view wrong, const std::vector<std::string> &known);
/// `"a", "b"; did you mean NAME, NAME?`: every wrong name, and those that are near a known one.
std::string wrong_names(const std::vector<std::string> &wrong,
                        const std::vector<std::string> &known);
/// Letters, digits and _, at most 64, with no digit in front.
bool is_identifier(std::string_view name);

}  // namespace forceaxis::sim
