#pragma once
// A Modbus TCP server over libmodbus, for several clients and units, that never blocks. It handles
// frames and connections; firmware/modbus/request.h decides what a request means.
//
// libmodbus only opens the port. Its receive call blocks until a frame is whole, loses framing at
// unknown functions and answers every unit; its reply calls build responses themselves or lose the
// transaction identifier. So both are done here.
//
// Clients that say nothing lock nobody out: when kMostClients are connected, a new one takes the
// place of the one that has been idle for longest, first of those that never sent a whole request.
// An idle client is otherwise left alone; one that does not finish a request within kHalf is
// closed. A client whose request is being served, or whose write was accepted within kOwner, is not
// closed for another one: that is how an owner of an axis keeps its connection. A request that is
// being served keeps its place even when its client disconnects, so no more than kMostClients of
// them wait.
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "host/modbus/frames.hpp"

namespace forceaxis::modbus {

// The port could not be opened; what() is one line with address, port and reason.
struct ServerError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class TcpServer {
 public:
  using Time = std::chrono::steady_clock::time_point;

  static constexpr std::size_t kMostClients = 32;
  // From the first byte of a request to its last one.
  static constexpr std::chrono::milliseconds kHalf{2000};
  // Longer than the longest watchdog of an axis.
  static constexpr std::chrono::milliseconds kOwner{66000};

  // A request to a unit: answer(client, ...) follows, at any time but not within the call. The
  // client's next request waits for it.
  using Serve = std::function<void(std::uint64_t client, std::uint8_t unit, const Pdu &request)>;
  // The connection with this socket ends; it is closed after the call.
  using Closing = std::function<void(int socket)>;

  // `address`: numeric IPv4, 0.0.0.0 for all interfaces. Throws ServerError.
  TcpServer(const std::string &address, int port, Serve serve, Closing closing);
  ~TcpServer();
  TcpServer(const TcpServer &) = delete;
  TcpServer &operator=(const TcpServer &) = delete;

  // The listening socket, to be polled; owned by the server.
  int listening() const { return listening_; }
  std::size_t clients() const { return clients_.size(); }
  // Accepts a pending connection: its number and socket, or {0, -1} if there is none, or none that
  // finds a place.
  std::pair<std::uint64_t, int> accept(Time now);
  // Reads the pending bytes and serves a complete request. Ignored, as answer() is, for a client
  // whose connection has ended.
  void receive(std::uint64_t client, Time now);
  // Sends the response to the client's pending request.
  void answer(std::uint64_t client, const Pdu &answer, Time now);
  // Closes the connections of clients that began a request too long ago. Once in a while.
  void close_overdue(Time now);

 private:
  struct Client {
    int socket = -1;                // -1: disconnected, its request is still being served
    FrameBuffer bytes;              // received, not served yet
    std::optional<Header> pending;  // of the request being served
    Time begun;                     // when the first byte of `bytes` was received
    Time last;                      // of the connection, the last request, or the last answer
    bool asked = false;             // sent a whole request
    std::optional<Time> written;    // a write was accepted
  };
  using Clients = std::map<std::uint64_t, Client>;

  // False: the connection must end.
  bool serve_next(std::uint64_t number, Client &client, Time now);
  // The client that gives way to a new one, or the end.
  Clients::iterator most_idle(Time now);
  void drop(Clients::iterator client);

  Serve serve_;
  Closing closing_;
  int listening_ = -1;
  std::uint64_t last_client_ = 0;
  Clients clients_;
};

}  // namespace forceaxis::modbus
