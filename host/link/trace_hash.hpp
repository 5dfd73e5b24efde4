#pragma once
// The trace hash. Records are collected, little-endian and unpadded, and hashed many at a time.
#include <cstddef>
#include <cstdint>
#include <string>

#include "host/link/records.hpp"
#include "host/link/sha256.hpp"

namespace forceaxis::host {

class TraceHash {
 public:
  void add(const TickRecord &r) {
    if (size_ == sizeof bytes_) flush();
    put(r.tick, 4);
    put(static_cast<std::uint32_t>(r.encoder_cnt), 4);
    put(r.adc0_code, 2);
    put(r.adc1_code, 2);
    put(r.din, 1);
    put(static_cast<std::uint16_t>(r.dac_code), 2);
    put(r.out, 1);
  }

  // Ends the hash.
  std::string hex() {
    flush();
    return hash_.hex();
  }

 private:
  void put(std::uint32_t value, int count) {
    for (int i = 0; i < count; ++i) bytes_[size_++] = static_cast<std::uint8_t>(value >> (8 * i));
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
