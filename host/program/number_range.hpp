#pragma once
// A variant of CLI::Range for real numbers that refuses "nan". CLI::Range accepts "nan".
#include <CLI/CLI.hpp>
#include <cmath>
#include <string>

namespace forceaxis::nodes {

inline CLI::Validator real_range(double low, double high) {
  const CLI::Range range(low, high);
  return CLI::Validator(
      [range, low, high](std::string &text) {
        double value = 0;
        if (CLI::detail::lexical_cast(text, value) && std::isnan(value)) {
          return "Value " + text + " not in range [" + CLI::detail::to_string(low) + " - " +
                 CLI::detail::to_string(high) + "]";
        }
        return range(text);
      },
      range.get_description());
}

}  // namespace forceaxis::nodes
