// The library of programs: what enters it, what leaves it, and that nothing else changes it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/firmware/unit/cycle_records.hpp"

namespace {

constexpr std::uint32_t kRoom = 1024;
using Records = std::vector<Bytes>;

class Library : public ::testing::Test {
 protected:
  Library() { cycle_library_init(&library_, memory_.data(), CYCLE_PROGRAM_BYTES_MAX + kRoom); }

  bool append(std::uint32_t offset, const Bytes &bytes) {
    return cycle_library_append(&library_, offset, bytes.data(),
                                static_cast<std::uint32_t>(bytes.size()));
  }
  int accept(const Bytes &record) {
    cycle_library_begin(&library_);
    EXPECT_TRUE(append(0, record));
    return cycle_library_accept(&library_, static_cast<std::uint32_t>(record.size())).reason;
  }
  static Bytes bytes_of(const cycle_header_t *program) {
    const auto *bytes = reinterpret_cast<const std::uint8_t *>(program);
    return {bytes, bytes + program->size};
  }
  // All records in the order of the library.
  std::vector<Bytes> all() const {
    std::vector<Bytes> records;
    for (std::uint8_t i = 0; i < library_.count; ++i)
      records.push_back(bytes_of(cycle_library_at(&library_, i)));
    return records;
  }

