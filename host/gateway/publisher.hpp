#pragma once
// Publishes the values of one axis over LCM. publish_state() publishes the state. Changes of values
// are published as events.
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
  // `lcm` must exist as long as this AxisPublisher.
  AxisPublisher(lcm_bus::AxisChannels &lcm, int number) : lcm_(lcm), number_(number) {}

  // Returns the last value of an object that was received or read. Returns lcm_bus::kNotAvailable
  // if no value is known.
  std::int64_t value(std::uint16_t object) const;
  // Returns true if the last value was stored less than the time `age` ago.
  bool is_fresh(std::uint16_t object, std::chrono::milliseconds age) const;
  // Stores a value that was received, read or written. If the value has changed, publishes an
  // event.
  void update(std::uint16_t object, std::int64_t value);
  // Discards all stored values of the axis.
  void forget();

  // Returns the time of the last known tick of the firmware in us. Returns lcm_bus::kNotAvailable
  // if no tick is known.
  std::int64_t utime() const;

  void publish_state(std::int64_t table_hash, std::int64_t nmt_state);
  void event(std::int64_t kind, std::int64_t code, const std::string &text,
             const std::vector<lcm_bus::Item> &items = {}, lcm_bus::CommandId command = {});
  // Publishes an event and writes its text to standard error.
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
  std::uint64_t tick_ = 0;  // tick counter of the firmware, extended to 64 bits
  std::array<Value, AXIS_OBJ_COUNT> values_{};
};

}  // namespace forceaxis::nodes
