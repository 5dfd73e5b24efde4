#pragma once
// Receives LCM messages from this machine and from allowed networks. liblcm receives from every
// sender and does not report the sender, so this class has its own sockets.
//
// The kernel, and not the source address, determines whether a datagram comes from this machine.
// Such a datagram arrives through the loopback interface, or is the local copy of a datagram that
// this machine has sent through another interface.
#include <functional>
#include <string>
#include <vector>

#include "host/lcm/assembly.hpp"
#include "host/lcm/lcm_ends.hpp"

namespace forceaxis::lcm_bus {

// Address and mask of a network in host byte order. Bits of the address outside the mask are 0.
struct Network {
  std::uint32_t address, mask;
};

// Returns the network in a text such as "192.168.1.0/24" or "192.168.1.0/255.255.255.0". For an
// invalid text, returns nothing and sets `trouble` to one line with the reason. The line does not
// contain the text.
std::optional<Network> network_of(const std::string &text, std::string &trouble);

class Receiver {
 public:
  using Take = std::function<void(const Message &message)>;

  // Joins the multicast group of `url`. lcm_bus::trouble() must return an empty text for this URL.
  // Throws LcmError.
  Receiver(const std::string &url, const std::vector<Network> &remote,
           std::function<bool(std::string_view channel)> wanted);
  ~Receiver();
  Receiver(const Receiver &) = delete;
  Receiver &operator=(const Receiver &) = delete;

  int fd() const { return socket_; }
  // Receives at most `most` datagrams without waiting, and calls `take` for each wanted message.
  // Returns the number of datagrams.
  int receive(int most, const Take &take);

  const Assembly &assembly() const { return assembly_; }

 private:
  Assembly assembly_;
  std::vector<std::uint8_t> datagram_;
  int socket_;
};

// Counts the datagrams that a Receiver with the same arguments refuses. The counter has its own
// socket, so that many refused datagrams cannot displace wanted datagrams. If datagrams arrive too
// fast, some datagrams are not counted.
class RefusedCounter {
 public:
  RefusedCounter(const std::string &url, const std::vector<Network> &remote,
                 std::function<bool(std::string_view channel)> wanted);
  ~RefusedCounter();
  RefusedCounter(const RefusedCounter &) = delete;
  RefusedCounter &operator=(const RefusedCounter &) = delete;

  int fd() const { return socket_; }
  void receive(int most);

  // Returns the number of refused datagrams on wanted channels. For a fragmented message, only the
  // first datagram is counted.
  std::uint64_t count() const { return count_; }
  // Returns the sender of the last refused datagram as "ADDRESS:PORT".
  const std::string &last() const { return last_; }

 private:
  std::function<bool(std::string_view)> wanted_;
  int socket_;
  std::uint64_t count_ = 0;
  std::string last_;
};

}  // namespace forceaxis::lcm_bus
