#pragma once
// A Modbus TCP server over libmodbus, for several clients and units, that never blocks. It knows
// frames and connections; what a request means is firmware/modbus/request.h's.
//
// libmodbus makes the port. Its way of receiving waits for the end of a frame, loses step with
// functions it does not know and answers every unit; its way of sending makes answers of its own
// or drops the transaction's number. So both are done here.
#include <cstdint>
#include <functional>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace forceaxis::modbus {

// Function code and data.
using Pdu = std::vector<std::uint8_t>;

// The port could not be had: the text says which and why.
struct ServerError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class TcpServer {
 public:
  static constexpr std::size_t kMostClients = 32;

  // Whether a unit is served here; requests for others get no answer.
  using HasUnit = std::function<bool(std::uint8_t unit)>;
  // A request of a unit: answer(client, ...) follows, at any time but not within the call. The
  // client's next request waits for it.
  using Serve = std::function<void(std::uint64_t client, std::uint8_t unit, const Pdu &request)>;

  // `address`: IPv4 in numbers; 0.0.0.0: all of this machine.
  TcpServer(const std::string &address, int port, HasUnit has_unit, Serve serve);
  ~TcpServer();
  TcpServer(const TcpServer &) = delete;
  TcpServer &operator=(const TcpServer &) = delete;

  int listening() const { return listening_; }
  std::size_t clients() const { return clients_.size(); }
  // Takes a client that waits; its number and socket, or {0, -1}.
  std::pair<std::uint64_t, int> accept();
  // Reads what has come and serves what is whole. False: the client is gone and its socket closed.
  bool receive(std::uint64_t client);
  // False: as receive(). A client that is gone already is passed over.
  bool answer(std::uint64_t client, const Pdu &answer);

 private:
  struct Client {
    int socket = -1;
    std::vector<std::uint8_t> bytes;    // received, not served yet
    std::vector<std::uint8_t> pending;  // header of the request being served; empty: none
  };

  bool serve_next(std::uint64_t number, Client &client);
  void drop(std::uint64_t number);

  HasUnit has_unit_;
  Serve serve_;
  int listening_ = -1;
  std::uint64_t last_client_ = 0;
  std::map<std::uint64_t, Client> clients_;
};

}  // namespace forceaxis::modbus
