#pragma once
// What everyone who opens LCM needs.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <string>

namespace forceaxis::lcm_bus {

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

// What to do where an URL is one of multicast and there is no route for it; else empty. LCM itself
// would only print warnings, and lose every message.
inline std::string missing_route(const std::string &url) {
  if (!url.starts_with("udpm://")) return {};
  const int s = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(1);
  ::inet_pton(AF_INET, kGroup, &address.sin_addr);
  const bool there = ::connect(s, reinterpret_cast<sockaddr *>(&address), sizeof address) == 0;
  ::close(s);
  if (there) return {};
  return url +
         ": expected a route for multicast, there is none; give the loopback interface one: "
         "`ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo`";
}

}  // namespace forceaxis::lcm_bus
