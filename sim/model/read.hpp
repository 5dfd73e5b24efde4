#pragma once
// Reads a table of a file into a struct by the rows of the struct (field.hpp).
//
// A key that the file omits leaves its member as it is, or sets the default of its declaration.
// Every value is checked by its declaration: its kind, its unit, its sign or range, and the other
// key that it needs. Rules between keys are in complete() of the struct.
//
// `names` is a Names, or a struct that is derived from Names and also has what the values of one
// kind of file need. For a member of another type than those below, the file's reader declares a
// value_of() of this type beside the derived struct.
#include <cstddef>
#include <optional>
#include <set>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "sim/model/elements/ends.hpp"
#include "sim/model/field.hpp"
#include "sim/model/section.hpp"
#include "sim/model/signal.hpp"

namespace forceaxis::sim {

/// Names to which a table may refer.
struct Names {
  std::vector<std::string> points;  ///< names of all bodies, followed by the names of all ports
  std::size_t bodies = 0;
  std::vector<SignalInfo> signals;
  std::optional<Dimension> signal;  ///< unit of the signal whose name is in the present table

  /// All names that are already taken, each with its kind of table: (kind, name). Elements and
  /// ports of a model have the kind "element".
  std::set<std::pair<std::string, std::string>> taken;

  /// Takes a name for a table of the kind `what`. Throws InputError if another table of this kind
  /// has the name.
  void claim(const Section &section, const std::string &key, const std::string &name,
             std::string_view what = "element");
};

// Return the value of a key in the type of its member. If the result is empty, the member keeps its
// value.
std::optional<double> value_of(Section &section, Names &names, const KeyFormat &key, double *);
std::optional<int> value_of(Section &section, Names &names, const KeyFormat &key, int *);
std::optional<bool> value_of(Section &section, Names &names, const KeyFormat &key, bool *);
std::optional<Ends> value_of(Section &section, Names &names, const KeyFormat &key, Ends *);
std::optional<std::string> value_of(Section &section, Names &names, const KeyFormat &key,
                                    std::string *);
std::optional<std::vector<double>> value_of(Section &section, Names &names, const KeyFormat &key,
                                            std::vector<double> *);
std::optional<std::vector<std::string>> value_of(Section &section, Names &names,
                                                 const KeyFormat &key, std::vector<std::string> *);

/// Throws InputError if the table has the key `key` without the key `beside`.
void expect_beside(Section &section, std::string_view key, std::string_view beside);

/// Throws InputError if the table has both or none of the two keys. `what` names the quantity that
/// the keys describe.
void one_of(Section &section, const char *one, const char *other, const std::string &what);

template <class T, class Context>
T read_table(Section &section, Context &names, bool is_whole = true);

template <class Context, class... Types>
void read_type(Section &section, Context &names, const KeyFormat &key,
               std::variant<Types...> &member) {
  const std::size_t type = section.choice(key.key, key.advice);
  section.add(*Alternatives<std::variant<Types...>>::formats[type]);
  std::size_t index = 0;
  ((index++ == type ? void(member = read_table<Types>(section, names, false)) : void()), ...);
}

template <class T, class Context, class Row>
void read_row(Section &section, Context &names, const Row &row, T &target) {
  using Member = std::remove_reference_t<decltype(row.member(target))>;
  using Value = typename Unwrapped<Member>::Type;
  if constexpr (requires { std::variant_size<Value>::value; }) {
    read_type(section, names, row.key, row.member(target));
  } else if constexpr (requires { row.quantity; }) {
    if (!section.has(row.key.key)) return;
    const Quantity quantity = (target.*row.quantity)();
    row.member(target) = section.value(row.key.key, quantity.dimension, quantity.sign);
  } else if constexpr (std::is_enum_v<Value>) {
    row.member(target) = static_cast<Value>(section.choice(row.key.key, row.key.advice));
  } else if constexpr (requires(Value v) { v.front().rows(); }) {
    section.each(row.key.key, [&](Section &inner) {
      row.member(target).push_back(read_table<typename Value::value_type>(inner, names));
    });
  } else if constexpr (requires { Value::rows(); }) {
    section.one(row.key.key,
                [&](Section &inner) { row.member(target) = read_table<Value>(inner, names); });
  } else {
    if (!row.key.beside.empty()) expect_beside(section, row.key.key, row.key.beside);
    if (auto value = value_of(section, names, row.key, static_cast<Value *>(nullptr)))
      row.member(target) = std::move(*value);
  }
}

/// Sets the members of a struct that these rows of the struct declare, in the order of the rows.
/// Throws InputError.
template <class T, class Context, class Rows>
void read_rows(Section &section, Context &names, T &target, const Rows &rows) {
  std::apply([&](const auto &...row) { (read_row(section, names, row, target), ...); }, rows);
}

/// Returns the struct that a table describes. If the table has no other keys than those of the
/// struct (`is_whole`), a key that is not declared is refused before the rules between keys are
/// checked. Throws InputError.
template <class T, class Context>
T read_table(Section &section, Context &names, bool is_whole) {
  T target;
  read_rows(section, names, target, T::rows());
  if (is_whole) section.finish();
  if constexpr (requires { target.complete(section, names); }) target.complete(section, names);
  return target;
}

}  // namespace forceaxis::sim
