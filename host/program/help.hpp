#pragma once
#include <CLI/CLI.hpp>
#include <string>

namespace forceaxis::nodes {

// Formats the text of --help like the commands of `forceaxis`: usage, description, options and
// example in 80 columns. A line break in a description starts a new paragraph.
class Help : public CLI::Formatter {
 public:
  std::string make_help(const CLI::App *app, std::string name,
                        CLI::AppFormatMode mode) const override;
  std::string make_option(const CLI::Option *option, bool positional) const override;
};

}  // namespace forceaxis::nodes
