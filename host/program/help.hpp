#pragma once
#include <CLI/CLI.hpp>
#include <string>

namespace forceaxis::nodes {

// --help in the form that the verbs of `forceaxis` have: usage, what it does, options, example,
// within 80 columns. A new line in a description begins a paragraph.
class Help : public CLI::Formatter {
 public:
  std::string make_help(const CLI::App *app, std::string name,
                        CLI::AppFormatMode mode) const override;
  std::string make_option(const CLI::Option *option, bool positional) const override;
};

}  // namespace forceaxis::nodes
