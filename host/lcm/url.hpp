#pragma once
// LCM URLs of axis_node, plant_node and gateway: udpm://ADDRESS:PORT?ttl=N, each part optional as
// for liblcm. liblcm explains a bad one in lines of its own, passes over half of what is wrong, and
// ends the process where a tcpq:// has no server; so it gets only what it takes in silence.
#include <cstdint>
#include <string>

namespace forceaxis::lcm_bus {

// Where a URL leads, defaults filled in.
struct Place {
  std::uint32_t group;  // as numbers of this machine
  std::uint16_t port;
  int receive_bytes;  // buffer of a socket; 0: the machine's default
};

// Of a URL that url_trouble() finds nothing wrong with.
Place place_of(const std::string &url);

// What is wrong with a URL, in one line with what to do; empty if it can be used.
std::string url_trouble(const std::string &url);

// The same, and of the machine: no route for multicast, without which every message would be lost.
std::string trouble(const std::string &url);

// The URL. Throws an Error of what is wrong, if something is.
template <class Error>
const std::string &usable(const std::string &url) {
  const std::string wrong = trouble(url);
  if (!wrong.empty()) throw Error(wrong);
  return url;
}

}  // namespace forceaxis::lcm_bus
