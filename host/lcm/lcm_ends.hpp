#pragma once
// What everyone who opens LCM needs.
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <stdexcept>
#include <string>

namespace forceaxis::lcm_bus {

// No such bus, or no route for multicast: the text says what to do.
struct LcmError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// LCM's own group, and where programs meet that were given no other place.
inline constexpr char kGroup[] = "239.255.76.67";
inline constexpr char kDefaultUrl[] = "udpm://239.255.76.67:7667?ttl=0";

inline std::string default_url() {
  const char *const given = std::getenv("LCM_DEFAULT_URL");
  return given != nullptr && *given != 0 ? given : kDefaultUrl;
}

// Microseconds since 1970, as messages carry them.
inline std::int64_t wall_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace forceaxis::lcm_bus
