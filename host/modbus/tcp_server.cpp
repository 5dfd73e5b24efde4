#include "host/modbus/tcp_server.hpp"

#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

namespace forceaxis::modbus {
namespace {

// Transaction, protocol (0) and length, 16 bits each, then the unit: the length counts from there.
constexpr std::size_t kHeader = 7, kBeforeLength = 6;
constexpr unsigned kMostLength = 254;

struct MappingDeleter {
  void operator()(modbus_mapping_t *mapping) const { modbus_mapping_free(mapping); }
};

// A mapping of what the request is about, filled with what was read.
std::unique_ptr<modbus_mapping_t, MappingDeleter> mapping_of(const Request &r, const Answer &a) {
  const bool coils =
      r.function == kReadCoils || r.function == kWriteCoil || r.function == kWriteCoils;
  const bool discretes = r.function == kReadDiscretes;
  const bool input = r.function == kReadInput;
  unsigned first = r.first, end = first + r.count;
  if (r.function == kReadWriteRegisters) {
    first = std::min<unsigned>(first, r.read_first);
    end = std::max<unsigned>(end, r.read_first + r.read_count);
  }
  const unsigned count = end - first;
  const auto only = [count](bool wanted) { return wanted ? count : 0; };
  std::unique_ptr<modbus_mapping_t, MappingDeleter> mapping(
      modbus_mapping_new_start_address(first, only(coils), first, only(discretes), first,
                                       only(!coils && !discretes && !input), first, only(input)));
  if (!mapping) return mapping;
  std::uint8_t *const bits = coils ? mapping->tab_bits : mapping->tab_input_bits;
  for (std::size_t i = 0; i < a.bits.size(); ++i) bits[i] = a.bits[i] ? 1 : 0;
  std::uint16_t *words = input ? mapping->tab_input_registers : mapping->tab_registers;
  if (r.function == kReadWriteRegisters) words += r.read_first - first;
  std::ranges::copy(a.words, words);
  return mapping;
}

}  // namespace

TcpServer::TcpServer(const std::string &address, int port, HasUnit has_unit, Serve serve)
    : has_unit_(std::move(has_unit)),
      serve_(std::move(serve)),
      context_(modbus_new_tcp(address.c_str(), port)) {
  const std::string where = address + ":" + std::to_string(port);
  if (!context_) throw ServerError(where + ": expected an IPv4 address and a port");
  listening_ = modbus_tcp_listen(context_.get(), static_cast<int>(kMostClients));
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
  // modbus_tcp_accept() closes the listening socket when a client has gone before it was accepted.
  const int socket = ::accept4(listening_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (socket < 0) return {0, -1};
  if (clients_.size() == kMostClients) {
    ::close(socket);
    return {0, -1};
  }
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
    // What is no Modbus has no frames to find again: the connection ends.
    if (b[2] != 0 || b[3] != 0 || length < 2 || length > kMostLength) return false;
    if (b.size() < kBeforeLength + length) return true;
    const auto end = b.begin() + static_cast<std::ptrdiff_t>(kBeforeLength + length);
    client.pending.assign(b.begin(), end);
    client.bytes.erase(b.begin(), end);
    const std::uint8_t unit = client.pending[6];
    const Parsed parsed = parse(std::span(client.pending).subspan(kHeader));
    client.request = parsed.request;
    if (!has_unit_(unit)) {
      client.pending.clear();
    } else if (parsed.exception == 0) {
      serve_(number, unit, client.request);
    } else if (!reply(client, {parsed.exception, {}, {}})) {
      return false;
    }
  }
  // A client that sends on and on without taking answers.
  return client.bytes.size() < 65536;
}

bool TcpServer::answer(std::uint64_t number, const Answer &answer) {
  const auto found = clients_.find(number);
  if (found == clients_.end()) return true;
  if (reply(found->second, answer) && serve_next(number, found->second)) return true;
  drop(number);
  return false;
}

bool TcpServer::reply(Client &client, const Answer &answer) {
  const std::vector<std::uint8_t> frame = std::exchange(client.pending, {});
  modbus_set_socket(context_.get(), client.socket);
  if (answer.exception != 0) {
    return modbus_reply_exception(context_.get(), frame.data(), answer.exception) > 0;
  }
  const auto mapping = mapping_of(client.request, answer);
  return mapping && modbus_reply(context_.get(), frame.data(), static_cast<int>(frame.size()),
                                 mapping.get()) > 0;
}

}  // namespace forceaxis::modbus
