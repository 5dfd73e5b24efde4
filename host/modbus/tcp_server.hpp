#pragma once
// A Modbus TCP server for several clients and units that never blocks. It handles frames and
// connections; firmware/modbus/request.h interprets the requests.
//
// libmodbus only opens the port. Its receive function blocks until a frame is complete, loses the
// start of frames after unknown functions, and answers for every unit. Its reply functions build
// responses themselves or lose the transaction identifier. This class therefore receives and
// replies itself.
//
// Idle clients cannot block new clients. If kMostClients are connected, a new client replaces the
// client that has been idle for the longest time; clients that never sent a complete request are
// replaced first. An idle client is otherwise not disconnected. A client that does not complete a
// request within kHalf is disconnected. A client whose request is in progress, or whose write was
// accepted within kOwner, is not replaced, so the owner of an axis keeps its connection. A request
// in progress counts as a client even after its client has disconnected, so at most kMostClients
// requests are in progress.
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

// The port could not be opened. what() is one line with address, port and reason.
struct ServerError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class TcpServer {
 public:
  using Time = std::chrono::steady_clock::time_point;

  static constexpr std::size_t kMostClients = 32;
  // Longest time from the first byte of a request to its last byte.
  static constexpr std::chrono::milliseconds kHalf{2000};
  // Time for which a client with an accepted write keeps its connection. It is longer than the
  // longest watchdog of an axis.
  static constexpr std::chrono::milliseconds kOwner{66000};

  // Called with each request to a unit. The program must call answer(client, ...) later, but not
  // during this call. The next request of the client waits for this answer.
  using Serve = std::function<void(std::uint64_t client, std::uint8_t unit, const Pdu &request)>;
  // Called before the connection with this socket is closed.
  using Closing = std::function<void(int socket)>;

  // Opens the port. `address` is a numeric IPv4 address; 0.0.0.0 means all interfaces. Throws
  // ServerError.
  TcpServer(const std::string &address, int port, Serve serve, Closing closing);
  ~TcpServer();
  TcpServer(const TcpServer &) = delete;
  TcpServer &operator=(const TcpServer &) = delete;

  // Returns the listening socket for poll(). The server owns it.
  int listening() const { return listening_; }
  std::size_t clients() const { return clients_.size(); }
  // Accepts a pending connection. Returns the number of the client and its socket, or {0, -1} if no
  // connection is pending or no connection can be replaced.
  std::pair<std::uint64_t, int> accept(Time now);
  // Reads the pending bytes of a client and serves a complete request. receive() and answer() do
  // nothing for a client whose connection has ended.
  void receive(std::uint64_t client, Time now);
  // Sends the response to the client's request in progress.
  void answer(std::uint64_t client, const Pdu &answer, Time now);
  // Disconnects the clients that have not completed a request in time. To be called at intervals.
  void close_overdue(Time now);

 private:
  struct Client {
    // Socket of the client; -1 if it has disconnected while a request is in progress.
    int socket = -1;
    FrameBuffer bytes;              // received bytes of requests that are not yet processed
    std::optional<Header> pending;  // header of the request in progress
    Time begun;                     // time at which the first byte of `bytes` was received
    Time last;                      // time of connection, last request or last answer
    bool asked = false;             // The client has sent a complete request.
    std::optional<Time> written;    // time of the client's last accepted write
  };
  using Clients = std::map<std::uint64_t, Client>;

  // Returns false if the connection must be closed.
  bool serve_next(std::uint64_t number, Client &client, Time now);
  // Returns the client that a new client may replace, or end().
  Clients::iterator most_idle(Time now);
  void drop(Clients::iterator client);

  Serve serve_;
  Closing closing_;
  int listening_ = -1;
  std::uint64_t last_client_ = 0;
  Clients clients_;
};

}  // namespace forceaxis::modbus
