#pragma once

// Forward declarations of the types of toml++. Every file of this project includes toml++ through
// this header or through toml.hpp. The parser of toml++ asserts that a value begins at the position
// of a value. The text `a = [ } ]` violates this assertion, so a typing error would abort the
// program. Here the assertion throws TomlParserStopped, also in builds with NDEBUG, in which toml++
// would continue with undefined behaviour.

#include <stdexcept>

namespace forceaxis::sim {

// The parser of toml++ stopped at a text that it can neither accept nor refuse.
class TomlParserStopped : public std::logic_error {
 public:
  using std::logic_error::logic_error;
};

[[noreturn]] inline void toml_parser_stopped(const char *expected) {
  throw TomlParserStopped(expected);
}

}  // namespace forceaxis::sim

#pragma push_macro("NDEBUG")
#undef NDEBUG
#define TOML_ASSERT(expr) \
  (static_cast<bool>(expr) ? static_cast<void>(0) : ::forceaxis::sim::toml_parser_stopped(#expr))
#include <toml++/impl/forward_declarations.h>
#pragma pop_macro("NDEBUG")
