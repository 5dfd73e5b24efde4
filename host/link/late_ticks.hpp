#pragma once
// Detects late ticks at the firmware's end of a link from the times of their arrival only.
#include <cstdint>

namespace forceaxis::host {

class LateTicks {
 public:
  // Must be called with the time at which each tick arrives. Returns true if the tick arrives more
  // than one tick period after it was due. A tick is due one tick period after the previous tick
  // was due. An early or late tick moves the due times of the ticks after it: a partner that stops
  // once causes one late tick, a slow partner causes many.
  bool late(std::int64_t now_ns) {
    due_ns_ += kTickNs + kSlackNs;
    const bool is_late = begun_ && now_ns > due_ns_ + kTickNs;
    if (!begun_ || is_late || now_ns < due_ns_) due_ns_ = now_ns;
    begun_ = true;
    return is_late;
  }

 private:
  static constexpr std::int64_t kTickNs = 2000000 / 3;
  // Allowance for the rate difference between the clocks of two machines, which is far smaller.
  static constexpr std::int64_t kSlackNs = kTickNs / 1000;
  std::int64_t due_ns_ = 0;
  bool begun_ = false;
};

}  // namespace forceaxis::host
