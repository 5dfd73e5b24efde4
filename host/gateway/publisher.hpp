#pragma once
// What is known of one axis, published over LCM: its state when asked to, and what changed as an
// event.
#include <array>
#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "host/lcm/axis_channels.hpp"

extern "C" {
#include "firmware/objects/generated/axis_objects.h"
}

namespace forceaxis::nodes {

class AxisPublisher {
 public:
  // `lcm` must outlive this.
  AxisPublisher(lcm_bus::AxisChannels &lcm, int number) : lcm_(lcm), number_(number) {}

  // The last value received or read; lcm_bus::kNotAvailable where there is none.
  std::int64_t value(std::uint16_t object) const;
  // Whether there is a value younger than that.
  bool is_fresh(std::uint16_t object, std::chrono::milliseconds age) const;
  // A value that was received, read or written: what changed becomes an event.
  void update(std::uint16_t object, std::int64_t value);
  // No value is known any more.
  void forget();

  // Firmware time of the last tick that is known, or not available.
  std::int64_t utime() const;

  void publish_state(std::int64_t table_hash, std::int64_t nmt_state);
  void event(std::int64_t kind, std::int64_t code, const std::string &text,
             const std::vector<lcm_bus::Item> &items = {}, lcm_bus::CommandId command = {});
  // The same, and a line on standard error.
  void loud_event(std::int64_t kind, std::int64_t code, const std::string &text);

 private:
  using Clock = std::chrono::steady_clock;
  struct Value {
    std::int64_t value = lcm_bus::kNotAvailable;
    Clock::time_point at;
  };

  void changed(std::uint16_t object, std::int64_t before, std::int64_t now);

  lcm_bus::AxisChannels &lcm_;
  int number_;
  std::uint64_t tick_ = 0;  // unwrapped
  std::array<Value, AXIS_OBJ_COUNT> values_{};
};

}  // namespace forceaxis::nodes
