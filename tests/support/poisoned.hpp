#pragma once
// Memory as a chip may have it at power-up. What an init function does not set shows itself.
#include <cstring>
#include <type_traits>

template <class T>
T poisoned() {
  static_assert(std::is_trivially_copyable_v<T>);
  T value;
  std::memset(&value, 0xA5, sizeof(value));
  return value;
}
