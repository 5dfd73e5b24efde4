#pragma once

// Forward declarations of the types of toml++. Every file of this project includes toml++ through
// this header or through toml.hpp. The parser of toml++ has an assertion that the text `a = [ } ]`
// violates, so this typing error in a file would abort the program. Here the assertion throws
// TomlParserStopped. The assertion is also active in builds with NDEBUG, in which toml++ would
// continue with undefined behaviour.

#include <stdexcept>

namespace forceaxis::sim {

// An assertion in the parser of toml++ has failed, because the parser can neither accept nor refuse
// the text.
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
