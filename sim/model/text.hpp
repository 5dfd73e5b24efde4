#pragma once
// Functions that form the texts of messages.
#include <string>
#include <string_view>
#include <vector>

namespace forceaxis::sim {

/// Returns a text from a file or a bus in a form that is safe on a terminal. Control characters,
/// including U+0080 to U+009F in UTF-8, are replaced by blanks.
std::string one_line(std::string_view text);
std::string in_quotes(std::string_view text);
/// Returns the shortest decimal text from which the same double is read.
std::string number_text(double value);
/// Returns the names as "a, b, c". Returns "(none)" for an empty list.
std::string joined(const std::vector<std::string> &names);
/// Returns "; did you mean NAME?" with the most similar known name. Returns an empty text if no
/// known name is similar.
std::string suggestion(std::string_view wrong, const std::vector<std::string> &known);
/// Returns `"a", "b"; did you mean NAME, NAME?` with all wrong names and the known names that are
/// similar to a wrong name.
std::string wrong_names(const std::vector<std::string> &wrong,
                        const std::vector<std::string> &known);
/// Returns true if a name consists of at most 64 letters, digits and _, and does not begin with a
/// digit.
bool is_identifier(std::string_view name);

}  // namespace forceaxis::sim
