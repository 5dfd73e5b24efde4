#pragma once
// Receives LCM messages from this machine alone, unless told of other networks. liblcm receives
// from everyone and hides the sender, so this has sockets of its own.
//
// Whether a datagram is this machine's is the kernel's knowledge, not the source address's: it came
// through the loopback interface, or is the local copy of what this machine sent to another one.
#include <functional>
#include <string>
#include <vector>

#include "host/lcm/assembly.hpp"
#include "host/lcm/lcm_ends.hpp"

namespace forceaxis::lcm_bus {

struct Network {
  std::uint32_t address,
      mask;  // as numbers of this machine; no bit of the address outside the mask
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

  // Readable when there is something to receive.
  std::vector<int> fds() const { return {socket_, refused_socket_}; }

  // Takes what has come, at most some hundred datagrams, and calls `take` for each wanted message.
  void receive(const Take &take);

  const Assembly &assembly() const { return assembly_; }
  // Datagrams for wanted channels that came from elsewhere, as far as they could be counted, and
  // whose the last one was, "ADDRESS:PORT".
  std::uint64_t refused() const { return refused_; }
  const std::string &last_refused() const { return last_refused_; }

 private:
  void receive_refused();

  std::function<bool(std::string_view)> wanted_;
  Assembly assembly_;
  std::vector<std::uint8_t> datagram_;
  int socket_ = -1, refused_socket_ = -1;
  std::uint64_t refused_ = 0;
  std::string last_refused_;
};

}  // namespace forceaxis::lcm_bus
