// The force of an IIO device, with a sysfs of the test's own and a FIFO as its buffer. Types, order
// and alignment are those of the kernel's documents (sysfs-bus-iio, iio_devbuf, iio buffers).
#include "firmware/port/linux/iio.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<std::uint8_t>;

TEST(IioType, IsReadAsTheKernelWritesIt) {
  const struct {
    const char *text;
    bool is_big, is_signed;
    int bits, bytes, repeat, shift;
  } good[] = {
      {"le:s12/16>>4\n", false, true, 12, 2, 1, 4},  // the accelerometer of iio_devbuf
      {"be:u24/32>>8\n", true, false, 24, 4, 1, 8},
      {"le:s24/32>>8\n", false, true, 24, 4, 1, 8},
      {"be:u24/32>>0\n", true, false, 24, 4, 1, 0},
      {"le:s64/64>>0\n", false, true, 64, 8, 1, 0},  // a timestamp
      {"le:u8/8", false, false, 8, 1, 1, 0},
      {"le:s16/16X4>>0", false, true, 16, 2, 4, 0},  // a quaternion
  };
  for (const auto &c : good) {
    iio_type_t type{};
    ASSERT_TRUE(iio_type_of(c.text, &type)) << c.text;
    EXPECT_EQ(type.is_big, c.is_big) << c.text;
    EXPECT_EQ(type.is_signed, c.is_signed) << c.text;
    EXPECT_EQ(type.bits, c.bits) << c.text;
    EXPECT_EQ(type.bytes, c.bytes) << c.text;
    EXPECT_EQ(type.repeat, c.repeat) << c.text;
    EXPECT_EQ(type.shift, c.shift) << c.text;
  }
  for (const char *text : {"",
                           "le",
                           "le:",
                           "xe:s16/16>>0",
                           "le:f32/32>>0",
                           "le:s/16>>0",
                           "le:s16/>>0",
                           "le:s16",
                           "le:s0/16",
                           "le:s24/24>>0",
                           "le:s16/12>>0",
                           "le:s17/16>>0",
                           "le:s12/16>>5",
                           "le:s16/16>>",
                           "le:s16/16X",
                           "le:s16/16X3>>0",
                           "le:s16/16>>0 ",
                           "le:s-1/16>>0",
                           "le:s99999999999999999999/16",
                           "le:s16/128>>0"}) {
    iio_type_t type{};
    EXPECT_FALSE(iio_type_of(text, &type)) << text;
  }
}

std::int64_t value_of(const char *text, const Bytes &bytes) {
  iio_type_t type{};
  EXPECT_TRUE(iio_type_of(text, &type)) << text;
  EXPECT_EQ(type.bytes, bytes.size()) << text;
  return iio_value(&type, bytes.data());
}

TEST(IioType, GivesTheValueOfItsBytes) {
  EXPECT_EQ(value_of("le:u8/8", {0xFE}), 254);
  EXPECT_EQ(value_of("le:s8/8", {0xFE}), -2);
  EXPECT_EQ(value_of("be:s16/16>>0", {0xFF, 0x00}), -256);
  EXPECT_EQ(value_of("le:s16/16>>0", {0xFF, 0x00}), 255);
  // D3..D0 and four unused bits in the lower byte: 0x7AB, then -1, then the least number.
  EXPECT_EQ(value_of("le:s12/16>>4", {0xBF, 0x7A}), 0x7AB);
  EXPECT_EQ(value_of("le:s12/16>>4", {0xF5, 0xFF}), -1);
  EXPECT_EQ(value_of("le:s12/16>>4", {0x0F, 0x80}), -2048);
  EXPECT_EQ(value_of("le:s24/32>>8", {0xEE, 0x56, 0x34, 0x12}), 0x123456);
  EXPECT_EQ(value_of("le:s24/32>>8", {0xEE, 0xFF, 0xFF, 0xFF}), -1);
  EXPECT_EQ(value_of("be:u24/32>>0", {0xEE, 0x12, 0x34, 0x56}), 0x123456) << "padding is ignored";
  EXPECT_EQ(value_of("be:u24/32>>8", {0x80, 0x00, 0x01, 0xEE}), 0x800001);
  EXPECT_EQ(value_of("le:u32/32>>0", {0xFF, 0xFF, 0xFF, 0xFF}), 0xFFFFFFFF);
  EXPECT_EQ(value_of("le:s32/32>>0", {0x00, 0x00, 0x00, 0x80}), -2147483648LL);
  EXPECT_EQ(value_of("be:s32/64>>16", {0, 0, 0x80, 0, 0, 0, 0xAB, 0xCD}), -2147483648LL);
}

