#pragma once
// Detects late ticks at the firmware's end of a link, from the times at which they arrive alone.
#include <cstdint>

namespace forceaxis::host {

class LateTicks {
 public:
  // To be called with the time at which each tick arrives. True: more than a tick time after it was
  // due, which is a tick time after the one before. An early tick makes up for delay, a late one
  // moves the ticks after it: a partner that stops once causes one late tick, a slow one many.
  bool late(std::int64_t now_ns) {
    due_ns_ += kTickNs + kSlackNs;
    const bool is_late = begun_ && now_ns > due_ns_ + kTickNs;
    if (!begun_ || is_late || now_ns < due_ns_) due_ns_ = now_ns;
    begun_ = true;
    return is_late;
  }

 private:
  static constexpr std::int64_t kTickNs = 2000000 / 3;
  // The clocks of two machines differ, by far less than that.
  static constexpr std::int64_t kSlackNs = kTickNs / 1000;
  std::int64_t due_ns_ = 0;
  bool begun_ = false;
};

}  // namespace forceaxis::host
