// Frames that are broken: none of them acts, none feeds a watchdog.

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "tests/firmware/unit/fw_fixture.hpp"

namespace {

// A request that would switch off (controlword 0), with every command byte and length: an answer or
// silence as CiA 301 requires, and only a download of two bytes, or of unspecified size, acts.
TEST_F(Fw, EveryCommandByteAndLengthOfSdo) {
  for (unsigned command = 0; command < 256; ++command) {
    for (unsigned length = 0; length <= 8; ++length) {
      PowerUp();
      Drive();
      Bytes request = Request(command, 0x6040, 0, 0);
      request.resize(length);
      const Bytes answer = AskSdo(kCanopen, request);
      const unsigned specifier = command >> 5;
      const bool expedited = (command & 2) != 0;
      const bool sized = (command & 1) != 0;
      const unsigned bytes = 4 - (command >> 2 & 3);
      uint32_t abort = 0;
      bool acts = false;
      if (length < 8 || specifier == 4) {
        EXPECT_TRUE(answer.empty()) << command << ' ' << length;
      } else {
        ASSERT_EQ(answer.size(), 8u) << command;
        if (specifier == 1) {
          if (sized && expedited && bytes != 2) abort = bytes > 2 ? 0x06070012 : 0x06070013;
          if (sized && !expedited) abort = 0x06070013;  // 0 bytes announced
          acts = expedited && abort == 0;
          EXPECT_EQ(answer[0], abort == 0 ? 0x60 : 0x80) << command;
        } else if (specifier == 2) {
          EXPECT_EQ(answer[0], 0x4B) << command;
        } else {
          // Blocks: of no segments upwards; of no bytes downwards, where a size is announced.
          const bool offers = specifier == 5 && (command & 3) == 0;
          const bool begins = specifier == 6 && !sized;
          abort = offers ? 0x05040002 : begins && expedited ? 0x06070013 : begins ? 0 : 0x05040001;
        }
        if (abort != 0) {
          EXPECT_EQ(answer[0], 0x80) << command;
          EXPECT_EQ(Word(answer), abort) << std::hex << command;
        }
      }
      Tick();
      EXPECT_EQ(IsOff(), acts) << command << ' ' << length;
      EXPECT_EQ(IsOn(), !acts) << command << ' ' << length;
    }
  }
}

TEST_F(Fw, ShortRpdosAreReportedAndNotUsed) {
  for (size_t length = 0; length < 3; ++length) {
    PowerUp();
    Send(0, {1, kNode});
    Drive();
    Send(0x205, Bytes(length, 0));
    Tick();
    EXPECT_TRUE(IsOn()) << length;
    EXPECT_EQ(CountEmergencies(0x8210), 1);
  }
}

// A request that would switch off, cut after every byte and with every bit flipped: silence,
// nothing happens, it does not feed the watchdog, and the next whole request is served.
TEST_F(Fw, BrokenModbusFrames) {
  const Bytes off = Closed({kNode, 6, 0, 0, 0, 0});
  std::vector<Bytes> broken;
  for (size_t n = 1; n < off.size(); ++n)
    broken.emplace_back(off.begin(), off.begin() + static_cast<int>(n));
  for (size_t bit = 0; bit < 8 * off.size(); ++bit) {
    Bytes frame = off;
    frame[bit / 8] = static_cast<uint8_t>(frame[bit / 8] ^ 1u << (bit % 8));
    broken.push_back(frame);
  }
  for (const Bytes &frame : broken) {
    PowerUp();
    Set(AXIS_OBJ_WATCHDOG, 20);
    Drive(kRtu);
    EXPECT_EQ(Write(kRtu, AXIS_OBJ_WATCHDOG, 20), 0u);
    EXPECT_TRUE(SendRtu(frame).empty());
    Tick(10);
    EXPECT_TRUE(IsOn());
    EXPECT_TRUE(SendRtu({}).empty());
    Tick(TicksOf(20) - 10);
    EXPECT_TRUE(IsOn());
    Tick();
    EXPECT_TRUE(IsOff()) << "it fed the watchdog";
    EXPECT_EQ(Read(kRtu, AXIS_OBJ_FAULT), static_cast<uint32_t>(AXIS_FAULT_SOURCE_LOST));
  }
}

}  // namespace
