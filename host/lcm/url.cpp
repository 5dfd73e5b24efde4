#include "host/lcm/url.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <charconv>
#include <cstdint>
#include <string_view>

#include "host/lcm/lcm_ends.hpp"

namespace forceaxis::lcm_bus {
namespace {

constexpr std::string_view kScheme = "udpm://";

bool is_number(std::string_view text, std::int64_t low, std::int64_t high) {
  std::int64_t value = 0;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), value);
  return parsed.ec == std::errc() && parsed.ptr == text.data() + text.size() && value >= low &&
         value <= high;
}

bool is_multicast(std::string_view text) {
  in_addr address{};
  return inet_pton(AF_INET, std::string(text).c_str(), &address) == 1 &&
         IN_MULTICAST(ntohl(address.s_addr));
}

bool is_option(std::string_view text) {
  const std::size_t equals = text.find('=');
  if (equals == text.npos) return false;
  const std::string_view name = text.substr(0, equals), value = text.substr(equals + 1);
  return (name == "ttl" && is_number(value, 0, 255)) ||
         (name == "recv_buf_size" && is_number(value, 1, INT32_MAX));
}

bool is_udpm(std::string_view url) {
  if (!url.starts_with(kScheme)) return false;
  url.remove_prefix(kScheme.size());
  const std::size_t question = url.find('?');
  const std::string_view where = url.substr(0, question);
  const std::size_t colon = where.find(':');
  const std::string_view address = where.substr(0, colon);
  if (!address.empty() && !is_multicast(address)) return false;
  if (colon != where.npos && !is_number(where.substr(colon + 1), 1, 65535)) return false;
  if (question == url.npos) return true;
  for (std::string_view rest = url.substr(question + 1);;) {
    const std::size_t next = rest.find('&');
    if (!is_option(rest.substr(0, next))) return false;
    if (next == rest.npos) return true;
    rest.remove_prefix(next + 1);
  }
}

}  // namespace

std::string url_trouble(const std::string &url) {
  if (is_udpm(url)) return "";
  return url + ": expected an LCM URL such as " + kDefaultUrl;
}

std::string trouble(const std::string &url) {
  const std::string wrong = url_trouble(url);
  if (!wrong.empty()) return wrong;
  const int s = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(1);
  inet_pton(AF_INET, kGroup, &address.sin_addr);
  const bool there = connect(s, reinterpret_cast<sockaddr *>(&address), sizeof address) == 0;
  close(s);
  if (there) return "";
  return url +
         ": expected a route for multicast, there is none; give the loopback interface one: "
         "`ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo`";
}

}  // namespace forceaxis::lcm_bus
