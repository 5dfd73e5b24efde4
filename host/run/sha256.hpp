#pragma once
// Computes SHA-256 hashes (FIPS 180-4).
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>

namespace forceaxis::host {

class Sha256 {
 public:
  void update(const void *data, std::size_t bytes) {
    const auto *from = static_cast<const std::uint8_t *>(data);
    bytes_ += bytes;
    while (bytes > 0) {
      if (used_ == 0 && bytes >= kBlockBytes) {
        add_block(from);
        from += kBlockBytes;
        bytes -= kBlockBytes;
        continue;
      }
      const std::size_t part = bytes < kBlockBytes - used_ ? bytes : kBlockBytes - used_;
      std::memcpy(block_.data() + used_, from, part);
      used_ += part;
      from += part;
      bytes -= part;
      if (used_ == kBlockBytes) {
        add_block(block_.data());
        used_ = 0;
      }
    }
  }
  // Adds the length of a text and the text, so that the texts ("ab", "c") and ("a", "bc") have
  // different hashes.
  void update(const std::string &text) {
    const std::string length = std::to_string(text.size()) + ":";
    update(length.data(), length.size());
    update(text.data(), text.size());
  }

  // Returns the hash as 64 lower-case hexadecimal digits. No data may be added after this call.
  std::string hex() {
    // The end of the data is a bit 1, bits 0 to a multiple of the block, and the number of bits.
    const std::uint64_t bits = 8 * bytes_;
    const std::array<std::uint8_t, kBlockBytes> one_and_zeros{0x80};
    update(one_and_zeros.data(), 1 + (2 * kBlockBytes - 9 - used_) % kBlockBytes);
    std::array<std::uint8_t, 8> count;
    for (unsigned i = 0; i < 8; ++i) count[i] = static_cast<std::uint8_t>(bits >> (56 - 8 * i));
    update(count.data(), count.size());
    std::string text;
    for (const std::uint32_t word : state_) {
      for (int shift = 28; shift >= 0; shift -= 4) text += "0123456789abcdef"[word >> shift & 15];
    }
    return text;
  }

 private:
  static constexpr std::size_t kBlockBytes = 64;
  // The first 32 bits of the fractions of the cube roots of the first 64 primes.
  static constexpr std::array<std::uint32_t, 64> kRoundConstants{
      0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4,
      0xab1c5ed5, 0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe,
      0x9bdc06a7, 0xc19bf174, 0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f,
      0x4a7484aa, 0x5cb0a9dc, 0x76f988da, 0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7,
      0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967, 0x27b70a85, 0x2e1b2138, 0x4d2c6dfc,
      0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85, 0xa2bfe8a1, 0xa81a664b,
      0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070, 0x19a4c116,
      0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
      0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7,
      0xc67178f2};

  void add_block(const std::uint8_t *bytes) {
    std::array<std::uint32_t, 64> w;
    for (std::size_t i = 0; i < 16; ++i) {
      const std::uint8_t *at = bytes + 4 * i;
      w[i] = std::uint32_t{at[0]} << 24 | std::uint32_t{at[1]} << 16 | std::uint32_t{at[2]} << 8 |
             at[3];
    }
    for (std::size_t i = 16; i < 64; ++i) {
      const std::uint32_t a = w[i - 15], b = w[i - 2];
      w[i] = w[i - 16] + (std::rotr(a, 7) ^ std::rotr(a, 18) ^ a >> 3) + w[i - 7] +
             (std::rotr(b, 17) ^ std::rotr(b, 19) ^ b >> 10);
    }
    auto [a, b, c, d, e, f, g, h] = state_;
    for (std::size_t i = 0; i < 64; ++i) {
      const std::uint32_t t1 = h + (std::rotr(e, 6) ^ std::rotr(e, 11) ^ std::rotr(e, 25)) +
                               ((e & f) ^ (~e & g)) + kRoundConstants[i] + w[i];
      const std::uint32_t t2 =
          (std::rotr(a, 2) ^ std::rotr(a, 13) ^ std::rotr(a, 22)) + ((a & b) ^ (a & c) ^ (b & c));
      h = g, g = f, f = e, e = d + t1;
      d = c, c = b, b = a, a = t1 + t2;
    }
    const std::array<std::uint32_t, 8> added{a, b, c, d, e, f, g, h};
    for (std::size_t i = 0; i < 8; ++i) state_[i] += added[i];
  }

  // The first 32 bits of the fractions of the square roots of the first 8 primes.
  std::array<std::uint32_t, 8> state_{0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                      0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
  std::array<std::uint8_t, kBlockBytes> block_;  // last bytes of the data, which are fewer than a
                                                 // block of the hash needs
  std::size_t used_ = 0;                         // number of bytes in block_
  std::uint64_t bytes_ = 0;  // total number of bytes of the hashed data until now
};

}  // namespace forceaxis::host
