#pragma once
// The declared format of a file: every table and key that a reader accepts.
//
// A Section (section.hpp) reads a file by these declarations, and the tool that writes
// docs/guide/reference reads them too. So a reader cannot read a key without a documented meaning.
// All declarations are constants that exist as long as the program.
#include <limits>
#include <optional>
#include <span>
#include <string_view>

#include "sim/model/units.hpp"

namespace forceaxis::sim {

/// The sign that a number may have. Every number must be finite, and either 0 or of a magnitude
/// from 1e-30 to 1e30.
enum class Sign { any, not_zero, not_negative, positive };

/// The text of a sign in messages, such as "a finite number > 0".
std::string_view sign_text(Sign sign);

struct TableFormat;

inline constexpr double kUnlimited = std::numeric_limits<double>::infinity();

/// Declaration of one key of a table.
struct KeyFormat {
  std::string_view key;
  /// Kind of value, such as "number"; for a choice, its texts: "a, b, c".
  std::string_view form;
  /// Effect of an omitted key, such as "not limited"; empty if the key is required.
  std::string_view absent;
  std::string_view meaning;  ///< one complete sentence
  std::optional<Dimension> dimension = std::nullopt;
  Sign sign = Sign::any;
  double low = -kUnlimited;  ///< smallest and largest permitted number
  double high = kUnlimited;
  std::optional<double> fallback = std::nullopt;  ///< value of an omitted number
  const TableFormat *table = nullptr;  ///< format of a value that is a table or a list of tables
  bool list = false;                   ///< The value is a list of tables, [[key]].

  constexpr bool required() const { return absent.empty() && !fallback; }
};

/// Declaration of a table. A value of one of its keys may add further keys to it.
struct TableFormat {
  std::string_view meaning;
  std::span<const KeyFormat> keys;
  bool open = false;           ///< The table accepts keys of any name.
  std::string_view when = {};  ///< the value that adds these keys, such as "type = perfect"
  std::span<const TableFormat *const> added = {};

  const KeyFormat *find(std::string_view key) const;
};

namespace format {

/// Declares a required number with a stated sign.
constexpr KeyFormat needed(std::string_view key, Dimension dimension, Sign sign,
                           std::string_view meaning) {
  return {.key = key,
          .form = "number",
          .absent = "",
          .meaning = meaning,
          .dimension = dimension,
          .sign = sign};
}

/// Declares a number with a stated sign and a default value.
constexpr KeyFormat number(std::string_view key, Dimension dimension, Sign sign, double fallback,
                           std::string_view meaning) {
  KeyFormat format = needed(key, dimension, sign, meaning);
  format.fallback = fallback;
  return format;
}

/// Declares a number with a stated sign that may be omitted.
constexpr KeyFormat optional(std::string_view key, Dimension dimension, Sign sign,
                             std::string_view absent, std::string_view meaning) {
  KeyFormat format = needed(key, dimension, sign, meaning);
  format.absent = absent;
  return format;
}

/// Declares a number from low to high. The key is required if `absent` is empty.
constexpr KeyFormat ranged(std::string_view key, Dimension dimension, double low, double high,
                           std::string_view absent, std::string_view meaning) {
  KeyFormat format = optional(key, dimension, Sign::any, absent, meaning);
  format.low = low;
  format.high = high;
  return format;
}

/// Declares a number from low to high with a default value.
constexpr KeyFormat ranged(std::string_view key, Dimension dimension, double low, double high,
                           double fallback, std::string_view meaning) {
  KeyFormat format = ranged(key, dimension, low, high, "", meaning);
  format.fallback = fallback;
  return format;
}

/// Declares an integer from low to high.
constexpr KeyFormat integer(std::string_view key, int low, int high, std::optional<double> fallback,
                            std::string_view meaning) {
  KeyFormat format = ranged(key, Dimension::ratio, low, high, "", meaning);
  format.form = "integer";
  format.fallback = fallback;
  return format;
}

/// Declares a value that is not a number. `form` describes the kind of value.
constexpr KeyFormat other(std::string_view key, std::string_view form, std::string_view absent,
                          std::string_view meaning) {
  return {.key = key, .form = form, .absent = absent, .meaning = meaning};
}

/// Declares one number or a list of numbers of one dimension.
constexpr KeyFormat numbers(std::string_view key, Dimension dimension, Sign sign,
                            std::string_view absent, std::string_view meaning) {
  KeyFormat format = optional(key, dimension, sign, absent, meaning);
  format.form = "number or list";
  return format;
}

/// Declares a table [key], or a list of tables [[key]].
constexpr KeyFormat table(std::string_view key, const TableFormat &format, bool list = false) {
  return {.key = key,
          .form = list ? "list of tables" : "table",
          .absent = "none",
          .meaning = format.meaning,
          .table = &format,
          .list = list};
}

}  // namespace format
}  // namespace forceaxis::sim
