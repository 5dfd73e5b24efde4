#pragma once
// A Modbus TCP server for several clients and units that never blocks. This class handles frames
// and connections; firmware/modbus/request.h interprets the requests.
//
// This class uses libmodbus only to open the port. The receive function of libmodbus blocks until a
// frame is complete, loses the start of the frame after an unknown function code, and accepts
// requests to every unit. Its reply functions build the responses themselves or lose the
// transaction identifier. This class therefore receives requests and sends responses without
// libmodbus.
//
// Idle clients cannot block new clients. If kMostClients clients are connected, a new client
// replaces the client that has been idle for the longest time. Clients that never sent a complete
// request are replaced first. An idle client is not disconnected for any other reason. A client
// that does not complete a request within the time kHalf is disconnected. A client is not replaced
// while its request is in progress, nor for the time kOwner after an accepted write, so the owner
// of an axis keeps its connection. A client that disconnects while its request is in progress is
// counted until the request is complete, so at most kMostClients requests are in progress.
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

// Error: the TCP port could not be opened. what() is one line with address, port and reason.
struct ServerError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class TcpServer {
 public:
  using Time = std::chrono::steady_clock::time_point;

  static constexpr std::size_t kMostClients = 32;
  // Longest permitted time from the first byte to the last byte of a request.
  static constexpr std::chrono::milliseconds kHalf{2000};
  // Time after an accepted write for which a client keeps its connection. This time is longer than
  // the longest watchdog time of an axis.
  static constexpr std::chrono::milliseconds kOwner{66000};

  // Function that is called with each request to a unit. The program must call answer(client, ...)
  // after this call has returned. The next request of the client waits until then.
  using Serve = std::function<void(std::uint64_t client, std::uint8_t unit, const Pdu &request)>;
  // Function that is called before the server closes the connection with this socket.
  using Closing = std::function<void(int socket)>;

  // Opens the TCP port. `address` is a numeric IPv4 address; 0.0.0.0 stands for all interfaces.
  // Throws ServerError.
  TcpServer(const std::string &address, int port, Serve serve, Closing closing);
  ~TcpServer();
  TcpServer(const TcpServer &) = delete;
  TcpServer &operator=(const TcpServer &) = delete;

  // Returns the listening socket for poll(). The server owns this socket.
  int listening() const { return listening_; }
  std::size_t clients() const { return clients_.size(); }
  // Accepts a pending connection. Returns the client number and the socket of the client. Returns
  // {0, -1} if no connection is pending, or if the new client can replace no other client.
  std::pair<std::uint64_t, int> accept(Time now);
  // Reads the pending bytes of a client and calls Serve if a request is complete. receive() and
  // answer() have no effect for a client whose connection has ended.
  void receive(std::uint64_t client, Time now);
  // Sends the response to the client's request in progress.
  void answer(std::uint64_t client, const Pdu &answer, Time now);
  // Disconnects all clients that have not completed a request within the time kHalf. To be called
  // at intervals.
  void close_overdue(Time now);

 private:
  struct Client {
    // Socket of the client, or -1 if the client has disconnected while its request is in progress.
    int socket = -1;
    FrameBuffer bytes;              // received bytes that were not processed yet
    std::optional<Header> pending;  // header of the Modbus TCP request that is being processed
    Time begun;                     // time at which the first unprocessed byte was received
    Time last;                      // time of the last activity: connection, request or answer
    bool asked = false;             // true: the client has sent at least one complete request
    std::optional<Time> written;    // time at which a write of the client was last accepted
  };
  using Clients = std::map<std::uint64_t, Client>;

  // Serves the next complete request of a client. Returns false if the connection must be closed.
  bool serve_next(std::uint64_t number, Client &client, Time now);
  // Returns the client that a new client may replace. Returns end() if no client may be replaced.
  Clients::iterator most_idle(Time now);
  void drop(Clients::iterator client);

  Serve serve_;
  Closing closing_;
  int listening_ = -1;
  std::uint64_t last_client_ = 0;
  Clients clients_;
};

}  // namespace forceaxis::modbus
