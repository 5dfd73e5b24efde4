#pragma once
// Definitions for all files that use LCM.
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <stdexcept>
#include <string>

namespace forceaxis::lcm_bus {

// Error: the LCM URL cannot be opened, or the machine has no route for multicast. what() contains
// the remedy.
struct LcmError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// The default multicast group of LCM, which is used if no URL is given.
inline constexpr char kGroup[] = "239.255.76.67";
inline constexpr char kDefaultUrl[] = "udpm://239.255.76.67:7667?ttl=0";

inline std::string default_url() {
  const char *const given = std::getenv("LCM_DEFAULT_URL");
  return given != nullptr && *given != 0 ? given : kDefaultUrl;
}

// Returns the time of the wall clock in microseconds since 1970. Messages contain times in this
// form.
inline std::int64_t wall_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace forceaxis::lcm_bus
