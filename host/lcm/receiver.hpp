#pragma once
// Receives LCM messages from this machine, and from other networks only where that is asked for.
// liblcm receives from everyone and hides the sender, so this has sockets of its own.
//
// Whether a datagram is this machine's is the kernel's knowledge, not the source address's: it came
// through the loopback interface, or is the local copy of what this machine sent to another one.
#include <functional>
#include <string>
#include <vector>

#include "host/lcm/assembly.hpp"
#include "host/lcm/lcm_ends.hpp"

namespace forceaxis::lcm_bus {

// As numbers of this machine; no bit of the address is outside the mask.
struct Network {
  std::uint32_t address, mask;
};

// "192.168.1.0/24" or "192.168.1.0/255.255.255.0". What is wrong with another text goes to
// `trouble`, one line without the text itself.
std::optional<Network> network_of(const std::string &text, std::string &trouble);

class Receiver {
 public:
  using Take = std::function<void(const Message &message)>;

  // Joins the group of `url`, of which lcm_bus::trouble() has nothing to say. Throws LcmError.
  Receiver(const std::string &url, const std::vector<Network> &remote,
           std::function<bool(std::string_view channel)> wanted);
  ~Receiver();
  Receiver(const Receiver &) = delete;
  Receiver &operator=(const Receiver &) = delete;

  int fd() const { return socket_; }
  // Takes at most `most` datagrams, without waiting, and calls `take` for each wanted message.
  // Returns how many datagrams there were.
  int receive(int most, const Take &take);

  const Assembly &assembly() const { return assembly_; }

 private:
  Assembly assembly_;
  std::vector<std::uint8_t> datagram_;
  int socket_;
};

// What a Receiver of the same arguments does not receive, as far as this keeps up with it: on a
// socket of its own, so that a flood from elsewhere displaces nothing.
class RefusedCounter {
 public:
  RefusedCounter(const std::string &url, const std::vector<Network> &remote,
                 std::function<bool(std::string_view channel)> wanted);
  ~RefusedCounter();
  RefusedCounter(const RefusedCounter &) = delete;
  RefusedCounter &operator=(const RefusedCounter &) = delete;

  int fd() const { return socket_; }
  void receive(int most);

  // Datagrams of wanted channels, of a message in fragments the first.
  std::uint64_t count() const { return count_; }
  // Of the last one, "ADDRESS:PORT".
  const std::string &last() const { return last_; }

 private:
  std::function<bool(std::string_view)> wanted_;
  int socket_;
  std::uint64_t count_ = 0;
  std::string last_;
};

}  // namespace forceaxis::lcm_bus
