// Datagrams to commands: what the wire format of LCM allows, and what it does not, byte by byte.
#include <gtest/gtest.h>

#include <forceaxis/axis_command_t.hpp>

#include "host/lcm/assembly.hpp"
#include "host/lcm/command_message.hpp"

namespace forceaxis::lcm_bus {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr Sender kAlice{0x7F000001, 1000}, kBob{0x7F000001, 1001};
const std::string kChannel = "AXIS_1_COMMAND";

Bytes big_endian(std::uint64_t value, int size) {
  Bytes bytes;
  for (int i = size - 1; i >= 0; --i) bytes.push_back(static_cast<std::uint8_t>(value >> 8 * i));
  return bytes;
}

Bytes joined(std::initializer_list<Bytes> parts) {
  Bytes all;
  for (const Bytes &part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}

Bytes text(const std::string &s) {
  Bytes bytes(s.begin(), s.end());
  bytes.push_back(0);
  return bytes;
}

Bytes whole(const Bytes &data, const std::string &channel = kChannel) {
  return joined({{'L', 'C', '0', '2'}, big_endian(1, 4), text(channel), data});
}

struct Header {
  std::uint32_t message, bytes, offset, number, fragments;
};

Bytes fragment(Header h, const Bytes &data, const std::string &channel = kChannel) {
  return joined({{'L', 'C', '0', '3'},
                 big_endian(h.message, 4),
                 big_endian(h.bytes, 4),
                 big_endian(h.offset, 4),
                 big_endian(h.number, 2),
                 big_endian(h.fragments, 2),
                 h.number == 0 ? text(channel) : Bytes{},
                 data});
}

class AssemblyTest : public testing::Test {
 protected:
  // The data of the message that is complete with these bytes; "-" for none.
  std::string take(Sender sender, const Bytes &datagram) {
    const auto message = assembly.take(sender, datagram);
    if (!message) return "-";
    EXPECT_EQ(message->channel, kChannel);
    return {message->data.begin(), message->data.end()};
  }
  void expect_counts(std::uint64_t malformed, std::uint64_t incomplete) {
    EXPECT_EQ(assembly.malformed(), malformed);
    EXPECT_EQ(assembly.incomplete(), incomplete);
  }

  Assembly assembly{[](std::string_view channel) { return channel == kChannel; }};
};

TEST_F(AssemblyTest, AWholeMessageIsTakenOnItsChannelAlone) {
  EXPECT_EQ(take(kAlice, whole({'h', 'i'})), "hi");
  EXPECT_EQ(take(kAlice, whole({})), "");
  EXPECT_EQ(take(kAlice, whole({'h', 'i'}, "AXIS_2_COMMAND")), "-");
  expect_counts(0, 0);
}

TEST_F(AssemblyTest, WhatIsNoLcmIsCounted) {
  const std::string longest(63, 'c'), too_long(64, 'c');
  const Bytes bad[] = {
      {},
      {'L', 'C', '0', '2'},
      {'L', 'C', '0', '2', 0, 0, 0, 1},            // no channel
      {'L', 'C', '0', '2', 0, 0, 0, 1, 'A', 'X'},  // not terminated
      {'L', 'C', '0', '2', 0, 0, 0, 1, 0, 'A'},    // empty
      {'L', 'C', '0', '1', 0, 0, 0, 1, 'A', 0},
      {'L', 'C', '0', '3', 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0},  // cut off
      whole({}, too_long)};
  std::uint64_t count = 0;
  for (const Bytes &datagram : bad) {
    EXPECT_EQ(take(kAlice, datagram), "-");
    expect_counts(++count, 0);
  }
  EXPECT_EQ(take(kAlice, whole({}, longest)), "-");
  expect_counts(count, 0);
}

TEST_F(AssemblyTest, FragmentsOfTwoSendersDoNotMix) {
  EXPECT_EQ(take(kAlice, fragment({7, 4, 0, 0, 2}, {'a', 'b'})), "-");
  EXPECT_EQ(take(kBob, fragment({7, 4, 0, 0, 2}, {'A', 'B'})), "-");
  EXPECT_EQ(take(kAlice, fragment({7, 4, 2, 1, 2}, {'c', 'd'})), "abcd");
  EXPECT_EQ(take(kBob, fragment({7, 4, 2, 1, 2}, {'C', 'D'})), "ABCD");
  expect_counts(0, 0);
}

TEST_F(AssemblyTest, EveryDatagramMayBeDoubled) {
  for (std::uint32_t message = 1; message < 3; ++message) {
    const Bytes first = fragment({message, 3, 0, 0, 2}, {'a'});
    EXPECT_EQ(take(kAlice, first), "-");
    EXPECT_EQ(take(kAlice, first), "-");
    const Bytes second = fragment({message, 3, 1, 1, 2}, {'b', 'c'});
    EXPECT_EQ(take(kAlice, second), "abc");
    EXPECT_EQ(take(kAlice, second), "-");
  }
  expect_counts(0, 0);
}

TEST_F(AssemblyTest, TornFragmentsMakeNoMessage) {
  const Bytes first = fragment({7, 4, 0, 0, 2}, {'a', 'b'});
  const std::pair<const char *, Bytes> second[] = {
      {"overlaps", fragment({7, 4, 1, 1, 2}, {'c', 'd'})},
      {"leaves a hole", fragment({7, 4, 3, 1, 2}, {'d'})},
      {"passes the end", fragment({7, 4, 2, 1, 2}, {'c', 'd', 'e'})},
      {"stops before the end", fragment({7, 4, 2, 1, 2}, {'c'})},
      {"begins beyond the end", fragment({7, 4, 0xFFFFFFFF, 1, 2}, {'c', 'd'})},
      {"of another size", fragment({7, 5, 2, 1, 2}, {'c', 'd', 'e'})},
      {"of another count", fragment({7, 4, 2, 1, 3}, {'c', 'd'})},
      {"numbered beyond the count", fragment({7, 4, 2, 2, 2}, {'c', 'd'})},
      {"repeats with other bytes", fragment({7, 4, 0, 0, 2}, {'a', 'x'})},
  };
  std::uint64_t count = 0;
  for (const auto &[what, datagram] : second) {
    SCOPED_TRACE(what);
    EXPECT_EQ(take(kAlice, first), "-");
    EXPECT_EQ(take(kAlice, datagram), "-");
    expect_counts(++count, 0);
    // The rest of the message is unknown now.
    EXPECT_EQ(take(kAlice, fragment({7, 4, 2, 1, 2}, {'c', 'd'})), "-");
  }
  EXPECT_EQ(take(kAlice, first), "-");
  EXPECT_EQ(take(kAlice, fragment({7, 4, 2, 1, 2}, {'c', 'd'})), "abcd");
}

TEST_F(AssemblyTest, AMissingFragmentIsNotWaitedFor) {
  take(kAlice, fragment({7, 6, 0, 0, 3}, {'a', 'b'}));
  EXPECT_EQ(take(kAlice, fragment({7, 6, 4, 2, 3}, {'e', 'f'})), "-");
  expect_counts(0, 1);
  // The next message of the same sender replaces one that never ended.
  take(kAlice, fragment({8, 4, 0, 0, 2}, {'a', 'b'}));
  take(kAlice, fragment({9, 2, 0, 0, 2}, {'x'}));
  expect_counts(0, 2);
  EXPECT_EQ(take(kAlice, fragment({8, 4, 2, 1, 2}, {'c', 'd'})), "-");
  EXPECT_EQ(take(kAlice, fragment({9, 2, 1, 1, 2}, {'y'})), "xy");
}

TEST_F(AssemblyTest, SizesAndSendersAreLimited) {
  const auto most = static_cast<std::uint32_t>(Assembly::kMostBytes);
  EXPECT_EQ(take(kAlice, fragment({1, most + 1, 0, 0, 2}, {'a'})), "-");
  EXPECT_EQ(take(kAlice, fragment({2, 0xFFFFFFFF, 0, 0, 2}, {'a'})), "-");
  EXPECT_EQ(take(kAlice, fragment({3, 1, 0, 0, 0}, {'a'})), "-");  // of no fragments
  expect_counts(3, 0);
  EXPECT_EQ(take(kAlice, fragment({4, most, 0, 0, 2}, Bytes(most - 1, 'a'))), "-");
  EXPECT_EQ(take(kAlice, fragment({4, most, most - 1, 1, 2}, {'b'})).size(), most);
  // One sender more than is kept: the oldest message is given up.
  for (std::uint16_t port = 0; port <= Assembly::kMostSenders; ++port) {
    take({0x7F000001, port}, fragment({5, 2, 0, 0, 2}, {'a'}));
  }
  expect_counts(3, 1);
  EXPECT_EQ(take({0x7F000001, 0}, fragment({5, 2, 1, 1, 2}, {'b'})), "-");
  EXPECT_EQ(take({0x7F000001, 1}, fragment({5, 2, 1, 1, 2}, {'b'})), "ab");
}

TEST(ChannelOf, ACutOffDatagramStillSaysItsChannel) {
  EXPECT_EQ(channel_of(whole({})), kChannel);
  EXPECT_EQ(channel_of(fragment({7, 4, 0, 0, 2}, {})), kChannel);
  EXPECT_EQ(channel_of(fragment({7, 4, 2, 1, 2}, {'A', 0})), "");
  EXPECT_EQ(channel_of(Bytes{'L', 'C', '0', '3', 0, 0, 0, 1}), "");
  EXPECT_EQ(channel_of({}), "");
}

axis_command_t example() {
  axis_command_t c{};
  c.utime = 1, c.wall_utime = 2, c.seq = 3, c.run_id = 4, c.command_id = 5, c.axis = 1;
  c.objects_hash = 6, c.kind = axis_command_t::KIND_WRITE, c.timeout_us = 7;
  c.num_items = 2;
  c.object = {"force_gain", "0x6040"};
  c.value = {-1, INT64_MAX};
  c.num_signals = 1;
  c.signal = {"force"};
  return c;
}

Bytes encoded(const axis_command_t &command) {
  Bytes bytes(static_cast<std::size_t>(command.getEncodedSize()));
  command.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

// Where the fields of example() lie.
constexpr std::size_t kItems = 8 + 9 * 8, kFirstName = kItems + 4, kSecondName = kFirstName + 15,
                      kValues = kSecondName + 11, kSignals = kValues + 16;

Bytes with(Bytes bytes, std::size_t at, std::uint32_t number) {
  const Bytes field = big_endian(number, 4);
  std::copy(field.begin(), field.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at));
  return bytes;
}

TEST(DecodeCommand, WhatWasEncodedIsDecoded) {
  const auto command = decode_command(encoded(example()));
  ASSERT_TRUE(command);
  EXPECT_EQ(command->timeout_us, 7);
  EXPECT_EQ(command->object, (std::vector<std::string>{"force_gain", "0x6040"}));
  EXPECT_EQ(command->value, (std::vector<std::int64_t>{-1, INT64_MAX}));
  EXPECT_EQ(command->signal, std::vector<std::string>{"force"});
  axis_command_t empty{};
  EXPECT_TRUE(decode_command(encoded(empty)));
}

TEST(DecodeCommand, NothingMayBeMissingOrLeftOver) {
  const Bytes good = encoded(example());
  for (std::size_t size = 0; size < good.size(); ++size) {
    EXPECT_FALSE(decode_command(std::span(good).first(size))) << size;
  }
  Bytes longer = good;
  longer.push_back(0);
  EXPECT_FALSE(decode_command(longer));
}

TEST(DecodeCommand, CountsAndLengthsAreNotBelieved) {
  const Bytes good = encoded(example());
  for (const std::size_t at : {kItems, kFirstName, kSecondName, kSignals}) {
    for (const std::uint32_t count : {0xFFFFFFFFu, 0x80000000u, 0x7FFFFFFFu, 0x10000000u, 100u}) {
      EXPECT_FALSE(decode_command(with(good, at, count))) << at << ' ' << count;
    }
  }
  EXPECT_FALSE(decode_command(with(good, kFirstName, 0)));   // not even its final zero
  EXPECT_FALSE(decode_command(with(good, kFirstName, 10)));  // no zero at its end
}

TEST(DecodeCommand, AnotherTypeIsNone) {
  Bytes other = encoded(example());
  other[0] ^= 1;
  EXPECT_FALSE(decode_command(other));
}

TEST(DecodeCommand, NamesArePrintableAndAllIsLimited) {
  const auto named = [](const std::string &name, std::size_t items, std::size_t signals) {
    axis_command_t c = example();
    c.num_items = static_cast<std::int32_t>(items);
    c.object.assign(items, name);
    c.value.assign(items, 1);
    c.num_signals = static_cast<std::int32_t>(signals);
    c.signal.assign(signals, name);
    return decode_command(encoded(c)).has_value();
  };
  EXPECT_TRUE(named(std::string(255, '~'), 4096, 64));
  EXPECT_FALSE(named(std::string(256, '~'), 1, 0));
  EXPECT_FALSE(named("a", 4097, 0));
  EXPECT_FALSE(named("a", 1, 65));
  for (const char c : {'\0', '\n', '\x1b', '\x7f', '\xc3'}) {
    EXPECT_FALSE(named(std::string("a") + c + "b", 1, 0)) << int{c};
  }
}

}  // namespace
}  // namespace forceaxis::lcm_bus