class Iio : public ::testing::Test {
 protected:
  Iio() : device_(fs::path(::testing::TempDir()) / ("iio" + std::to_string(getpid()))) {
    fs::remove_all(device_);
    fs::create_directories(device_ / "scan_elements");
    fs::create_directories(device_ / "buffer");
    put("buffer/enable", "1\n");
    buffer_ = (device_ / "fifo").string();
    folder_ = device_.string();
    EXPECT_EQ(mkfifo(buffer_.c_str(), 0600), 0);
  }
  ~Iio() override {
    if (iio_.fd > 0) close(iio_.fd);
    if (writer_ >= 0) close(writer_);
    fs::remove_all(device_);
  }

  void put(const fs::path &name, const std::string &text) { std::ofstream(device_ / name) << text; }

  void channel(const std::string &name, int index, const std::string &type, bool enabled = true) {
    put("scan_elements/in_" + name + "_en", enabled ? "1\n" : "0\n");
    put("scan_elements/in_" + name + "_index", std::to_string(index) + "\n");
    put("scan_elements/in_" + name + "_type", type + "\n");
  }

  std::string open(const char *name = "voltage0", int shift = IIO_SHIFT_OWN) {
    const iio_settings_t settings{folder_.c_str(), buffer_.c_str(), name,
                                  static_cast<std::uint8_t>(shift)};
    const char *error = iio_open(&iio_, &settings);
    if (error == nullptr) begin_writing();
    return error == nullptr ? "" : error;
  }

  void begin_writing() { writer_ = ::open(buffer_.c_str(), O_WRONLY | O_NONBLOCK); }

  void end_writing() {
    close(writer_);
    writer_ = -1;
  }

