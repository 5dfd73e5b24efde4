#ifndef TESTS_UNIT_FLASH_HPP_
#define TESTS_UNIT_FLASH_HPP_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <random>

#include "firmware/port/host/firmware.hpp"
#include "tests/support/frames.hpp"

// The faults of a memory; by default none.
struct FlashFaults {
  enum class Erase {
    kSound,
    kRefused,  // reports a failure and erases nothing
    kNothing,  // reports success and erases nothing
    kHalf      // reports success and leaves the second half of the sector as it was
  };
  enum class Program {
    kSound,
    kRefused,  // clears all but one bit of the byte, and reports a failure
    kStuck,    // clears all but one bit of each byte, and reports success
    kNothing,  // reports success and programs nothing
    kHalf      // reports success and programs the first half of the bytes
  };
  Erase erase = Erase::kSound;
  Program program = Program::kSound;
  uint32_t program_from = 0;  // the addresses where `program` applies
  uint32_t program_to = UINT32_MAX;
};

// Flash: programming clears bits of blank bytes, erasing sets those of a sector. Each byte is one
// step, an erase kEraseSteps; after `life` steps the power fails in the middle of the next one.
class Flash {
 public:
  static constexpr int kErased = 0xFF;
  static constexpr int kEraseSteps = 8;

  // Two sets in each sector, and the mark at its end.
  static constexpr uint32_t kSector = 2 * ((STORE_SET_BYTES + 15) / 16 * 16) + RECORD_MARK;
  static_assert(kSector >= STORE_SECTOR_MIN && kSector < 3 * STORE_SET_BYTES);

  explicit Flash(uint32_t sector_bytes = kSector)
      : bytes_(2 * sector_bytes, kErased),
        memory_{this, sector_bytes, &Flash::Read, &Flash::Program, &Flash::Erase} {}

  Flash(const Flash &) = delete;
  Flash &operator=(const Flash &) = delete;

  const store_memory_t *memory() const { return &memory_; }
  Bytes &bytes() { return bytes_; }

  // Power for so many steps, with the bits of a torn step by `seed`; -1: for ever.
  void PowerFor(int64_t life, uint32_t seed) {
    life_ = life;
    random_.seed(seed);
  }
  int64_t steps() const { return steps_; }
  int erases() const { return erases_; }
  bool misused() const { return misused_; }
  int64_t bytes_read() const { return bytes_read_; }
  int most_per_call() const { return most_per_call_; }

  FlashFaults faults;

  // A bit that changes by itself, either way.
  void Flip(size_t at, int bit) { bytes_[at] ^= static_cast<uint8_t>(1 << bit); }

 private:
  static Flash &Of(void *context) { return *static_cast<Flash *>(context); }

  static void Read(void *context, uint32_t address, uint8_t *to, uint32_t count) {
    Flash &f = Of(context);
    f.misused_ |= address + count > f.bytes_.size();
    f.bytes_read_ += count;
    std::copy_n(f.bytes_.begin() + address, count, to);
  }

  static bool Program(void *context, uint32_t address, const uint8_t *from, uint32_t count) {
    Flash &f = Of(context);
    f.misused_ |= address % 4 != 0 || count % 4 != 0 || address + count > f.bytes_.size();
    f.most_per_call_ = std::max(f.most_per_call_, static_cast<int>(count));
    const auto fault = [&](uint32_t i) {
      const bool here = address + i >= f.faults.program_from && address + i < f.faults.program_to;
      return here ? f.faults.program : FlashFaults::Program::kSound;
    };
    for (uint32_t i = 0; i < count; ++i) {
      uint8_t &byte = f.bytes_[address + i];
      if (f.life_ == 0) return false;
      f.misused_ |= byte != kErased;
      ++f.steps_;
      if (f.life_ > 0 && --f.life_ == 0) {
        // Torn: some of the bits that were to be cleared are.
        byte &= static_cast<uint8_t>(from[i] | f.random_());
        return false;
      }
      switch (fault(i)) {
        case FlashFaults::Program::kRefused:
          byte &= static_cast<uint8_t>(from[i] | 0x40);
          return false;
        case FlashFaults::Program::kStuck:
          byte &= static_cast<uint8_t>(from[i] | 0x40);
          break;
        case FlashFaults::Program::kNothing:
          break;
        case FlashFaults::Program::kHalf:
          if (i < count / 2) byte &= from[i];
          break;
        case FlashFaults::Program::kSound:
          byte &= from[i];
      }
    }
    return true;
  }

  static bool Erase(void *context, uint8_t sector) {
    Flash &f = Of(context);
    const size_t size = f.bytes_.size() / 2;
    const auto begin = f.bytes_.begin() + static_cast<std::ptrdiff_t>(sector * size);
    if (f.life_ == 0) return false;
    f.misused_ |= sector > 1;
    ++f.erases_;
    if (f.faults.erase == FlashFaults::Erase::kRefused) return false;
    if (f.faults.erase == FlashFaults::Erase::kNothing) return true;
    for (int step = 1; step <= kEraseSteps; ++step) {
      ++f.steps_;
      if (f.life_ > 0 && --f.life_ == 0) {
        // Partly erased: some bytes wholly, some in a few bits, some not at all.
        for (size_t i = 0; i < size; ++i) {
          const uint32_t luck = f.random_() % kEraseSteps;
          auto &byte = *(begin + static_cast<std::ptrdiff_t>(i));
          if (luck < static_cast<uint32_t>(step)) byte = kErased;
          if (luck == static_cast<uint32_t>(step)) byte |= static_cast<uint8_t>(f.random_());
        }
        return false;
      }
    }
    std::fill_n(begin, f.faults.erase == FlashFaults::Erase::kHalf ? size / 2 : size, kErased);
    return true;
  }

  Bytes bytes_;
  store_memory_t memory_;
  std::minstd_rand random_;
  int64_t life_ = -1;
  int64_t steps_ = 0;
  int64_t bytes_read_ = 0;
  int erases_ = 0;
  int most_per_call_ = 0;
  bool misused_ = false;
};

#endif
