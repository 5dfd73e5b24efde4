#pragma once
// Computes the trace hash. The records of the ticks are collected in a buffer, little-endian and
// without padding, and hashed in blocks.
#include <cstddef>
#include <cstdint>
#include <string>

#include "host/run/records.hpp"
#include "host/run/sha256.hpp"

namespace forceaxis::host {

class TraceHash {
 public:
  void add(const TickRecord &r) {
    if (size_ == sizeof bytes_) flush();
    std::uint8_t *at = bytes_ + size_;
    at = put<4>(at, r.tick);
    at = put<4>(at, static_cast<std::uint32_t>(r.encoder_cnt));
    at = put<2>(at, r.adc0_code);
    at = put<2>(at, r.adc1_code);
    at = put<1>(at, r.din);
    at = put<2>(at, static_cast<std::uint16_t>(r.dac_code));
    put<1>(at, r.out);
    size_ += kTickRecordBytes;
  }

  // Returns the hash as 64 hexadecimal digits. No record may be added after this call.
  std::string hex() {
    flush();
    return hash_.hex();
  }

 private:
  template <int kBytes>
  static std::uint8_t *put(std::uint8_t *at, std::uint32_t value) {
    for (int i = 0; i < kBytes; ++i) at[i] = static_cast<std::uint8_t>(value >> (8 * i));
    return at + kBytes;
  }
  void flush() {
    hash_.update(bytes_, size_);
    size_ = 0;
  }

  Sha256 hash_;
  std::size_t size_ = 0;
  std::uint8_t bytes_[256 * kTickRecordBytes];
};

}  // namespace forceaxis::host
