#pragma once
// Receives LCM messages from this machine, and from other networks only if they are allowed. liblcm
// receives from every sender and does not report the sender, so this class has its own sockets.
//
// The kernel, not the source address, tells whether a datagram comes from this machine: it arrives
// through the loopback interface, or is the local copy of a datagram that this machine sent to
// another interface.
#include <functional>
#include <string>
#include <vector>

#include "host/lcm/assembly.hpp"
#include "host/lcm/lcm_ends.hpp"

namespace forceaxis::lcm_bus {

// A network in host byte order. Bits of the address outside the mask are 0.
struct Network {
  std::uint32_t address, mask;
};

// Returns the network in a text such as "192.168.1.0/24" or "192.168.1.0/255.255.255.0". For an
// invalid text, `trouble` becomes one line with the reason, without the text itself.
std::optional<Network> network_of(const std::string &text, std::string &trouble);

class Receiver {
 public:
  using Take = std::function<void(const Message &message)>;

  // Joins the multicast group of `url`. lcm_bus::trouble() must return no problem for this URL.
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

// Counts the datagrams that a Receiver with the same arguments refuses, as far as it keeps up with
// them. It has its own socket, so many refused datagrams cannot displace wanted ones.
class RefusedCounter {
 public:
  RefusedCounter(const std::string &url, const std::vector<Network> &remote,
                 std::function<bool(std::string_view channel)> wanted);
  ~RefusedCounter();
  RefusedCounter(const RefusedCounter &) = delete;
  RefusedCounter &operator=(const RefusedCounter &) = delete;

  int fd() const { return socket_; }
  void receive(int most);

  // Number of refused datagrams on wanted channels. Of a fragmented message, only the first
  // datagram counts.
  std::uint64_t count() const { return count_; }
  // Sender of the last refused datagram, "ADDRESS:PORT".
  const std::string &last() const { return last_; }

 private:
  std::function<bool(std::string_view)> wanted_;
  int socket_;
  std::uint64_t count_ = 0;
  std::string last_;
};

}  // namespace forceaxis::lcm_bus
