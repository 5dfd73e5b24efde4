#pragma once
#include <CLI/CLI.hpp>
#include <string>

namespace forceaxis::nodes {

// Formats --help as the verbs of `forceaxis` do: usage, description, options, example, in 80
// columns. A line break in a description begins a new paragraph.
class Help : public CLI::Formatter {
 public:
  std::string make_help(const CLI::App *app, std::string name,
                        CLI::AppFormatMode mode) const override;
  std::string make_option(const CLI::Option *option, bool positional) const override;
};

}  // namespace forceaxis::nodes
