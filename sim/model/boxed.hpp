#pragma once
#include <memory>
#include <utility>

namespace forceaxis::sim {

/// A value or nothing, like std::optional. T may be declared later, so that a header that has a
/// Boxed member does not include the header of T.
template <class T>
class Boxed {
 public:
  Boxed() = default;
  explicit Boxed(T value) : value_(std::make_unique<T>(std::move(value))) {}
  Boxed(const Boxed &other) : value_(other ? std::make_unique<T>(*other) : nullptr) {}
  Boxed(Boxed &&) noexcept = default;
  ~Boxed() = default;
  Boxed &operator=(const Boxed &other) {
    value_ = other ? std::make_unique<T>(*other) : nullptr;
    return *this;
  }
  Boxed &operator=(Boxed &&) noexcept = default;
  Boxed &operator=(T value) {
    value_ = std::make_unique<T>(std::move(value));
    return *this;
  }

  bool has_value() const { return value_ != nullptr; }
  explicit operator bool() const { return has_value(); }
  void reset() { value_.reset(); }
  T &operator*() { return *value_; }
  const T &operator*() const { return *value_; }
  T *operator->() { return value_.get(); }
  const T *operator->() const { return value_.get(); }

 private:
  std::unique_ptr<T> value_;
};

}  // namespace forceaxis::sim
