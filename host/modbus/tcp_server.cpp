#include "host/modbus/tcp_server.hpp"

#include <fcntl.h>
#include <modbus/modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>
#include <span>
#include <tuple>
#include <utility>

namespace forceaxis::modbus {
namespace {

struct ContextDeleter {
  void operator()(modbus_t *context) const { modbus_free(context); }
};

// Returns true if an answer confirms a write. The function code of an exception is not in kWrites,
// because bit 7 of this code is set.
bool is_accepted_write(const Pdu &answer) {
  constexpr std::uint8_t kWrites[] = {5, 6, 15, 16, 22, 23};
  return !answer.empty() && std::ranges::find(kWrites, answer[0]) != std::end(kWrites);
}

}  // namespace

TcpServer::TcpServer(const std::string &address, int port, Serve serve, Closing closing)
    : serve_(std::move(serve)), closing_(std::move(closing)) {
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
  for (const auto &[number, client] : clients_) {
    if (client.socket >= 0) ::close(client.socket);
  }
  ::close(listening_);
}

TcpServer::Clients::iterator TcpServer::most_idle(Time now) {
  const auto stays = [now](const Client &client) {
    return client.pending.has_value() || (client.written && now - *client.written < kOwner);
  };
  auto found = clients_.end();
  for (auto at = clients_.begin(); at != clients_.end(); ++at) {
    if (stays(at->second)) continue;
    const auto key = [](const Client &client) { return std::tuple(client.asked, client.last); };
    if (found == clients_.end() || key(at->second) < key(found->second)) found = at;
  }
  return found;
}

std::pair<std::uint64_t, int> TcpServer::accept(Time now) {
  // accept4() is used because modbus_tcp_accept() would close the listening socket if a client
  // disconnects too early.
  const int socket = ::accept4(listening_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (socket < 0) return {0, -1};
  if (clients_.size() == kMostClients) {
    const auto idle = most_idle(now);
    if (idle == clients_.end()) {
      ::close(socket);
      return {0, -1};
    }
    drop(idle);
  }
  // Nagle's algorithm is switched off, because it would delay the responses, which are small
  // packets.
  const int on = 1;
  ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  Client &client = clients_[++last_client_];
  client.socket = socket;
  client.last = now;
  return {last_client_, socket};
}

void TcpServer::drop(Clients::iterator client) {
  closing_(client->second.socket);
  ::close(client->second.socket);
  client->second.socket = -1;
  if (!client->second.pending) clients_.erase(client);
}

void TcpServer::receive(std::uint64_t number, Time now) {
  const auto found = clients_.find(number);
  if (found == clients_.end() || found->second.socket < 0) return;
  Client &client = found->second;
  std::uint8_t bytes[512];
  const ssize_t n = ::recv(client.socket, bytes, sizeof bytes, 0);
  if (n < 0 && (errno == EAGAIN || errno == EINTR)) return;
  if (n > 0) {
    if (client.bytes.empty()) client.begun = now;
    client.bytes.append(std::span(bytes, static_cast<std::size_t>(n)));
  }
  if (n <= 0 || !serve_next(number, client, now)) drop(found);
}

bool TcpServer::serve_next(std::uint64_t number, Client &client, Time now) {
  if (client.pending) return !client.bytes.broken();
  if (const auto request = client.bytes.take()) {
    client.pending = request->header;
    client.begun = now;
    client.last = now;
    client.asked = true;
    serve_(number, request->header.unit, request->pdu);
  }
  return !client.bytes.broken();
}

void TcpServer::answer(std::uint64_t number, const Pdu &answer, Time now) {
  const auto found = clients_.find(number);
  if (found == clients_.end() || !found->second.pending) return;
  Client &client = found->second;
  const std::vector<std::uint8_t> frame = frame_of(*client.pending, answer);
  client.pending.reset();
  if (client.socket < 0) {
    clients_.erase(found);
    return;
  }
  client.begun = now;
  client.last = now;
  if (is_accepted_write(answer)) client.written = now;
  const ssize_t sent = ::send(client.socket, frame.data(), frame.size(), MSG_NOSIGNAL);
  if (sent != static_cast<ssize_t>(frame.size()) || !serve_next(number, client, now)) drop(found);
}

void TcpServer::close_overdue(Time now) {
  for (auto at = clients_.begin(); at != clients_.end();) {
    const auto next = std::next(at);
    const Client &client = at->second;
    if (!client.pending && !client.bytes.empty() && now - client.begun > kHalf) drop(at);
    at = next;
  }
}

}  // namespace forceaxis::modbus
