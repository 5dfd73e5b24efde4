// The Modbus TCP server of the gateway, without an axis: frames, connections, units that are no
// axis. Time is an argument, so nothing here waits for it.

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <deque>
#include <fstream>
#include <list>
#include <map>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "firmware/objects/generated/axis_objects.h"
#include "host/gateway/modbus_self.hpp"
#include "host/modbus/tcp_server.hpp"

namespace {

using namespace std::chrono_literals;
using forceaxis::modbus::frame_of;
using forceaxis::modbus::FrameBuffer;
using forceaxis::modbus::Pdu;
using forceaxis::modbus::TcpServer;
using forceaxis::nodes::ModbusSelf;
using Bytes = std::vector<std::uint8_t>;

const Pdu kRead{4, 0, 0, 0, 1}, kWrite{6, 0, 8, 0, 100}, kRefused{0x86, 4};

Bytes Frame(std::uint8_t unit, const Pdu &pdu, std::uint8_t transaction = 7) {
  Bytes frame{0, transaction, 0, 0, 0, static_cast<std::uint8_t>(pdu.size() + 1), unit};
  frame.insert(frame.end(), pdu.begin(), pdu.end());
  return frame;
}

class ModbusTcp : public testing::Test {
 protected:
  // A client's end of a connection.
  class Client {
   public:
    explicit Client(ModbusTcp &test) : test_(test) {
      socket_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
      sockaddr_in to{};
      socklen_t size = sizeof to;
      getsockname(test.server_.listening(), reinterpret_cast<sockaddr *>(&to), &size);
      EXPECT_EQ(connect(socket_, reinterpret_cast<sockaddr *>(&to), size), 0);
      test.Serve();
    }
    ~Client() { close(socket_); }
    Client(const Client &) = delete;
    Client &operator=(const Client &) = delete;

    void Send(const Bytes &bytes) {
      (void)!::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      test_.Serve();
    }
    // What has been received, to the end of the connection: then it is closed.
    Bytes Receive() {
      std::uint8_t bytes[4096];
      pollfd fd{socket_, POLLIN, 0};
      Bytes all;
      while (!closed_ && poll(&fd, 1, 0) > 0) {
        const ssize_t n = recv(socket_, bytes, sizeof bytes, 0);
        closed_ = n <= 0;
        if (n > 0) all.insert(all.end(), bytes, bytes + n);
      }
      return all;
    }
    bool Closed() {
      Receive();
      return closed_;
    }
    Bytes Ask(const Pdu &pdu) {
      Send(Frame(1, pdu));
      return Receive();
    }

   private:
    ModbusTcp &test_;
    int socket_;
    bool closed_ = false;
  };

  // As the gateway does, until nothing more happens. Unit 1 is an axis: it answers with the
  // request.
  void Serve() {
    for (bool busy = true; busy;) {
      busy = false;
      std::vector<pollfd> fds{{server_.listening(), POLLIN, 0}};
      for (const auto &[socket, client] : sockets_) fds.push_back({socket, POLLIN, 0});
      if (poll(fds.data(), fds.size(), 0) <= 0) return;
      for (const pollfd &fd : fds) {
        if (fd.revents == 0) continue;
        busy = true;
        if (fd.fd == server_.listening()) {
          const auto [client, socket] = server_.accept(now_);
          if (socket >= 0) sockets_[socket] = client;
        } else if (sockets_.contains(fd.fd)) {
          server_.receive(sockets_[fd.fd], now_);
        }
        while (answers_ && !requests_.empty()) {
          const auto [client, unit, pdu] = requests_.front();
          requests_.pop_front();
          Pdu answer = accepts_ || pdu[0] < 5 ? pdu : kRefused;
          if (unit != 1) self_.serve(unit, answer = pdu);
          server_.answer(client, answer, now_);
        }
      }
    }
  }

  void After(std::chrono::milliseconds time) {
    now_ += time;
    server_.close_overdue(now_);
  }

