#pragma once
// Functions for the texts of messages.
#include <string>
#include <string_view>
#include <vector>

namespace forceaxis::sim {

/// Returns a text from a file or a bus in a form that is safe on a terminal: control characters,
/// including U+0080 to U+009F in UTF-8, become blanks.
std::string one_line(std::string_view text);
std::string in_quotes(std::string_view text);
/// Returns the shortest decimal number that reads back as the same double.
std::string number_text(double value);
/// Returns "a, b, c", or "(none)" for an empty list.
std::string joined(const std::vector<std::string> &names);
/// Returns "; did you mean NAME?" with the nearest known name, or an empty text if none is near.
std::string suggestion(std::string_view wrong, const std::vector<std::string> &known);
/// Returns `"a", "b"; did you mean NAME, NAME?` with every wrong name, and with the known names
/// that are near to one of them.
std::string wrong_names(const std::vector<std::string> &wrong,
                        const std::vector<std::string> &known);
/// Returns whether a name consists of at most 64 letters, digits and _, and does not begin with a
/// digit.
bool is_identifier(std::string_view name);

}  // namespace forceaxis::sim
