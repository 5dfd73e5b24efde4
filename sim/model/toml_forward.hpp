#pragma once

// The types of toml++ by name, as every file of this project includes them. The parser of toml++
// asserts that a value begins where a value is expected; `a = [ } ]` breaks that, so a user's
// typing error would abort the program. Here such an assertion throws TomlParserStopped, also in
// builds with NDEBUG, in which toml++ would go on with undefined behaviour.

#include <stdexcept>

namespace forceaxis::sim {

// The parser of toml++ stopped at text that it neither accepts nor refuses.
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