  TcpServer::Time now_{};
  bool answers_ = true, accepts_ = true;
  ModbusSelf self_;
  std::list<std::tuple<std::uint64_t, std::uint8_t, Pdu>> requests_;
  std::map<int, std::uint64_t> sockets_;
  TcpServer server_{"127.0.0.1", 0,
                    [this](std::uint64_t client, std::uint8_t unit, const Pdu &pdu) {
                      requests_.emplace_back(client, unit, pdu);
                    },
                    [this](int socket) { sockets_.erase(socket); }};
};

// Twenty that say nothing, twenty that say half: whoever comes next is served, at once, and the
// owner, who writes, stays.
TEST_F(ModbusTcp, FortySilentClientsLockNobodyOut) {
  Client owner(*this);
  ASSERT_EQ(owner.Ask(kWrite), Frame(1, kWrite));
  std::list<Client> silent;
  for (int i = 0; i < 40; ++i) {
    now_ += 1ms;
    silent.emplace_back(*this);
    if (i % 2 == 0) silent.back().Send({0, 1, 0, 0, 0, 6, 1, 4});
    Client next(*this);
    EXPECT_EQ(next.Ask(kRead), Frame(1, kRead)) << i;
  }
  EXPECT_EQ(server_.clients(), TcpServer::kMostClients);
  EXPECT_FALSE(owner.Closed());
  EXPECT_EQ(owner.Ask(kWrite), Frame(1, kWrite));
  EXPECT_TRUE(silent.front().Closed()) << "the oldest gave way";
  EXPECT_FALSE(silent.back().Closed());
}

// Readers that ask more often than the owner writes do not displace it, for as long as an axis may
// wait for its owner.
TEST_F(ModbusTcp, AnOwnerThatWritesIsNeverTheOneClosed) {
  Client owner(*this);
  owner.Ask(kWrite);
  std::list<Client> readers;
  for (int i = 0; i < 31; ++i) readers.emplace_back(*this);
  const auto readers_ask = [&] {
    now_ += 1ms;
    for (Client &reader : readers) EXPECT_EQ(reader.Ask(kRead).size(), 12u);
  };
  now_ += 65s;
  readers_ask();
  Client next(*this);
  EXPECT_TRUE(readers.front().Closed());
  EXPECT_FALSE(owner.Closed());
  readers.pop_front();
  readers_ask();
  next.Ask(kRead);
  now_ += 2s;
  Client last(*this);
  EXPECT_TRUE(owner.Closed()) << "it has written nothing for longer than any watchdog";
}

// A write that the axis refuses makes nobody its owner.
TEST_F(ModbusTcp, ARefusedWriteKeepsNoPlace) {
  accepts_ = false;
  std::list<Client> others;
  for (int i = 0; i < 32; ++i) {
    others.emplace_back(*this);
    EXPECT_EQ(others.back().Ask(kWrite), Frame(1, kRefused));
    now_ += 1ms;
  }
  Client next(*this);
  EXPECT_EQ(next.Ask(kRead).size(), 12u);
  EXPECT_TRUE(others.front().Closed());
}

TEST_F(ModbusTcp, WhoNeverAskedGivesWayFirst) {
  std::list<Client> asked;
  for (int i = 0; i < 31; ++i) {
    asked.emplace_back(*this);
    asked.back().Ask(kRead);
  }
  now_ += 1h;
  Client silent(*this);
  Client next(*this);
  EXPECT_TRUE(silent.Closed());
  for (Client &client : asked) EXPECT_FALSE(client.Closed());
}

// When all of them are being served, the new one is closed.
TEST_F(ModbusTcp, AClientThatIsBeingServedStays) {
  answers_ = false;
  std::list<Client> busy;
  for (int i = 0; i < 32; ++i) {
    busy.emplace_back(*this);
    busy.back().Send(Frame(1, kRead));
  }
  now_ += 1h;
  Client next(*this);
  EXPECT_TRUE(next.Closed());
  for (Client &client : busy) EXPECT_FALSE(client.Closed());
}

// A stop of a client that disconnects at once is carried out; but requests of such clients
// do not pile up.
TEST_F(ModbusTcp, ClientsThatDisconnectKeepTheirPlaceUntilTheyAreServed) {
  answers_ = false;
  for (int i = 0; i < 100; ++i) {
    {
      Client client(*this);
      client.Send(Frame(1, kWrite));
    }
    Serve();
  }
  EXPECT_EQ(requests_.size(), TcpServer::kMostClients);
  EXPECT_EQ(server_.clients(), TcpServer::kMostClients);
  EXPECT_TRUE(sockets_.empty());
  for (const auto &[client, unit, pdu] : requests_) server_.answer(client, pdu, now_);
  EXPECT_EQ(server_.clients(), 0u);
}

TEST_F(ModbusTcp, AHalfRequestHasATimeAnIdleClientHasNone) {
  Client half(*this), idle(*this), served(*this);
  EXPECT_EQ(served.Ask(kRead).size(), 12u);
  half.Send({0});
  After(TcpServer::kHalf);
  half.Send({1, 0, 0, 0, 6});  // byte by byte does not prolong it
  EXPECT_FALSE(half.Closed());
  After(1ms);
  EXPECT_TRUE(half.Closed());
  After(24h);
  EXPECT_FALSE(idle.Closed());
  EXPECT_FALSE(served.Closed());
  // The time of the next request begins with the answer to the one before.
  answers_ = false;
  idle.Send(Frame(1, kRead));
  idle.Send({0, 9});
  After(1h);
  answers_ = true;
  Client other(*this);
  other.Ask(kRead);
  EXPECT_EQ(idle.Receive().size(), 12u);
  After(TcpServer::kHalf);
  EXPECT_FALSE(idle.Closed());
  After(1ms);
  EXPECT_TRUE(idle.Closed());
}

TEST_F(ModbusTcp, PiecesAndSeveralAtOnce) {
  Client client(*this);
  for (const std::uint8_t byte : Frame(1, kRead)) {
    EXPECT_TRUE(client.Receive().empty());
    client.Send({byte});
  }
  EXPECT_EQ(client.Receive(), Frame(1, kRead));
  Bytes both = Frame(1, kRead, 1), answers = both;
  for (const std::uint8_t byte : Frame(9, kWrite, 2)) both.push_back(byte);
  for (const std::uint8_t byte : Frame(9, {0x86, 10}, 2)) answers.push_back(byte);
  client.Send(both);
  EXPECT_EQ(client.Receive(), answers);
}

TEST_F(ModbusTcp, AnotherProtocolIsClosedAtOnce) {
  for (const std::string text : {"GET / HTTP/1.0\r\n\r\n", "\x16\x03\x01"}) {
    Client client(*this);
    client.Send({text.begin(), text.end()});
    EXPECT_TRUE(client.Closed()) << text;
  }
  for (const int length : {0, 1, 255, 65535}) {
    Client client(*this);
    client.Send(
        {0, 1, 0, 0, static_cast<std::uint8_t>(length >> 8), static_cast<std::uint8_t>(length)});
    EXPECT_TRUE(client.Closed()) << length;
  }
}

// A client that sends without reading is closed before its requests fill the memory.
TEST_F(ModbusTcp, AClientThatOnlySendsIsClosed) {
  answers_ = false;
  Client client(*this);
  const Bytes frame = Frame(1, kRead);
  Bytes many;
  for (int i = 0; i < 1000; ++i) many.insert(many.end(), frame.begin(), frame.end());
  for (int i = 0; i < 8 && !client.Closed(); ++i) client.Send(many);
  EXPECT_TRUE(client.Closed());
}

// The address sanitizer keeps what is freed, and is slow.
#ifdef __SANITIZE_ADDRESS__
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif

long ResidentKiB() {
  std::ifstream file("/proc/self/statm");
  long all = 0, resident = 0;
  file >> all >> resident;
  return resident * (sysconf(_SC_PAGESIZE) / 1024);
}

// Ten million bytes of noise and of requests with a few bytes changed, over as many connections as
// the server closes: it serves on, and keeps nothing.
TEST_F(ModbusTcp, NoiseEndsNothingAndIsNotKept) {
  std::minstd_rand random(5);
  const auto noise = [&random](bool mutated) {
    Bytes bytes(mutated ? 0 : 2000);
    for (auto &byte : bytes) byte = static_cast<std::uint8_t>(random());
    while (bytes.size() < 2000) {
      Pdu pdu(1 + random() % 20);
      for (auto &byte : pdu) byte = static_cast<std::uint8_t>(random());
      Bytes frame = Frame(static_cast<std::uint8_t>(2 + random() % 254), pdu);
      if (random() % 50 == 0) frame[random() % 7] = static_cast<std::uint8_t>(random());
      bytes.insert(bytes.end(), frame.begin(), frame.end());
    }
    return bytes;
  };
  Client owner(*this);
  ASSERT_EQ(owner.Ask(kWrite), Frame(1, kWrite));
  std::deque<Client> clients;
  std::size_t sent = 0, closed = 0;
  const auto send = [&](std::size_t total) {
    for (int i = 0; sent < total; ++i) {
      if (clients.size() == 40) clients.pop_front();
      clients.emplace_back(*this);
      Client &client = clients.back();
      for (int piece = 0; piece < 5 && !client.Closed(); ++piece) {
        const Bytes bytes = noise(i % 4 != 0);
        client.Send(bytes);
        sent += bytes.size();
        After(1ms);
      }
      closed += client.Closed() ? 1 : 0;
      ASSERT_LE(server_.clients(), TcpServer::kMostClients);
    }
  };
  send(1'000'000);
  const long before = ResidentKiB();
  send(kSanitized ? 2'000'000 : 10'000'000);
  EXPECT_TRUE(kSanitized || ResidentKiB() <= before + 4096) << ResidentKiB() << " of " << before;
  EXPECT_GT(closed, 100u);
  EXPECT_FALSE(owner.Closed());
  EXPECT_EQ(owner.Ask(kWrite), Frame(1, kWrite));
  Client next(*this);
  EXPECT_EQ(next.Ask(kRead), Frame(1, kRead));
}

TEST(ModbusFrames, TheLongestAndTheShortest) {
  for (const std::size_t length : {1u, 253u}) {
    const Pdu pdu(length, 3);
    FrameBuffer buffer;
    buffer.append(Frame(255, pdu));
    const auto request = buffer.take();
    ASSERT_TRUE(request) << length;
    EXPECT_EQ(request->pdu, pdu);
    EXPECT_EQ(request->header.unit, 255);
    EXPECT_EQ(frame_of(request->header, pdu), Frame(255, pdu));
    EXPECT_TRUE(buffer.empty());
  }
}

// Units that are no axis.

Pdu Answer(std::uint8_t unit, Pdu pdu) {
  ModbusSelf self;
  self.serve(unit, pdu);
  return pdu;
}

std::string Text(const Pdu &answer, std::size_t at) {
  return {answer.begin() + static_cast<std::ptrdiff_t>(at), answer.end()};
}

TEST(ModbusSelf, TheGatewayHasAnIdentity) {
  for (const std::uint8_t unit : {255, 0}) {
    EXPECT_EQ(Answer(unit, {8, 0, 0, 0x12, 0x34}), (Pdu{8, 0, 0, 0x12, 0x34}));
    const Pdu id = Answer(unit, {17});
    ASSERT_EQ(id.size(), 21u);
    EXPECT_EQ(Pdu(id.begin(), id.begin() + 4), (Pdu{17, 19, unit, 0xFF}));
    EXPECT_EQ(Text(id, 4), "forceaxis gateway");
    const Pdu name = Answer(unit, {43, 14, 4, 1});
    EXPECT_EQ(Pdu(name.begin(), name.begin() + 9), (Pdu{43, 14, 4, 0x83, 0, 0, 1, 1, 17}));
    EXPECT_EQ(Text(name, 9), "forceaxis gateway");
    const Pdu hash = Answer(unit, {43, 14, 4, 0x80});
    char expected[9];
    std::snprintf(expected, sizeof expected, "%08x", static_cast<unsigned>(AXIS_OBJECTS_HASH32));
    EXPECT_EQ(Text(hash, 9), expected);
    EXPECT_EQ(Answer(unit, {43, 14, 3, 0})[6], 6);
    EXPECT_EQ(Answer(unit, {43, 13, 1, 0}), (Pdu{0xAB, 1}));
  }
}

TEST(ModbusSelf, TheGatewayHasNoRegisters) {
  for (const std::uint8_t unit : {255, 0}) {
    for (int function = 1; function < 128; ++function) {
      if (function == 8 || function == 17 || function == 43) continue;
      const auto code = static_cast<std::uint8_t>(function);
      EXPECT_EQ(Answer(unit, {code, 0, 0, 0, 1}), (Pdu{static_cast<std::uint8_t>(code | 0x80), 1}));
    }
  }
}

TEST(ModbusSelf, CountsItsRequests) {
  ModbusSelf self;
  Pdu pdu;
  for (int i = 0; i < 3; ++i) self.serve(255, pdu = {4, 0, 0, 0, 1});
  self.serve(255, pdu = {8, 0, 13, 0, 0});
  EXPECT_EQ(pdu, (Pdu{8, 0, 13, 0, 3})) << "exceptions";
  self.serve(255, pdu = {8, 0, 14, 0, 0});
  EXPECT_EQ(pdu, (Pdu{8, 0, 14, 0, 5})) << "requests, with these two";
}

TEST(ModbusSelf, NothingIsBehindOtherUnits) {
  for (int unit = 1; unit < 255; ++unit) {
    for (const Pdu &request : {kRead, kWrite, Pdu{17}, Pdu{43, 14, 1, 0}}) {
      EXPECT_EQ(Answer(static_cast<std::uint8_t>(unit), request),
                (Pdu{static_cast<std::uint8_t>(request[0] | 0x80), 0x0A}));
    }
  }
}

}  // namespace
