#pragma once
// Checks the LCM URLs of axis_node, plant_node and gateway. A URL has the scheme udpm, an address,
// a port and options such as ttl=N. Each part is optional as in liblcm. liblcm prints several lines
// for an invalid URL, ignores many errors, and ends the process if a URL of the scheme tcpq has no
// server. So only URLs that liblcm accepts without a message are passed to liblcm.
#include <cstdint>
#include <string>

namespace forceaxis::lcm_bus {

// The parts of an LCM URL, with default values for omitted parts.
struct Place {
  std::uint32_t group;  // address of the multicast group, in host byte order
  std::uint16_t port;
  int receive_bytes;  // size of the socket's receive buffer in bytes; 0: default of the machine
};

// Returns the parts of a URL for which url_trouble() returns an empty text.
Place place_of(const std::string &url);

// Returns one line with the error in a URL and the remedy. Returns an empty text if the URL is
// valid.
std::string url_trouble(const std::string &url);

// Checks the URL like url_trouble(). Also checks that the machine has a route for multicast,
// because otherwise every message would be lost.
std::string trouble(const std::string &url);

// Returns the same URL. If trouble() returns a text that is not empty, throws an Error with this
// text.
template <class Error>
const std::string &usable(const std::string &url) {
  const std::string wrong = trouble(url);
  if (!wrong.empty()) throw Error(wrong);
  return url;
}

}  // namespace forceaxis::lcm_bus
