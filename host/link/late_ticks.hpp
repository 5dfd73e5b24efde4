#pragma once
// Detects late ticks at the firmware's end of a link. Only the arrival times of the ticks are used.
#include <cstdint>

namespace forceaxis::host {

class LateTicks {
 public:
  // Must be called with the arrival time of each tick. Returns true if the tick arrives more than
  // one tick period after its due time. The due time of a tick is one tick period after the due
  // time of the previous tick. After an early or late tick, the due time is the arrival time of
  // this tick. So a plant that stops once causes one late tick, and a slow plant causes many.
  bool late(std::int64_t now_ns) {
    due_ns_ += kTickNs + kSlackNs;
    const bool is_late = begun_ && now_ns > due_ns_ + kTickNs;
    if (!begun_ || is_late || now_ns < due_ns_) due_ns_ = now_ns;
    begun_ = true;
    return is_late;
  }

 private:
  static constexpr std::int64_t kTickNs = 2000000 / 3;
  // Allowance in ns per tick for the rate difference between the clocks of two machines. The real
  // difference is far smaller.
  static constexpr std::int64_t kSlackNs = kTickNs / 1000;
  std::int64_t due_ns_ = 0;
  bool begun_ = false;
};

}  // namespace forceaxis::host
