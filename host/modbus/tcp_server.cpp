#include "host/modbus/tcp_server.hpp"

#include <fcntl.h>
#include <modbus/modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>
#include <utility>

namespace forceaxis::modbus {
namespace {

// Transaction, protocol (0) and length, 16 bits each, then the unit: the length counts from there.
constexpr std::size_t kHeader = 7, kBeforeLength = 6;
constexpr unsigned kMostLength = MODBUS_TCP_MAX_ADU_LENGTH - kBeforeLength;

struct ContextDeleter {
  void operator()(modbus_t *context) const { modbus_free(context); }
};

}  // namespace

TcpServer::TcpServer(const std::string &address, int port, HasUnit has_unit, Serve serve)
    : has_unit_(std::move(has_unit)), serve_(std::move(serve)) {
  const std::string where = address + ":" + std::to_string(port);
  const std::unique_ptr<modbus_t, ContextDeleter> context(modbus_new_tcp(address.c_str(), port));
  if (!context) throw ServerError(where + ": expected an IPv4 address and a port");
  listening_ = modbus_tcp_listen(context.get(), static_cast<int>(kMostClients));
  if (listening_ < 0) {
    throw ServerError(where + ": expected a free port for Modbus TCP, " + std::strerror(errno));
  }
  ::fcntl(listening_, F_SETFL, O_NONBLOCK);
}

TcpServer::~TcpServer() {
  for (const auto &[number, client] : clients_) ::close(client.socket);
  ::close(listening_);
}

std::pair<std::uint64_t, int> TcpServer::accept() {
  // modbus_tcp_accept() closes the listening socket when a client disconnects before it is
  // accepted.
  const int socket = ::accept4(listening_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (socket < 0) return {0, -1};
  if (clients_.size() == kMostClients) {
    ::close(socket);
    return {0, -1};
  }
  // Each response is one small packet; Nagle's algorithm would only delay it.
  const int on = 1;
  ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  clients_[++last_client_].socket = socket;
  return {last_client_, socket};
}

void TcpServer::drop(std::uint64_t number) {
  const auto found = clients_.find(number);
  if (found == clients_.end()) return;
  ::close(found->second.socket);
  clients_.erase(found);
}

bool TcpServer::receive(std::uint64_t number) {
  const auto found = clients_.find(number);
  if (found == clients_.end()) return true;
  Client &client = found->second;
  std::uint8_t bytes[512];
  const ssize_t n = ::recv(client.socket, bytes, sizeof bytes, 0);
  if (n < 0 && (errno == EAGAIN || errno == EINTR)) return true;
  if (n > 0) client.bytes.insert(client.bytes.end(), bytes, bytes + n);
  if (n <= 0 || !serve_next(number, client)) {
    drop(number);
    return false;
  }
  return true;
}

bool TcpServer::serve_next(std::uint64_t number, Client &client) {
  while (client.pending.empty() && client.bytes.size() >= kHeader) {
    const auto &b = client.bytes;
    const unsigned length = static_cast<unsigned>(b[4] << 8 | b[5]);
    // Without a valid header the next frame cannot be located: the connection ends.
    if (b[2] != 0 || b[3] != 0 || length < 2 || length > kMostLength) return false;
    if (b.size() < kBeforeLength + length) return true;
    const auto body = b.begin() + static_cast<std::ptrdiff_t>(kHeader);
    const auto end = b.begin() + static_cast<std::ptrdiff_t>(kBeforeLength + length);
    const std::vector<std::uint8_t> header(b.begin(), body);
    const Pdu request(body, end);
    client.bytes.erase(b.begin(), end);
    const std::uint8_t unit = header.back();
    if (!has_unit_(unit)) continue;
    client.pending = header;
    serve_(number, unit, request);
  }
  // False for a client that goes on sending requests without reading responses.
  return client.bytes.size() < 65536;
}

bool TcpServer::answer(std::uint64_t number, const Pdu &answer) {
  const auto found = clients_.find(number);
  if (found == clients_.end()) return true;
  Client &client = found->second;
  std::vector<std::uint8_t> frame = std::exchange(client.pending, {});
  const std::size_t length = answer.size() + kHeader - kBeforeLength;
  frame[4] = static_cast<std::uint8_t>(length >> 8);
  frame[5] = static_cast<std::uint8_t>(length);
  frame.insert(frame.end(), answer.begin(), answer.end());
  const ssize_t sent = ::send(client.socket, frame.data(), frame.size(), MSG_NOSIGNAL);
  if (sent == static_cast<ssize_t>(frame.size()) && serve_next(number, client)) return true;
  drop(number);
  return false;
}

}  // namespace forceaxis::modbus
