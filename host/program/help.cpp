#include "host/program/help.hpp"

#include <sstream>
#include <utility>
#include <vector>

namespace forceaxis::nodes {
namespace {

constexpr std::size_t kWidth = 80;
// Width of the column with the option names, in characters.
constexpr std::size_t kOptionWidth = 30;

// Divides a text into lines of at most kWidth characters, each with `indent` blanks at the start. A
// line break in the text starts a new paragraph.
std::vector<std::string> wrapped(const std::string &text, std::size_t indent) {
  std::vector<std::string> lines;
  std::istringstream paragraphs(text);
  for (std::string paragraph; std::getline(paragraphs, paragraph);) {
    if (!lines.empty()) lines.emplace_back();
    std::istringstream words(paragraph);
    std::string line;
    for (std::string word; words >> word;) {
      if (!line.empty() && line.size() + 1 + word.size() > kWidth) {
        lines.push_back(line);
        line.clear();
      }
      line += line.empty() ? std::string(indent, ' ') + word : " " + word;
    }
    lines.push_back(line);
  }
  return lines;
}

// Returns the type of an option and its permitted values. For example, "INT:INT in [1 - 6]" gives
// "INT" and "1 - 6", and "TEXT:{lcm,socketcan}" gives "TEXT" and "lcm,socketcan".
std::pair<std::string, std::string> value_of(const CLI::Option &option) {
  const std::string full = option.get_type_name();
  const std::size_t colon = full.find(':');
  std::string brackets;
  if (colon != std::string::npos) {
    brackets = full.substr(colon + 1);
    if (const std::size_t open = brackets.find_first_of("[{"); open != std::string::npos) {
      brackets = brackets.substr(open + 1, brackets.find_first_of("]}", open) - open - 1);
    }
  }
  if (const std::string own = option.get_default_str(); !own.empty()) {
    brackets += (brackets.empty() ? "default: " : "; default: ") + own;
  }
  const bool taken = option.get_type_size() != 0;
  return {taken ? full.substr(0, colon) : "", taken ? brackets : ""};
}

}  // namespace

std::string Help::make_help(const CLI::App *app, std::string name, CLI::AppFormatMode mode) const {
  std::string text = make_usage(app, std::move(name)) + "\n";
  for (const std::string &line : wrapped(app->get_description(), 2)) text += line + "\n";
  return text + make_positionals(app) + make_groups(app, mode) + "\n" + make_footer(app);
}

std::string Help::make_option(const CLI::Option *option, bool positional) const {
  const auto [value, brackets] = value_of(*option);
  std::string head = "  " + option->get_name(positional, !positional);
  if (!positional && !value.empty()) head += " " + value;
  if (option->get_required() && !positional) head += " REQUIRED";
  std::string text = option->get_description();
  if (!brackets.empty()) text += "  [" + brackets + "]";
  std::vector<std::string> lines = wrapped(text, kOptionWidth);
  if (head.size() + 2 > kOptionWidth) {
    lines.insert(lines.begin(), head);
  } else if (!lines.empty()) {
    lines[0].replace(0, head.size(), head);
  }
  std::string out;
  for (const std::string &line : lines) out += line + "\n";
  return out;
}

}  // namespace forceaxis::nodes
