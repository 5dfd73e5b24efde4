#pragma once
// Converts structs with items() (host/run/item.hpp) to Python and back, and describes these structs
// for tools/gen_results.py. This tool writes the Python types of the structs.
//
// A struct becomes the dataclass forceaxis._results.NAME, or a dict if the struct has
// `static constexpr bool kDict = true`; then _core.pyi has a TypedDict NAME.
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace table {

namespace py = pybind11;

template <class T>
concept Described = requires {
  T::items();
};
template <class T>
concept IsDict = requires {
  T::kDict;
};

/// A Python dict whose keys have the order of these entries.
template <class T>
using Ordered = std::vector<std::pair<std::string, T>>;

template <class T>
// For each type T: python() returns the Python type for a stub file, and of() converts a value to a
// Python object.
struct Kind;

template <class T>
py::object object(const T &value) {
  return Kind<T>::of(value);
}

template <class T>
struct Plain {
  static py::object of(const T &value) { return py::cast(value); }
};
template <class T>
requires std::is_integral_v<T>
struct Kind<T> : Plain<T> {
  static std::string python() { return std::is_same_v<T, bool> ? "bool" : "int"; }
};
template <class T>
requires std::is_floating_point_v<T>
struct Kind<T> : Plain<T> {
  static std::string python() { return "float"; }
};
template <class T>
requires std::is_convertible_v<T, std::string_view>
struct Kind<T> {
  static std::string python() { return "str"; }
  static py::object of(const T &value) { return py::str(std::string(std::string_view(value))); }
};
template <>
struct Kind<std::vector<std::byte>> {
  static std::string python() { return "bytes"; }
  static py::object of(const std::vector<std::byte> &value) {
    return py::bytes(reinterpret_cast<const char *>(value.data()), value.size());
  }
};
template <>
struct Kind<Eigen::MatrixXd> : Plain<Eigen::MatrixXd> {
  static std::string python() { return "_Floats"; }
};
template <class T>
struct Kind<py::array_t<T>> {
  static std::string python() {
    if constexpr (std::is_same_v<T, double>)
      return "_Floats";
    else
      return "np.ndarray[Any, np.dtype[np.int32]]";
  }
  static py::object of(const py::array_t<T> &value) { return value; }
};
template <>
struct Kind<py::dict> {
  static std::string python() { return "dict[str, Any]"; }
  static py::object of(const py::dict &value) { return value; }
};
template <>
struct Kind<std::filesystem::path> : Plain<std::filesystem::path> {
  static std::string python() { return "Path"; }
};
template <class T>
struct Kind<std::optional<T>> {
  static std::string python() { return Kind<T>::python() + " | None"; }
  static py::object of(const std::optional<T> &value) {
    return value ? object(*value) : py::none();
  }
};
template <class... T>
struct Kind<std::variant<T...>> : Plain<std::variant<T...>> {
  static std::string python() {
    std::string text;
    ((text += (text.empty() ? "" : " | ") + Kind<T>::python()), ...);
    return text;
  }
};
template <class T>
struct Kind<std::vector<T>> {
  static std::string python() { return "list[" + Kind<T>::python() + "]"; }
  static py::object of(const std::vector<T> &values) {
    py::list list;
    for (const T &value : values) list.append(object(value));
    return list;
  }
};
template <class T>
struct Kind<Ordered<T>> {
  static std::string python() { return "dict[str, " + Kind<T>::python() + "]"; }
  static py::object of(const Ordered<T> &entries) {
    py::dict d;
    for (const auto &[key, value] : entries) d[py::str(key)] = object(value);
    return d;
  }
};
template <class... T>
struct Kind<std::tuple<T...>> {
  static std::string python() {
    std::string text;
    ((text += (text.empty() ? "" : ", ") + Kind<T>::python()), ...);
    return "tuple[" + text + "]";
  }
  static py::object of(const std::tuple<T...> &values) {
    return std::apply([](const T &...value) { return py::make_tuple(object(value)...); }, values);
  }
};
/// A list of values that becomes a Python tuple of any length.
template <class T>
struct Fixed {
  std::vector<T> values;
};
template <class T>
struct Kind<Fixed<T>> {
  static std::string python() { return "tuple[" + Kind<T>::python() + ", ...]"; }
  static py::object of(const Fixed<T> &fixed) { return py::tuple(object(fixed.values)); }
};
template <Described T>
struct Kind<T> {
  static std::string python() { return T::kName; }
  static py::object of(const T &value) {
    py::dict d;
    std::apply(
        [&](const auto &...items) {
          ((d[items.key] = object(std::decay_t<decltype(std::invoke(items.get, value))>(
                std::invoke(items.get, value)))),
           ...);
        },
        T::items());
    if constexpr (IsDict<T>)
      return d;
    else
      return py::module_::import("forceaxis._results").attr(T::kName)(**d);
  }
};

template <Described T>
T from(const py::handle &source);

template <class T>
T value_from(const py::object &source) {
  if constexpr (Described<T>) {
    return from<T>(source);
  } else if constexpr (requires {
                         typename T::value_type;
                         requires Described<typename T::value_type>;
                       }) {
    return source.is_none() ? T() : T(from<typename T::value_type>(source));
  } else {
    return source.cast<T>();
  }
}

/// Returns the struct T for a Python object that has the fields of T.
template <Described T>
T from(const py::handle &source) {
  T target;
  const auto take = [&](const auto &item) {
    const auto &get = item.get;
    using Value = std::decay_t<decltype(std::invoke(get, std::as_const(target)))>;
    const auto value = value_from<Value>(source.attr(item.key));
    if constexpr (requires { get.set(target, value); })
      get.set(target, value);
    else
      target.*get = value;
  };
  std::apply([&](const auto &...items) { (take(items), ...); }, T::items());
  return target;
}

/// The functions `describe` of all structs that Python receives.
inline std::vector<void (*)(py::list &)> described;

/// Adds the description of a struct: its name, its meaning, its kind, and (field, type, meaning) of
/// each field. The kind is "class", "dict" or "partial dict". Keys of a partial dict may be
/// missing.
template <Described T>
void describe(py::list &types) {
  py::list fields;
  const auto add = [&]<class Item>(const Item &item) {
    using Value = std::decay_t<decltype(std::invoke(item.get, std::declval<const T &>()))>;
    fields.append(py::make_tuple(item.key, Kind<Value>::python(), item.meaning));
  };
  std::apply([&](const auto &...items) { (add(items), ...); }, T::items());
  constexpr bool partial = requires { T::kPartial; };
  types.append(py::make_tuple(T::kName, T::kMeaning,
                              partial     ? "partial dict"
                              : IsDict<T> ? "dict"
                                          : "class",
                              fields));
}

/// Declares the structs T for tools/gen_results.py. Each struct must follow the structs that its
/// fields contain.
template <class... T>
void add_results() {
  (described.push_back(&describe<T>), ...);
}

}  // namespace table
