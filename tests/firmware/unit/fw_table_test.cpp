// One table of objects for every bus: access, and what is written by one reads the same by all.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <iterator>
#include <map>
#include <random>
#include <utility>
#include <vector>

#include "tests/firmware/unit/fw_fixture.hpp"

namespace {

TEST_F(Fw, ReadOnlyObjectsRefuseEveryLengthByEveryServer) {
  int count = 0;
  for (Way way : {kCanopen, kGateway, kLcm}) {
    ASSERT_TRUE(Acquires(way));
    for (const axis_address_t &at : axis_addresses) {
      if (at.what == AXIS_ADDRESS_OBJECT && axis_objects[at.value].access != AXIS_ACCESS_RO) {
        continue;
      }
      if (at.what == AXIS_ADDRESS_DOWNLOAD) continue;  // fw_programs_test.cpp
      ++count;
      for (int bytes = 1; bytes <= 4; ++bytes) {
        ASSERT_EQ(Download(way, at.index, at.sub, 1, bytes), 0x06010002u) << std::hex << at.index;
      }
      ASSERT_EQ(Word(AskSdo(way, Request(0x22, at.index, at.sub))), 0x06010002u);
      ASSERT_EQ(Word(AskSdo(way, Request(0x20, at.index, at.sub))), 0x06010002u);
      for (uint32_t size : {0u, 1u, 2u, 3u, 4u, 5u, 8u, 0xFFFFFFFFu}) {
        ASSERT_EQ(Word(AskSdo(way, Request(0x21, at.index, at.sub, size))), 0x06010002u);
      }
    }
  }
  EXPECT_GT(count, 3 * 90);
}

// Modbus: an input register is of a table that cannot be written.
TEST_F(Fw, NoInputRegisterIsAHoldingRegister) {
  ASSERT_TRUE(Acquires(kRtu));
  for (const axis_register_t &input : axis_input) {
    const bool held = std::any_of(std::begin(axis_holding), std::end(axis_holding),
                                  [&](const auto &h) { return h.first == input.first; });
    if (held) continue;
    EXPECT_EQ(AskRtu(Pdu(6, {input.first, 0}))[1], 0x86) << input.first;
  }
}

// Whatever is written by one bus reads the same by all others; what is refused changes nothing.
TEST_F(Fw, WhatOneBusWritesTheOthersRead) {
  std::mt19937 random(1988);
  std::map<std::pair<uint16_t, Way>, int> accepted;
  // Mappings can be written while no PDO is valid and nothing is mapped.
  for (unsigned pdo = 0; pdo < 4; ++pdo) {
    for (unsigned base : {0x1400u, 0x1800u}) {
      const uint32_t cob_id = Word(AskSdo(kCanopen, Request(0x40, base + pdo, 1)));
      ASSERT_EQ(Download(kCanopen, base + pdo, 1, cob_id | 0x80000000u, 4), 0u);
      ASSERT_EQ(Download(kCanopen, base + 0x200 + pdo, 0, 0, 1), 0u);
    }
  }
  int objects = 0;
  int registers = 0;
  for (uint16_t object = 1; object < AXIS_OBJ_COUNT; ++object) {
    const axis_object_t &entry = axis_objects[object];
    if (entry.access != AXIS_ACCESS_RW || entry.block == AXIS_BLOCK_NONE) continue;
    if (object == AXIS_OBJ_COMMAND_SOURCE) continue;  // the lock itself: tested above
    if (object >= AXIS_OBJ_SDO_MODBUS_RECEIVE && object <= AXIS_OBJ_SDO_LCM_TRANSMIT) {
      continue;  // the ways themselves: canopen_sdo_test.cpp
    }
    ++objects;
    if (RegisterOf(object)) ++registers;
    const int32_t power_up = Inner(object);
    std::vector<int32_t> values{entry.min, entry.max, entry.initial, power_up};
    for (int i = 0; i < 6; ++i) {
      const bool is_u32 = entry.type == AXIS_TYPE_U32;
      const int64_t low =
          is_u32 ? static_cast<int64_t>(static_cast<uint32_t>(entry.min)) : entry.min;
      const int64_t high =
          is_u32 ? static_cast<int64_t>(static_cast<uint32_t>(entry.max)) : entry.max;
      const auto offset = static_cast<int64_t>(random()) % (high - low + 1);
      values.push_back(static_cast<int32_t>(static_cast<uint32_t>(low + offset)));
    }
    values.push_back(power_up);
    for (int32_t value : values) {
      std::map<Way, bool> took;
      for (Way writer : kWays) {
        if (!Reaches(writer, object)) continue;
        ASSERT_TRUE(Acquires(writer));
        const uint32_t before = Masked(Inner(object), object);
        const bool ok = Write(writer, object, value) == 0;
        took[writer] = ok;
        accepted[{object, writer}] += ok;
        // The count of the history reads back the number of entries.
        const uint32_t expected = ok ? Masked(value, object) : before;
        for (Way reader : kWays) {
          if (!Reaches(reader, object)) continue;
          ASSERT_EQ(Read(reader, object), expected)
              << "object " << object << " value " << value << " by " << writer << " to " << reader;
        }
        ASSERT_EQ(ok, took.begin()->second) << "object " << object << " value " << value << " by "
                                            << writer << ": the buses differ";
      }
    }
    if (object == AXIS_OBJ_CONTROLWORD) Set(object, 0);
  }
  for (const auto &[which, count] : accepted) {
    EXPECT_GT(count, 0) << "object " << which.first << " by " << which.second;
  }
  EXPECT_GT(objects, 150);
  EXPECT_GT(registers, 80);
  std::printf("%d objects, %d of them registers\n", objects, registers);
}

}  // namespace
