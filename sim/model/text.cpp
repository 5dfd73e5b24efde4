#include "sim/model/text.hpp"

#include <algorithm>
#include <charconv>

namespace forceaxis::sim {
namespace {

// Returns the number of single-character edits that change one name to another name.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t up = row[j];
      row[j] = std::min({up + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0U : 1U)});
      diagonal = up;
    }
  }
  return row[b.size()];
}

// Returns the most similar known name, or an empty name. The similar name must differ by at most
// two edits, and by fewer edits than the wrong name has characters.
std::string nearest(std::string_view wrong, const std::vector<std::string> &known) {
  std::size_t best = std::min<std::size_t>(3, wrong.size());
  std::string text;
  for (const std::string &name : known) {
    if (wrong.size() > 64 || name.size() < 2) continue;
    const std::size_t distance = edit_distance(wrong, name);
    if (distance < best) {
      best = distance;
      text = name;
    }
  }
  return text;
}

}  // namespace

std::string one_line(std::string_view text) {
  std::string line(text);
  for (std::size_t i = 0; i < line.size(); ++i) {
    const auto byte = static_cast<unsigned char>(line[i]);
    const auto next = i + 1 < line.size() ? static_cast<unsigned char>(line[i + 1]) : 0U;
    if (byte < 0x20 || byte == 0x7f) line[i] = ' ';
    // A terminal interprets U+009B like ESC [, so the characters U+0080 to U+009F in UTF-8 are
    // replaced by blanks too.
    if (byte == 0xc2 && next >= 0x80 && next <= 0x9f) line[i] = line[i + 1] = ' ';
  }
  return line;
}

std::string in_quotes(std::string_view text) { return '"' + one_line(text) + '"'; }

std::string number_text(double value) {
  char text[40];
  const auto end = std::to_chars(text, text + sizeof text, value).ptr;
  return std::string(text, end);
}

std::string joined(const std::vector<std::string> &names) {
  std::string text;
  for (const std::string &name : names) {
    if (!text.empty()) text += ", ";
    text += name;
  }
  return text.empty() ? std::string("(none)") : text;
}

std::string suggestion(std::string_view wrong, const std::vector<std::string> &known) {
  const std::string name = nearest(wrong, known);
  return name.empty() ? name : "; did you mean " + name + "?";
}

std::string wrong_names(const std::vector<std::string> &wrong,
                        const std::vector<std::string> &known) {
  std::string text;
  std::string meant;
  for (const std::string &name : wrong) {
    text += (text.empty() ? "" : ", ") + in_quotes(name);
    const std::string near = nearest(name, known);
    if (!near.empty()) meant += (meant.empty() ? "; did you mean " : ", ") + near;
  }
  return meant.empty() ? text : text + meant + "?";
}

bool is_identifier(std::string_view name) {
  if (name.empty() || name.size() > 64) return false;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const char c = name[i];
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
    const bool digit = c >= '0' && c <= '9';
    if (!(letter || (digit && i > 0))) return false;
  }
  return true;
}

}  // namespace forceaxis::sim
