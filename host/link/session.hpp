#pragma once
// A session: nodes that run until they are ended, and go on after one of them was stopped (SIGSTOP,
// a suspended machine). Shared by both ends of a link.
#include <time.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

namespace forceaxis::host {

// Detects that this process did not run for a time. Its clock counts the suspension of the machine.
class StallWatch {
 public:
  // Shorter stalls than `limit`, at least a quarter of a second, are no stalls.
  explicit StallWatch(std::chrono::milliseconds limit)
      : limit_ns_(std::max<std::int64_t>(limit.count(), 250) * 1'000'000), before_ns_(now_ns()) {}

  // To be called at least every 100 ms. The time since the call before, if that was a stall.
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

// The times for which a session stood still.
struct Interruptions {
  int count = 0;
  std::chrono::milliseconds total{0};

  // Adds one; returns it as text, "2.003 s, 3004 ticks".
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
