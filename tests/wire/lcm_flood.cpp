// Sends LCM noise and mutated real traffic as fast as the receivers of this network take it.
//
// usage: lcm_flood SOCKET COUNT SEED FILE
//
// SOCKET is an inherited descriptor of a connected UDP socket. FILE holds real datagrams, each
// after its length (u32, little-endian). A quarter of what is sent is noise, three quarters are
// datagrams of the file, broken: bits and numbers changed, cut off, lengthened, joined, their ends
// swapped. Prints how many were sent.
#include <sched.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <random>
#include <string>
#include <vector>

namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::size_t kBatch = 64, kLongestNoise = 1400;
// Bytes that may wait at a receiver before it gets the processor; its buffer holds some 200,000.
constexpr unsigned long kFull = 80000;

// Of all receivers at the port of LCM.
unsigned long longest_queue() {
  std::ifstream table("/proc/net/udp");
  std::string line;
  unsigned long longest = 0;
  while (std::getline(table, line)) {
    unsigned port = 0;
    unsigned long waiting = 0;
    if (std::sscanf(line.c_str(), " %*u: %*8x:%4x %*8x:%*4x %*x %*x:%lx", &port, &waiting) == 2 &&
        port == 7667) {
      longest = std::max(longest, waiting);
    }
  }
  return longest;
}

std::vector<Bytes> read_datagrams(const char *path) {
  std::ifstream file(path, std::ios::binary);
  std::vector<Bytes> all;
  std::array<unsigned char, 4> length{};
  while (file.read(reinterpret_cast<char *>(length.data()), length.size())) {
    Bytes bytes(length[0] | length[1] << 8 | length[2] << 16);
    file.read(reinterpret_cast<char *>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    all.push_back(std::move(bytes));
  }
  return all;
}

class Sender {
 public:
  Sender(std::vector<Bytes> real, std::uint64_t seed) : real_(std::move(real)), random_(seed) {}

  Bytes next() {
    if (below(4) == 0) return noise();
    Bytes bytes = any();
    for (std::size_t n = 1 + below(3); n > 0; --n) mutate(bytes);
    return bytes;
  }

 private:
  std::size_t below(std::size_t end) { return random_() % end; }
  const Bytes &any() { return real_[below(real_.size())]; }

  Bytes noise() {
    Bytes bytes(below(kLongestNoise));
    for (auto &byte : bytes) byte = static_cast<std::uint8_t>(random_());
    // Half of it begins as LCM does.
    static const std::string kBegin = "LC02";
    if (bytes.size() >= 8 && below(2) == 0) {
      std::ranges::copy(kBegin, bytes.begin());
      bytes[3] = static_cast<std::uint8_t>('2' + below(2));
    }
    return bytes;
  }

  void mutate(Bytes &bytes) {
    static constexpr std::array<std::uint32_t, 8> kNumbers{
        0, 1, 0xFFFFFFFF, 0x80000000, 0x7FFFFFFF, 0x10000000, 0xFFFF, 0x00100000};
    if (bytes.empty()) return;
    const std::size_t at = below(bytes.size());
    switch (below(6)) {
      case 0:
        bytes[at] ^= static_cast<std::uint8_t>(1 << below(8));
        break;
      case 1: {
        const std::uint32_t number = kNumbers[below(kNumbers.size())];
        for (std::size_t i = 0; i < 4 && at + i < bytes.size(); ++i) {
          bytes[at + i] = static_cast<std::uint8_t>(number >> (24 - 8 * i));
        }
        break;
      }
      case 2:
        bytes.resize(at);
        break;
      case 3:
        bytes.insert(bytes.end(), 1 + below(64), static_cast<std::uint8_t>(random_()));
        break;
      case 4: {
        const Bytes &other = any();
        bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(at), other.begin(), other.end());
      }
        bytes.resize(std::min<std::size_t>(bytes.size(), 60000));
        break;
      default: {
        const Bytes &other = any();
        bytes.resize(at);
        if (at < other.size()) {
          bytes.insert(bytes.end(), other.begin() + static_cast<std::ptrdiff_t>(at), other.end());
        }
      }
    }
  }

  std::vector<Bytes> real_;
  std::mt19937_64 random_;
};

}  // namespace

int main(int argc, char **argv) {
  if (argc != 5) return 2;
  const int socket = std::atoi(argv[1]);
  const std::size_t count = std::strtoull(argv[2], nullptr, 10);
  std::vector<Bytes> real = read_datagrams(argv[4]);
  if (real.empty()) return 2;
  Sender sender(std::move(real), std::strtoull(argv[3], nullptr, 10));
  std::size_t sent = 0;
  while (sent < count) {
    for (std::size_t i = 0; i < kBatch && sent < count; ++i) {
      const Bytes bytes = sender.next();
      if (send(socket, bytes.data(), bytes.size(), 0) >= 0) {
        ++sent;
      } else if (errno != ENOBUFS && errno != EAGAIN) {
        std::perror("lcm_flood");
        return 1;
      }
    }
    do {
      sched_yield();
    } while (longest_queue() > kFull);
  }
  std::printf("%zu\n", sent);
  return 0;
}
