#pragma once
// A Modbus TCP server over libmodbus, for several clients and units, that never blocks. It handles
// frames and connections; firmware/modbus/request.h decides what a request means.
//
// libmodbus only opens the port. Its receive call blocks until a frame is whole, loses framing at
// unknown functions and answers every unit; its reply calls build responses themselves or lose the
// transaction identifier. So both are done here.
#include <cstdint>
#include <functional>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace forceaxis::modbus {

// A protocol data unit: function code and data, without unit and length.
using Pdu = std::vector<std::uint8_t>;

// The port could not be opened; what() is one line with address, port and reason.
struct ServerError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class TcpServer {
 public:
  static constexpr std::size_t kMostClients = 32;

  // Whether a unit is served here; requests for others are not answered.
  using HasUnit = std::function<bool(std::uint8_t unit)>;
  // A request of a unit: answer(client, ...) follows, at any time but not within the call. The
  // client's next request waits for it.
  using Serve = std::function<void(std::uint64_t client, std::uint8_t unit, const Pdu &request)>;

  // `address`: numeric IPv4, 0.0.0.0 for all interfaces. Throws ServerError.
  TcpServer(const std::string &address, int port, HasUnit has_unit, Serve serve);
  ~TcpServer();
  TcpServer(const TcpServer &) = delete;
  TcpServer &operator=(const TcpServer &) = delete;

  // The listening socket, to be polled; owned by the server.
  int listening() const { return listening_; }
  std::size_t clients() const { return clients_.size(); }
  // Accepts a pending connection: its number and socket, or {0, -1} if there is none or
  // kMostClients are connected.
  std::pair<std::uint64_t, int> accept();
  // Reads the pending bytes and serves a complete request. False: the connection has ended and its
  // socket is closed.
  bool receive(std::uint64_t client);
  // Sends the response to the client's pending request. False: as receive(). Ignored for a client
  // whose connection has ended.
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
