#pragma once
// Which ticks come too late at the firmware's end of a link, where the pace of the plant is known
// by nothing but when they come.
#include <cstdint>

namespace forceaxis::host {

class LateTicks {
 public:
  // To be told when each tick came. True: more than a tick time after its own time, which is a tick
  // time after that of the one before. One that is early catches up, one that is late moves those
  // behind it: a partner that stands still once makes one late tick, one that is too slow many.
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
