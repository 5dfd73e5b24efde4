#pragma once
// The declared format of an input file: every table and key that its reader accepts.
//
// A Section (section.hpp) uses these declarations to read a file. A tool uses the same declarations
// to write docs/guide/reference, so every key that the program reads has a documented meaning. All
// declarations are constants that exist until the program ends.
#include <limits>
#include <optional>
#include <span>
#include <string_view>

#include "sim/model/units.hpp"

namespace forceaxis::sim {

/// The permitted sign of a number. Every number must be finite, and its magnitude must be 0 or from
/// 1e-30 to 1e30.
enum class Sign { any, not_zero, not_negative, positive };

/// Returns the description of a permitted sign for messages, such as "a finite number > 0".
std::string_view sign_text(Sign sign);

struct TableFormat;

inline constexpr double kUnlimited = std::numeric_limits<double>::infinity();

/// Declaration of one key of a table.
struct KeyFormat {
  std::string_view key;
  /// Kind of value, such as "number". For a choice, the list of the permitted texts: "a, b, c".
  std::string_view form;
  /// Effect if the file omits the key, such as "not limited". Empty if the key is required.
  std::string_view absent;
  std::string_view meaning;  ///< meaning of the key, one complete sentence
  std::optional<Dimension> dimension = std::nullopt;
  Sign sign = Sign::any;
  /// Smallest permitted number as the value of the key.
  double low = -kUnlimited;
  /// Largest permitted number as the value of the key.
  double high = kUnlimited;
  /// Number that the reader uses if the file omits the key.
  std::optional<double> fallback = std::nullopt;
  /// Format of the table or tables, if the value of the key is a table or a list of tables.
  const TableFormat *table = nullptr;
  bool list = false;  ///< The value of the key is a list of tables, [[key]].

  /// Name of another key of the same table that this key needs to have a meaning. Empty if this key
  /// needs no other key.
  std::string_view beside = {};
  bool needed_beside = false;  ///< True: if a table has the other key `beside`, the table must
                               ///< also have this key.
  bool rising = false;  ///< True: the value is a list of numbers, which must be in ascending order.

  /// Advice to the user in the message about a text that is not a permitted choice.
  std::string_view advice = {};
  /// Kind of table, such as "element", in which every name is unique. Empty if names may repeat.
  std::string_view unique = {};
  /// Unit of the number: its own unit, the unit of the signal that the table names, or that unit
  /// per ADC code.
  enum class Unit { own, of_signal, of_signal_per_count } unit = Unit::own;

  constexpr bool required() const { return absent.empty() && !fallback; }
};

/// Declaration of a table. If one key has a certain value, the table can have further keys.
struct TableFormat {
  std::string_view meaning;
  std::span<const KeyFormat> keys;
  /// True if the table accepts keys with any name.
  bool open = false;
  /// Condition under which a table has these keys, such as "type = perfect".
  std::string_view when = {};
  std::span<const TableFormat *const> added = {};

  const KeyFormat *find(std::string_view key) const;
};

namespace format {

/// Declares a key for a number that is required and has the permitted sign `sign`.
constexpr KeyFormat needed(std::string_view key, Dimension dimension, Sign sign,
                           std::string_view meaning) {
  return {.key = key,
          .form = "number",
          .absent = "",
          .meaning = meaning,
          .dimension = dimension,
          .sign = sign};
}

/// Declares a key for a number with the permitted sign `sign` and the default value `fallback`.
constexpr KeyFormat number(std::string_view key, Dimension dimension, Sign sign, double fallback,
                           std::string_view meaning) {
  KeyFormat format = needed(key, dimension, sign, meaning);
  format.fallback = fallback;
  return format;
}

/// Declares a key for a number with the permitted sign `sign`. A file may omit the key.
constexpr KeyFormat optional(std::string_view key, Dimension dimension, Sign sign,
                             std::string_view absent, std::string_view meaning) {
  KeyFormat format = needed(key, dimension, sign, meaning);
  format.absent = absent;
  return format;
}

/// Declares a key for a number from `low` to `high`. The key is required if `absent` is empty.
constexpr KeyFormat ranged(std::string_view key, Dimension dimension, double low, double high,
                           std::string_view absent, std::string_view meaning) {
  KeyFormat format = optional(key, dimension, Sign::any, absent, meaning);
  format.low = low;
  format.high = high;
  return format;
}

/// Declares a key for a number from `low` to `high` with the default value `fallback`.
constexpr KeyFormat ranged(std::string_view key, Dimension dimension, double low, double high,
                           double fallback, std::string_view meaning) {
  KeyFormat format = ranged(key, dimension, low, high, "", meaning);
  format.fallback = fallback;
  return format;
}

/// Declares a key for an integer from `low` to `high`.
constexpr KeyFormat integer(std::string_view key, int low, int high, std::optional<double> fallback,
                            std::string_view meaning) {
  KeyFormat format = ranged(key, Dimension::ratio, low, high, "", meaning);
  format.form = "integer";
  format.fallback = fallback;
  return format;
}

/// Declares a key for an integer from `low` to `high`. A file may omit the key.
constexpr KeyFormat optional_integer(std::string_view key, int low, int high,
                                     std::string_view absent, std::string_view meaning) {
  KeyFormat format = integer(key, low, high, std::nullopt, meaning);
  format.absent = absent;
  return format;
}

/// Declares a key whose value is not a number. `form` describes the kind of value.
constexpr KeyFormat other(std::string_view key, std::string_view form, std::string_view absent,
                          std::string_view meaning) {
  return {.key = key, .form = form, .absent = absent, .meaning = meaning};
}

/// Declares a key for one number or for a list of numbers of the same dimension.
constexpr KeyFormat numbers(std::string_view key, Dimension dimension, Sign sign,
                            std::string_view absent, std::string_view meaning) {
  KeyFormat format = optional(key, dimension, sign, absent, meaning);
  format.form = "number or list";
  return format;
}

/// Declares a key whose value is one of the texts `names`, "a, b, c". It is required if `absent` is
/// empty; otherwise `absent` is the default.
constexpr KeyFormat choice(std::string_view key, std::string_view names, std::string_view absent,
                           std::string_view advice, std::string_view meaning) {
  KeyFormat format = other(key, names, absent, meaning);
  format.advice = advice;
  return format;
}

/// Declares a key for a number in the unit of the signal that the table names.
constexpr KeyFormat of_signal(std::string_view key, Sign sign, std::string_view absent,
                              std::string_view meaning,
                              KeyFormat::Unit unit = KeyFormat::Unit::of_signal) {
  KeyFormat format = other(key, "number", absent, meaning);
  format.sign = sign;
  format.unit = unit;
  return format;
}

/// Declares that the numbers of a list are in ascending order.
constexpr KeyFormat rising(KeyFormat format) {
  format.rising = true;
  return format;
}

/// Declares that a key is refused without the key `other`.
constexpr KeyFormat beside(std::string_view other, KeyFormat format) {
  format.beside = other;
  return format;
}

/// Declares that a key is refused without the key `other`, and required with it.
constexpr KeyFormat needed_beside(std::string_view other, KeyFormat format) {
  format.beside = other;
  format.needed_beside = true;
  return format;
}

/// Declares the name of a table of the kind `what`. No other table of this kind in the file may
/// have the same name.
constexpr KeyFormat name_of(std::string_view what, std::string_view meaning) {
  KeyFormat format = other("name", "identifier", "", meaning);
  format.unique = what;
  return format;
}

/// Declares a key whose value is a table [key] or a list of tables [[key]].
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
