#pragma once
// The declared format of a file: every table and key that a reader accepts.
//
// A Section (section.hpp) reads by these declarations, and docs/guide/reference is written from
// them, so that a key cannot be read without being documented. Everything here is constant and
// lives as long as the program.
#include <limits>
#include <optional>
#include <span>
#include <string_view>

#include "sim/model/units.hpp"

namespace forceaxis::sim {

/// The sign that a number may have. All are finite, and 0 or between 1e-30 and 1e30 in magnitude.
enum class Sign { any, not_zero, not_negative, positive };

/// "a finite number > 0" and the like, as messages say it.
std::string_view sign_text(Sign sign);

struct TableFormat;

inline constexpr double kUnlimited = std::numeric_limits<double>::infinity();

/// One key of a table.
struct KeyFormat {
  std::string_view key;
  std::string_view form;     ///< kind of value; of a choice its texts, "a, b, c"
  std::string_view absent;   ///< what holds without the key; empty: the key is required
  std::string_view meaning;  ///< one sentence, which ends with a point
  std::optional<Dimension> dimension = std::nullopt;
  Sign sign = Sign::any;
  double low = -kUnlimited;  ///< a number is in low..high
  double high = kUnlimited;
  std::optional<double> fallback = std::nullopt;  ///< the number that holds without the key
  const TableFormat *table = nullptr;             ///< of a table, or of each table of a list
  bool list = false;                              ///< a list of tables, [[key]]

  constexpr bool required() const { return absent.empty() && !fallback; }
};

/// A table. Further tables of keys may be added to it by one of its values.
struct TableFormat {
  std::string_view meaning;
  std::span<const KeyFormat> keys;
  bool open = false;           ///< takes keys of any name
  std::string_view when = {};  ///< the value that adds these keys to the table, "type = perfect"
  std::span<const TableFormat *const> added = {};

  const KeyFormat *find(std::string_view key) const;
};

namespace format {

/// A number of any size whose sign is stated; it must be given.
constexpr KeyFormat needed(std::string_view key, Dimension dimension, Sign sign,
                           std::string_view meaning) {
  return {.key = key,
          .form = "number",
          .absent = "",
          .meaning = meaning,
          .dimension = dimension,
          .sign = sign};
}

/// Such a number with a value that holds without it.
constexpr KeyFormat number(std::string_view key, Dimension dimension, Sign sign, double fallback,
                           std::string_view meaning) {
  KeyFormat format = needed(key, dimension, sign, meaning);
  format.fallback = fallback;
  return format;
}

/// Such a number that may be absent.
constexpr KeyFormat optional(std::string_view key, Dimension dimension, Sign sign,
                             std::string_view absent, std::string_view meaning) {
  KeyFormat format = needed(key, dimension, sign, meaning);
  format.absent = absent;
  return format;
}

/// A number in low..high; `absent` empty: it must be given.
constexpr KeyFormat ranged(std::string_view key, Dimension dimension, double low, double high,
                           std::string_view absent, std::string_view meaning) {
  KeyFormat format = optional(key, dimension, Sign::any, absent, meaning);
  format.low = low;
  format.high = high;
  return format;
}

/// The same with a value that holds without it.
constexpr KeyFormat ranged(std::string_view key, Dimension dimension, double low, double high,
                           double fallback, std::string_view meaning) {
  KeyFormat format = ranged(key, dimension, low, high, "", meaning);
  format.fallback = fallback;
  return format;
}

/// A whole number in low..high.
constexpr KeyFormat integer(std::string_view key, int low, int high, std::optional<double> fallback,
                            std::string_view meaning) {
  KeyFormat format = ranged(key, Dimension::ratio, low, high, "", meaning);
  format.form = "integer";
  format.fallback = fallback;
  return format;
}

/// Anything else than a number: `form` says what.
constexpr KeyFormat other(std::string_view key, std::string_view form, std::string_view absent,
                          std::string_view meaning) {
  return {.key = key, .form = form, .absent = absent, .meaning = meaning};
}

/// Numbers, one or a list, in a dimension.
constexpr KeyFormat numbers(std::string_view key, Dimension dimension, Sign sign,
                            std::string_view absent, std::string_view meaning) {
  KeyFormat format = optional(key, dimension, sign, absent, meaning);
  format.form = "number or list";
  return format;
}

/// [key], or of a list [[key]].
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
