#pragma once
// Rows that declare the keys of a table together with their members in a struct.
//
// A struct whose values are read from a file has these members:
//   static constexpr std::string_view kMeaning    description for the reference page
//   static constexpr auto rows()                  the keys, each with its member
//   void complete(Section &, Names &)             for rules between keys, and for derived members
// A struct that is one of several types of a table also has kWhen. Such a row is the only
// declaration of a key: read.hpp uses the row to read the file, and format_of<T> is the declaration
// from which the reference page is generated.
#include <array>
#include <cstddef>
#include <optional>
#include <string_view>
#include <tuple>
#include <variant>
#include <vector>

#include "sim/model/format.hpp"

namespace forceaxis::sim {

template <class T>
struct Unwrapped {
  using Type = T;
};
template <class T>
struct Unwrapped<std::optional<T>> {
  using Type = T;
};

/// The unit and the permitted sign of a number.
struct Quantity {
  Dimension dimension;
  Sign sign = Sign::any;
};

/// A key, and the path from the struct to the member that stores the value. The path may lead
/// through members of members. An empty optional on this path is filled.
template <class... Steps>
struct Field {
  KeyFormat key;
  std::tuple<Steps...> steps;

  template <class Owner>
  constexpr auto &member(Owner &owner) const {
    return std::apply(
        [&](const auto &...step) -> auto & { return follow(owner, step...); }, steps);
  }

 private:
  template <class Owner, class Step, class... More>
  static constexpr auto &follow(Owner &owner, Step step, More... more) {
    if constexpr (sizeof...(More) == 0) {
      return owner.*step;
    } else if constexpr (requires { (owner.*step).emplace(); }) {
      return follow(owner.*step ? *(owner.*step) : (owner.*step).emplace(), more...);
    } else {
      return follow(owner.*step, more...);
    }
  }
};

/// Declares a key and its member.
template <class Owner, class T>
constexpr auto field(T Owner::*member, const KeyFormat &key) {
  return Field<T Owner::*>{key, {member}};
}

/// Declares a key and its member `inner` of the member `outer`.
template <class Owner, class Middle, class Inner, class T>
constexpr auto field(Middle Owner::*outer, T Inner::*inner, const KeyFormat &key) {
  return Field<Middle Owner::*, T Inner::*>{key, {outer, inner}};
}

/// A field whose unit depends on members that are read before it. The function `quantity` of the
/// struct returns the unit.
template <class Owner, class T>
struct FieldOf : Field<T Owner::*> {
  Quantity (Owner::*quantity)() const;
};

/// Declares a key and its member, in the unit that a function of the struct gives.
template <class Owner, class T>
constexpr auto field(T Owner::*member, Quantity (Owner::*quantity)() const, const KeyFormat &key) {
  return FieldOf<Owner, T>{{key, {member}}, quantity};
}

/// Returns rows as one tuple: each argument is a Field or a tuple of them.
template <class... Parts>
constexpr auto rows_of(const Parts &...parts) {
  const auto as_tuple = []<class Part>(const Part &part) {
    if constexpr (requires { part.steps; })
      return std::tuple<Part>{part};
    else
      return part;
  };
  return std::tuple_cat(as_tuple(parts)...);
}

/// Returns the rows of a member that is a struct with its own rows. The keys of an optional member
/// are also keys of the table. The optional member has a value if the file has one of its keys.
template <class Owner, class Inner>
constexpr auto part(Inner Owner::*member) {
  return std::apply(
      [member]<class... Steps>(const Field<Steps> &...rows) {
        return std::tuple{
            Field<Inner Owner::*, Steps>{rows.key, {member, std::get<0>(rows.steps)}}...};
      },
      Unwrapped<Inner>::Type::rows());
}

template <class T>
inline constexpr auto kKeysOf = std::apply(
    [](const auto &...rows) { return std::array<KeyFormat, sizeof...(rows)>{rows.key...}; },
    T::rows());

template <class T>
constexpr TableFormat format_of();

/// The declaration of the table that describes a T.
template <class T>
inline constexpr TableFormat kFormat = format_of<T>();

template <class Variant>
struct Alternatives;
template <class... Types>
struct Alternatives<std::variant<Types...>> {
  static constexpr const TableFormat *formats[] = {&kFormat<Types>...};
};

/// Returns true if the first key of T lists the names of all types of T as its choices, such as "a,
/// b", in the order of the types. The name of a type is in its kWhen.
template <class T>
constexpr bool choices_are_types() {
  std::string_view choices = std::get<0>(T::rows()).key.form;
  for (const TableFormat *type : Alternatives<typename T::Type>::formats) {
    std::string_view name = type->when;
    name.remove_prefix(name.find('"') + 1);
    name.remove_suffix(1);
    if (!choices.starts_with(name)) return false;
    choices.remove_prefix(name.size());
    if (choices.starts_with(", ")) choices.remove_prefix(2);
  }
  return choices.empty();
}

template <class T>
constexpr TableFormat format_of() {
  TableFormat format{T::kMeaning, kKeysOf<T>};
  if constexpr (requires { T::kWhen; }) format.when = T::kWhen;
  if constexpr (requires { typename T::Type; }) {
    static_assert(choices_are_types<T>());
    format.added = Alternatives<typename T::Type>::formats;
  }
  return format;
}

}  // namespace forceaxis::sim