  // The bytes after the library must stay 0.
  std::vector<std::uint32_t> memory_ =
      std::vector<std::uint32_t>((CYCLE_PROGRAM_BYTES_MAX + kRoom) / 4 + 64);
  cycle_library_t library_{};
};

TEST_F(Library, ProgramsAreFoundByTheirNumber) {
  const Bytes first = cycle_record(7), second = cycle_record(0xFFFFFFFF, 3);
  EXPECT_EQ(cycle_library_find(&library_, 7), nullptr);
  EXPECT_EQ(accept(first), CYCLE_ACCEPTED);
  EXPECT_EQ(accept(second), CYCLE_ACCEPTED);
  EXPECT_EQ(all(), (Records{first, second}));
  EXPECT_EQ(bytes_of(cycle_library_find(&library_, 7)), first);
  EXPECT_EQ(bytes_of(cycle_library_find(&library_, 0xFFFFFFFF)), second);
  EXPECT_EQ(cycle_library_find(&library_, 8), nullptr);
}

TEST_F(Library, AProgramWithTheSameNumberIsReplaced) {
  ASSERT_EQ(accept(cycle_record(1)), CYCLE_ACCEPTED);
  ASSERT_EQ(accept(cycle_record(2)), CYCLE_ACCEPTED);
  ASSERT_EQ(accept(cycle_record(1, 9)), CYCLE_ACCEPTED);
  EXPECT_EQ(all(), (Records{cycle_record(2), cycle_record(1, 9)}));
}

TEST_F(Library, ARemovedProgramLeavesTheOthers) {
  for (std::uint32_t number : {1u, 2u, 3u}) ASSERT_EQ(accept(cycle_record(number)), CYCLE_ACCEPTED);
  EXPECT_FALSE(cycle_library_remove(&library_, 4));
  EXPECT_TRUE(cycle_library_remove(&library_, 2));
  EXPECT_FALSE(cycle_library_remove(&library_, 2));
  EXPECT_EQ(all(), (Records{cycle_record(1), cycle_record(3)}));
  EXPECT_TRUE(cycle_library_remove(&library_, 3));
  EXPECT_TRUE(cycle_library_remove(&library_, 1));
  EXPECT_EQ(library_.count, 0);
}

TEST_F(Library, AFullLibraryRefusesAndKeepsTheOthers) {
  const std::uint16_t points = (kRoom - 304) / 8;
  ASSERT_EQ(accept(cycle_record(1)), CYCLE_ACCEPTED);
  EXPECT_EQ(accept(cycle_record(2, points + 1)), CYCLE_NO_ROOM);
  EXPECT_EQ(all(), (Records{cycle_record(1)}));
  ASSERT_EQ(accept(cycle_record(2, points)), CYCLE_ACCEPTED) << "it fits exactly";
  EXPECT_EQ(library_.used, kRoom);
  EXPECT_EQ(accept(cycle_record(3)), CYCLE_NO_ROOM);
  EXPECT_EQ(accept(cycle_record(1, 1)), CYCLE_NO_ROOM) << "the old one stays";
  EXPECT_EQ(all(), (Records{cycle_record(1), cycle_record(2, points)}));
  EXPECT_EQ(accept(cycle_record(2, points - 1)), CYCLE_ACCEPTED) << "in place of the old one";
  EXPECT_EQ(accept(cycle_record(1, 1)), CYCLE_ACCEPTED);
}

TEST_F(Library, ARecordWithAnyFlippedBitChangesNothing) {
  ASSERT_EQ(accept(cycle_record(1)), CYCLE_ACCEPTED);
  const std::vector<std::uint32_t> before = memory_;
  Bytes record = cycle_record(1, 2);
  for (std::uint8_t &byte : record)
    for (int bit = 0; bit < 8; ++bit) {
      byte ^= static_cast<std::uint8_t>(1 << bit);
      ASSERT_NE(accept(record), CYCLE_ACCEPTED);
      byte ^= static_cast<std::uint8_t>(1 << bit);
    }
  EXPECT_TRUE(std::equal(before.begin() + CYCLE_PROGRAM_BYTES_MAX / 4, before.end(),
                         memory_.begin() + CYCLE_PROGRAM_BYTES_MAX / 4));
  EXPECT_EQ(accept(record), CYCLE_ACCEPTED);
}

TEST_F(Library, StagedBytesLeaveNoGap) {
  const Bytes record = cycle_record(5);
  EXPECT_FALSE(append(1, {1}));
  EXPECT_TRUE(append(0, {record.begin(), record.begin() + 70}));
  EXPECT_FALSE(append(71, {1}));
  EXPECT_EQ(cycle_library_accept(&library_, 152).reason, CYCLE_WRONG_SIZE) << "half of it";
  EXPECT_TRUE(append(60, {record.begin() + 60, record.end()})) << "a part that comes twice";
  EXPECT_EQ(cycle_library_accept(&library_, 152).reason, CYCLE_ACCEPTED);
  cycle_library_begin(&library_);
  EXPECT_EQ(cycle_library_accept(&library_, 152).reason, CYCLE_WRONG_SIZE) << "it was begun anew";
  EXPECT_TRUE(append(0, Bytes(CYCLE_PROGRAM_BYTES_MAX)));
  EXPECT_FALSE(append(CYCLE_PROGRAM_BYTES_MAX, {1}));
  EXPECT_FALSE(append(CYCLE_PROGRAM_BYTES_MAX - 1, {1, 2}));
}

TEST_F(Library, AProgramNeedsANumber) {
  EXPECT_EQ(accept(cycle_record(0)), CYCLE_NO_NUMBER);
  EXPECT_EQ(library_.count, 0);
}

TEST_F(Library, WithoutMemoryNothingIsStaged) {
  for (std::uint32_t bytes : {0u, 100u, std::uint32_t{CYCLE_PROGRAM_BYTES_MAX}}) {
    cycle_library_init(&library_, memory_.data(), bytes);
    EXPECT_EQ(library_.staging, nullptr);
    EXPECT_FALSE(append(0, {1}));
    EXPECT_NE(cycle_library_accept(&library_, 0).reason, CYCLE_ACCEPTED);
    EXPECT_FALSE(cycle_library_remove(&library_, 1));
  }
  cycle_library_init(&library_, nullptr, 9999);
  EXPECT_EQ(library_.staging, nullptr);
}

// Against a list of records: numbers are drawn from few, so that they meet again.
TEST_F(Library, RandomChangesAreThoseOfAList) {
  std::mt19937 random(235);
  std::vector<std::pair<std::uint32_t, Bytes>> model;
  int refused = 0, replaced = 0, removed = 0;
  for (int i = 0; i < 20000; ++i) {
    const std::uint32_t number = 1 + random() % 6;
    const auto old = std::find_if(model.begin(), model.end(),
                                  [&](const auto &entry) { return entry.first == number; });
    if (random() % 4 == 0) {
      ASSERT_EQ(cycle_library_remove(&library_, number), old != model.end());
      removed += old != model.end();
      if (old != model.end()) model.erase(old);
    } else {
      const Bytes record = cycle_record(number, static_cast<std::uint16_t>(random() % 40));
      std::size_t used = record.size();
      for (const auto &entry : model) used += entry.first == number ? 0 : entry.second.size();
      const bool fits = used <= kRoom;
      ASSERT_EQ(accept(record), fits ? CYCLE_ACCEPTED : CYCLE_NO_ROOM);
      refused += !fits;
      if (fits) {
        replaced += old != model.end();
        if (old != model.end()) model.erase(old);
        model.emplace_back(number, record);
      }
    }
    std::vector<Bytes> expected;
    for (const auto &entry : model) expected.push_back(entry.second);
    ASSERT_EQ(all(), expected);
  }
  EXPECT_GT(std::min({refused, replaced, removed}), 500);
  EXPECT_TRUE(std::all_of(memory_.end() - 64, memory_.end(), [](auto word) { return word == 0; }));
}

}  // namespace
