#pragma once
// A session: axis_node and plant_node run until the user ends them, and continue after a suspension
// of a node (by SIGSTOP or with the machine). The ends of a link use these classes.
#include <time.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

namespace forceaxis::host {

// Detects that this process was suspended for some time. The clock used also runs while the machine
// is suspended.
class StallWatch {
 public:
  // A suspension shorter than `limit` is ignored. The limit is at least 0.25 s.
  explicit StallWatch(std::chrono::milliseconds limit)
      : limit_ns_(std::max<std::int64_t>(limit.count(), 250) * 1'000'000), before_ns_(now_ns()) {}

  // Must be called at least every 100 ms. If the process was suspended since the previous call,
  // returns the time since this call. Otherwise returns nothing.
  std::optional<std::chrono::milliseconds> poll() {
    const std::int64_t now = now_ns();
    const std::int64_t gap = now - before_ns_;
    before_ns_ = now;
    if (gap < limit_ns_) return std::nullopt;
    return std::chrono::milliseconds(gap / 1'000'000);
  }

 private:
  static std::int64_t now_ns() {
    timespec now;
    clock_gettime(CLOCK_BOOTTIME, &now);
    return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
  }
  std::int64_t limit_ns_;
  std::int64_t before_ns_;
};

// Number and total time of the interruptions of a session.
struct Interruptions {
  int count = 0;
  std::chrono::milliseconds total{0};

  // Adds an interruption of this length. Returns the length as text, such as "2.003 s, 3004 ticks".
  std::string add(std::chrono::milliseconds time) {
    ++count;
    total += time;
    return std::to_string(time.count() / 1000) + "." +
           std::to_string(1000 + time.count() % 1000).substr(1) + " s, " +
           std::to_string(ticks_of(time)) + " ticks";
  }
  std::int64_t ticks() const { return ticks_of(total); }

 private:
  static std::int64_t ticks_of(std::chrono::milliseconds time) { return time.count() * 3 / 2; }
};

}  // namespace forceaxis::host