  void send(const Bytes &bytes) {
    ASSERT_EQ(write(writer_, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  }

  // The code of a call; -1 if there was no scan.
  int take() {
    std::uint16_t code = 0xBEEF;
    const bool found = iio_take(&iio_, &code);
    if (!found) {
      EXPECT_EQ(code, 0xBEEF);
    }
    return found ? code : -1;
  }

  fs::path device_;
  std::string folder_, buffer_;
  iio_t iio_{};
  int writer_ = -1;
};

TEST_F(Iio, TheUpper16BitsAreTheCode) {
  const struct {
    const char *type;
    Bytes bytes;
    int code;
  } cases[] = {
      {"be:u24/32>>0", {0, 0x12, 0x34, 0x56}, 0x1234},
      {"le:s24/32>>8", {0, 0x56, 0x34, 0x12}, 0x1234 + 32768},
      {"le:s24/32>>8", {0, 0xFF, 0xFF, 0xFF}, 32767},
      {"le:s24/32>>8", {0, 0x00, 0x00, 0x80}, 0},
      {"le:u32/32>>0", {0xFF, 0xFF, 0xFF, 0xFF}, 65535},
      {"be:s16/16>>0", {0x7F, 0xFF}, 65535},
      {"le:u12/16>>4", {0xF0, 0xFF}, 4095},
      {"le:u8/8", {200}, 200},
  };
  for (const auto &c : cases) {
    channel("voltage0", 0, c.type);
    ASSERT_EQ(open(), "") << c.type;
    send(c.bytes);
    EXPECT_EQ(take(), c.code) << c.type;
    close(iio_.fd);
    end_writing();
  }
}

TEST_F(Iio, AShiftOfTheSettingsCountsInItsPlace) {
  channel("voltage0", 0, "le:s24/32>>8");
  ASSERT_EQ(open("voltage0", 4), "");
  send({0, 0x40, 0x02, 0x00});  // 576 / 16
  EXPECT_EQ(take(), 32768 + 36);
  send({0, 0xFF, 0xFF, 0x7F});
  EXPECT_EQ(take(), 65535) << "beyond the range: the end of it";
  send({0, 0xFF, 0xFF, 0xFF});
  EXPECT_EQ(take(), 32767) << "-1 / 16 rounds down";
}

// Of the kernel's documents: three values of 16 bits, then a timestamp at a multiple of its 8
// bytes.
TEST_F(Iio, OtherChannelsAndATimestampAreSkipped) {
  channel("timestamp", 9, "le:s64/64>>0");
  channel("voltage2", 2, "be:u16/16>>0");
  channel("voltage1", 1, "be:u16/16>>0");
  channel("voltage0", 0, "be:u16/16>>0");
  channel("voltage3", 3, "be:u16/16>>0", false);
  ASSERT_EQ(open("voltage2"), "");
  EXPECT_EQ(iio_.scan, 16);
  send({1, 1, 2, 2, 3, 4, 0xEE, 0xEE, 9, 9, 9, 9, 9, 9, 9, 9});
  EXPECT_EQ(take(), 0x0304);
}

TEST_F(Iio, AValueBeginsAtAMultipleOfItsSize) {
  channel("voltage0", 4, "le:u32/32>>0");
  channel("temp", 1, "le:s8/8");
  channel("voltage1", 7, "le:u16/16>>0");
  channel("rot", 8, "le:s16/16X2>>0");
  ASSERT_EQ(open("voltage1"), "");
  // 1 byte, 3 of padding, 4, then 2, 2 of padding, 2 x 2
  EXPECT_EQ(iio_.scan, 16);
  send({7, 0xEE, 0xEE, 0xEE, 1, 1, 1, 1, 0x34, 0x12, 0xEE, 0xEE, 5, 5, 6, 6});
  EXPECT_EQ(take(), 0x1234);
}

TEST_F(Iio, AScanIsAMultipleOfItsLargestValue) {
  channel("voltage0", 0, "le:u32/32>>0");
  channel("voltage1", 1, "le:u8/8");
  ASSERT_EQ(open("voltage1"), "");
  EXPECT_EQ(iio_.scan, 8);
  send({1, 1, 1, 1, 42, 0xEE, 0xEE, 0xEE, 2, 2, 2, 2, 43, 0xEE, 0xEE, 0xEE});
  EXPECT_EQ(take(), 43);
}

TEST_F(Iio, TheNewestWholeScanCounts) {
  channel("voltage0", 0, "be:u16/16>>0");
  ASSERT_EQ(open(), "");
  EXPECT_EQ(take(), -1) << "no scan yet";
  send({0, 1, 0, 2, 0, 3});
  EXPECT_EQ(take(), 3);
  EXPECT_EQ(take(), -1) << "no new one";
  send({0});
  EXPECT_EQ(take(), -1) << "half a scan";
  EXPECT_EQ(take(), -1);
  send({4, 0});
  EXPECT_EQ(take(), 4);
  send({5, 0, 6, 0});
  EXPECT_EQ(take(), 6);
  send({7});
  EXPECT_EQ(take(), 7);
  EXPECT_EQ(iio_trouble(&iio_), nullptr);
}

// More than one read can hold: the call is bounded, and the rest follows in the next ones.
TEST_F(Iio, ManyScansAtOnce) {
  channel("voltage0", 0, "be:u16/16>>0");
  ASSERT_EQ(open(), "");
  Bytes bytes;
  const int scans = 30000;
  for (int i = 1; i <= scans; ++i) {
    bytes.push_back(static_cast<std::uint8_t>(i >> 8));
    bytes.push_back(static_cast<std::uint8_t>(i));
  }
  send(bytes);
  const int at_once = IIO_READS * IIO_BYTES / 2;
  EXPECT_EQ(take(), at_once);
  int last = at_once;
  for (int calls = 0; last < scans; ++calls) {
    ASSERT_LT(calls, 5);
    last = take();
  }
  EXPECT_EQ(last, scans);
  EXPECT_EQ(take(), -1);
}

// Any division of the same bytes into pieces gives the same newest scan after each piece.
TEST_F(Iio, EverySplitGivesTheSameScans) {
  channel("voltage0", 0, "le:u16/16>>0");
  channel("timestamp", 1, "le:s64/64>>0");
  ASSERT_EQ(open(), "");
  ASSERT_EQ(iio_.scan, 16);
  std::uint32_t state = 12345;
  Bytes waiting;
  int written = 0, taken = -1, scan = 0;
  for (int round = 0; round < 3000; ++round) {
    state = state * 1664525u + 1013904223u;
    const int piece = static_cast<int>(state >> 16) % 60;
    Bytes bytes;
    for (int i = 0; i < piece; ++i, ++written) {
      const int number = written / 16, place = written % 16;
      bytes.push_back(static_cast<std::uint8_t>(place == 0   ? number
                                                : place == 1 ? number >> 8
                                                             : 0xEE));
    }
    send(bytes);
    const int whole = written / 16;
    taken = take();
    EXPECT_EQ(taken, whole > scan ? whole - 1 : -1) << round;
    scan = whole;
  }
}

TEST_F(Iio, TheEndOfTheBufferIsNamedAndDoesNotLast) {
  channel("voltage0", 0, "be:u16/16>>0");
  ASSERT_EQ(open(), "");
  send({0, 9});
  end_writing();
  EXPECT_EQ(take(), 9);
  EXPECT_EQ(take(), -1);
  ASSERT_NE(iio_trouble(&iio_), nullptr);
  EXPECT_EQ(iio_trouble(&iio_), std::string("the buffer of the force has ended"));
  begin_writing();
  send({0, 10});
  EXPECT_EQ(take(), 10);
  EXPECT_EQ(take(), -1);
  EXPECT_EQ(iio_trouble(&iio_), nullptr);
}

TEST_F(Iio, AnErrorOfTheBufferIsNamed) {
  channel("voltage0", 0, "be:u16/16>>0");
  ASSERT_EQ(open(), "");
  close(iio_.fd);
  iio_.fd = ::open(folder_.c_str(), O_RDONLY);  // a folder cannot be read
  EXPECT_EQ(take(), -1);
  EXPECT_EQ(iio_trouble(&iio_), std::string(strerror(EISDIR)));
}

TEST_F(Iio, WhatIsMissingIsOneSentence) {
  const auto expect = [this](const std::string &part, const char *name = "voltage0") {
    const std::string error = open(name);
    EXPECT_NE(error.find(part), std::string::npos) << error;
    EXPECT_EQ(error.find('\n'), std::string::npos);
  };
  expect("expected that the channel voltage0 is enabled; write 1 to in_voltage0_en");
  channel("voltage0", 0, "le:s24/32>>8", false);
  expect("expected that the channel voltage0 is enabled");
  channel("voltage0", 0, "le:s24/24>>0");
  expect("in_voltage0_type: expected a type such as le:s24/32>>8");
  channel("voltage0", 0, "le:s48/64>>0");
  expect("channel voltage0: expected a single value of 1 to 32 bits");
  channel("voltage0", 0, "le:s16/16X2>>0");
  expect("channel voltage0: expected a single value");
  channel("voltage0", 0, "le:s16/16>>0");
  fs::remove(device_ / "scan_elements/in_voltage0_index");
  expect("expected a file");
  channel("voltage0", 0, "le:s16/16>>0");
  put("buffer/enable", "0\n");
  expect("expected an enabled buffer; write 1 to " + folder_ + "/buffer/enable");
  put("buffer/enable", "1\n");
  fs::remove(buffer_);
  expect("expected a buffer " + buffer_ + " that can be read: No such file");
  for (int i = 0; i < 40; ++i) channel("extra" + std::to_string(i), 10 + i, "le:s64/64>>0");
  expect("expected at most 32 enabled channels");
  fs::remove_all(device_ / "scan_elements");
  expect("scan_elements: No such file");
}

TEST_F(Iio, AScanThatIsTooLongIsRefused) {
  channel("voltage0", 0, "le:s16/16>>0");
  for (int i = 0; i < 31; ++i) channel("extra" + std::to_string(i), 1 + i, "le:s64/64>>0");
  ASSERT_EQ(open(), "");  // 8 + 31 x 8
  EXPECT_EQ(iio_.scan, 256);
  channel("extra30", 31, "le:s64/64X2>>0");
  EXPECT_NE(open().find("in a scan of at most 256 bytes"), std::string::npos);
}

}  // namespace
