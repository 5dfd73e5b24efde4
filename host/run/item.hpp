#pragma once
// Rows that declare the fields of a result for Python. Each row has the member or the function that
// gives the value of the field.
//
// A struct that Python receives has these members:
//   static constexpr const char *kName       name of its Python class
//   static constexpr const char *kMeaning    its docstring
//   static constexpr auto items()            its fields: a tuple of item()
// host/python/binding/table.hpp uses these rows to convert the struct, and tools/gen_results.py
// uses them to write the Python class. So a row is the only declaration of a field.
#include <cmath>
#include <optional>
#include <tuple>

namespace forceaxis::host {

template <class Get>
struct Item {
  const char *key;
  Get get;
  const char *meaning;  ///< description of the result field; empty if its name is sufficient
};

/// Declares a field: `get` is a member, or a function of the struct.
template <class Get>
constexpr Item<Get> item(const char *key, Get get, const char *meaning = "") {
  return {key, get, meaning};
}

/// Declares a field for each row of a struct that is read from a file (sim/model/field.hpp), with
/// the same key, member and meaning.
template <class Rows>
constexpr auto items_of(const Rows &rows) {
  return std::apply(
      [](const auto &...row) {
        return std::tuple{
            item(row.key.key.data(), std::get<0>(row.steps), row.key.meaning.data())...};
      },
      rows);
}

/// A number that is None in Python while it is infinite.
template <class Owner>
struct Finite {
  double Owner::*member;

  std::optional<double> operator()(const Owner &owner) const {
    return std::isfinite(owner.*member) ? std::optional(owner.*member) : std::nullopt;
  }
  void set(Owner &owner, std::optional<double> value) const {
    owner.*member = value.value_or(HUGE_VAL);
  }
};
template <class Owner>
Finite(double Owner::*) -> Finite<Owner>;

/// Getter and setter for a member of a member.
template <class Owner, class Middle, class Value>
struct Within {
  Middle Owner::*outer;
  Value Middle::*inner;

  const Value &operator()(const Owner &owner) const { return owner.*outer.*inner; }
  void set(Owner &owner, const Value &value) const { owner.*outer.*inner = value; }
};
template <class Owner, class Middle, class Value>
Within(Middle Owner::*, Value Middle::*) -> Within<Owner, Middle, Value>;

}  // namespace forceaxis::host
