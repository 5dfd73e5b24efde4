#include "host/lcm/receiver.hpp"

#include <arpa/inet.h>
#include <linux/filter.h>
#include <net/if_arp.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>

#include "host/lcm/url.hpp"

namespace forceaxis::lcm_bus {
namespace {

constexpr std::size_t kLargestDatagram = 65536;

// Packet type by which the kernel marks the local copy of an outgoing multicast datagram. The value
// is repeated here because linux/if_packet.h conflicts with other headers of this file.
constexpr std::uint32_t kPacketLoopback = 5;
constexpr std::uint32_t kSourceAddress = 12;  // offset of the source address in the IP header
constexpr std::uint32_t kAll = 0xFFFFFFFF;
// Number of bytes of a refused datagram that are received: UDP header, LCM header and channel name.
constexpr std::uint32_t kShown = 8 + 20 + 64;

// Returns a filter program for a socket. The program passes `local` bytes of each datagram from
// this machine or from a network in `remote`, and `foreign` bytes of each other datagram. For 0
// bytes, the kernel discards the datagram.
std::vector<sock_filter> filter_of(const std::vector<Network> &remote, std::uint32_t local,
                                   std::uint32_t foreign) {
  std::vector<sock_filter> program;
  const auto load = [&](std::uint32_t where) {
    program.push_back(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, where));
  };
  const auto accept_if = [&](std::uint32_t value) {
    program.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, 1));
    program.push_back(BPF_STMT(BPF_RET | BPF_K, local));
  };
  load(static_cast<std::uint32_t>(SKF_AD_OFF + SKF_AD_PKTTYPE));
  accept_if(kPacketLoopback);
  load(static_cast<std::uint32_t>(SKF_AD_OFF + SKF_AD_HATYPE));
  accept_if(ARPHRD_LOOPBACK);
  for (const Network &network : remote) {
    load(static_cast<std::uint32_t>(SKF_NET_OFF) + kSourceAddress);
    program.push_back(BPF_STMT(BPF_ALU | BPF_AND | BPF_K, network.mask));
    accept_if(network.address);
  }
  program.push_back(BPF_STMT(BPF_RET | BPF_K, foreign));
  return program;
}

// Opens a socket that has joined the multicast group of a URL. The filter of the socket is active
// before the first datagram can arrive.
int open_socket(const std::string &url, std::vector<sock_filter> program) {
  const Place place = place_of(url);
  const int s = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const sock_fprog filter{static_cast<unsigned short>(program.size()), program.data()};
  const int yes = 1;
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(place.port);
  // The socket is bound to the address of the group, so it receives no datagrams that are sent to
  // an address of this machine.
  address.sin_addr.s_addr = htonl(place.group);
  ip_mreq join{address.sin_addr, {INADDR_ANY}};
  const bool done =
      s >= 0 && setsockopt(s, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) == 0 &&
      setsockopt(s, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) == 0 &&
      (place.receive_bytes == 0 || setsockopt(s, SOL_SOCKET, SO_RCVBUF, &place.receive_bytes,
                                              sizeof place.receive_bytes) == 0) &&
      bind(s, reinterpret_cast<const sockaddr *>(&address), sizeof address) == 0 &&
      setsockopt(s, IPPROTO_IP, IP_ADD_MEMBERSHIP, &join, sizeof join) == 0;
  if (done) return s;
  const std::string why = std::strerror(errno);
  if (s >= 0) close(s);
  throw LcmError(url + ": cannot receive LCM messages, " + why);
}

// Receives the first pending datagram. Returns nothing if no datagram is pending.
std::optional<std::span<const std::uint8_t>> receive_from(int socket,
                                                          std::span<std::uint8_t> buffer,
                                                          Sender &sender) {
  sockaddr_in from{};
  socklen_t length = sizeof from;
  const ssize_t count = recvfrom(socket, buffer.data(), buffer.size(), 0,
                                 reinterpret_cast<sockaddr *>(&from), &length);
  if (count < 0) return std::nullopt;
  sender = {ntohl(from.sin_addr.s_addr), ntohs(from.sin_port)};
  return buffer.first(static_cast<std::size_t>(count));
}

std::string text_of(std::uint32_t address) {
  const in_addr in{htonl(address)};
  char text[INET_ADDRSTRLEN];
  return inet_ntop(AF_INET, &in, text, sizeof text);
}

std::optional<std::uint32_t> address_of(const std::string &text) {
  in_addr address{};
  if (inet_pton(AF_INET, text.c_str(), &address) != 1) return std::nullopt;
  return ntohl(address.s_addr);
}

std::optional<std::uint32_t> mask_of(const std::string &text) {
  if (const auto mask = address_of(text)) {
    const std::uint32_t outside = ~*mask;
    // A network mask must consist of ones followed by zeros.
    if ((outside & (outside + 1)) != 0) return std::nullopt;
    return mask;
  }
  int ones = 0;
  const char *const end = text.data() + text.size();
  const auto read = std::from_chars(text.data(), end, ones);
  if (read.ec != std::errc() || read.ptr != end || ones < 0 || ones > 32) return std::nullopt;
  return ones == 0 ? 0 : kAll << (32 - ones);
}

}  // namespace

std::optional<Network> network_of(const std::string &text, std::string &trouble) {
  const std::size_t slash = text.find('/');
  const auto address = address_of(text.substr(0, slash));
  const auto mask = slash == text.npos ? std::nullopt : mask_of(text.substr(slash + 1));
  if (!address || !mask) {
    trouble = "expected ADDRESS/MASK such as 192.168.1.0/24 or 192.168.1.0/255.255.255.0";
    return std::nullopt;
  }
  if ((*address & ~*mask) != 0) {
    trouble = "expected an address without bits outside the mask, such as " +
              text_of(*address & *mask) + text.substr(slash);
    return std::nullopt;
  }
  return Network{*address, *mask};
}

Receiver::Receiver(const std::string &url, const std::vector<Network> &remote,
                   std::function<bool(std::string_view)> wanted)
    : assembly_(std::move(wanted)),
      datagram_(kLargestDatagram),
      socket_(open_socket(url, filter_of(remote, kAll, 0))) {}

Receiver::~Receiver() { close(socket_); }

int Receiver::receive(int most, const Take &take) {
  int taken = 0;
  for (; taken < most; ++taken) {
    Sender sender{};
    const auto datagram = receive_from(socket_, datagram_, sender);
    if (!datagram) break;
    const auto message = assembly_.take(sender, *datagram);
    if (message) take(*message);
  }
  return taken;
}

RefusedCounter::RefusedCounter(const std::string &url, const std::vector<Network> &remote,
                               std::function<bool(std::string_view)> wanted)
    : wanted_(std::move(wanted)), socket_(open_socket(url, filter_of(remote, 0, kShown))) {}

RefusedCounter::~RefusedCounter() { close(socket_); }

void RefusedCounter::receive(int most) {
  std::array<std::uint8_t, kShown> buffer;
  Sender sender{};
  for (int i = 0; i < most; ++i) {
    const auto datagram = receive_from(socket_, buffer, sender);
    if (!datagram) return;
    const auto channel = channel_of(*datagram);
    if (channel.empty() || !wanted_(channel)) continue;
    ++count_;
    last_ = text_of(sender.address) + ":" + std::to_string(sender.port);
  }
}

}  // namespace forceaxis::lcm_bus
