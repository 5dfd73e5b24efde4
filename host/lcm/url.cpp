#include "host/lcm/url.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <charconv>
#include <optional>
#include <string_view>

#include "host/lcm/lcm_ends.hpp"

namespace forceaxis::lcm_bus {
namespace {

constexpr std::string_view kScheme = "udpm://";
constexpr std::optional<int> kPort = 7667;

std::optional<int> number_of(std::string_view text, int low, int high) {
  int value = 0;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), value);
  if (parsed.ec != std::errc() || parsed.ptr != text.data() + text.size()) return std::nullopt;
  if (value < low || value > high) return std::nullopt;
  return value;
}

std::optional<std::uint32_t> group_of(std::string_view text) {
  in_addr address{};
  if (inet_pton(AF_INET, std::string(text).c_str(), &address) != 1) return std::nullopt;
  const std::uint32_t group = ntohl(address.s_addr);
  if (!IN_MULTICAST(group)) return std::nullopt;
  return group;
}

// Reads an option "NAME=VALUE" of a URL. Options that a receiver needs are stored in `place`.
bool read_option(std::string_view text, Place &place) {
  const std::size_t equals = text.find('=');
  if (equals == text.npos) return false;
  const std::string_view name = text.substr(0, equals), value = text.substr(equals + 1);
  if (name == "ttl") return number_of(value, 0, 255).has_value();
  if (name != "recv_buf_size") return false;
  const auto bytes = number_of(value, 1, INT32_MAX);
  place.receive_bytes = bytes.value_or(0);
  return bytes.has_value();
}

std::optional<Place> read_place(std::string_view url) {
  if (!url.starts_with(kScheme)) return std::nullopt;
  url.remove_prefix(kScheme.size());
  const std::size_t question = url.find('?');
  const std::string_view where = url.substr(0, question);
  const std::size_t colon = where.find(':');
  const std::string_view address = where.substr(0, colon);
  const auto group = group_of(address.empty() ? kGroup : address);
  const auto port = colon == where.npos ? kPort : number_of(where.substr(colon + 1), 1, 65535);
  if (!group || !port) return std::nullopt;
  Place place{*group, static_cast<std::uint16_t>(*port), 0};
  if (question == url.npos) return place;
  for (std::string_view rest = url.substr(question + 1);;) {
    const std::size_t next = rest.find('&');
    if (!read_option(rest.substr(0, next), place)) return std::nullopt;
    if (next == rest.npos) return place;
    rest.remove_prefix(next + 1);
  }
}

}  // namespace

Place place_of(const std::string &url) { return *read_place(url); }

std::string url_trouble(const std::string &url) {
  if (read_place(url)) return "";
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
         ": expected a route for multicast, got none; add one to the loopback interface with "
         "`ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo`";
}

}  // namespace forceaxis::lcm_bus
