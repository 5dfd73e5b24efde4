// The SDO client of the gateway against bytes written by hand from CiA 301, 7.2.4.3.
#include "host/canopen/sdo_client.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

namespace {

using forceaxis::canopen::Frame;
using forceaxis::canopen::SdoClient;
using forceaxis::canopen::SdoResult;
using Bytes = std::array<std::uint8_t, 8>;

Frame answer(const Bytes &data) { return {0x581, 8, data}; }

std::vector<std::uint8_t> bytes_of(const std::string &text) { return {text.begin(), text.end()}; }

TEST(SdoClient, ExpeditedUploadTakesTheLengthFromTheAnswer) {
  SdoClient client(0x601);
  const Frame request = client.upload(0x6041, 0);
  EXPECT_EQ(request.id, 0x601U);
  EXPECT_EQ(request.length, 8);
  EXPECT_EQ(request.data, (Bytes{0x40, 0x41, 0x60, 0, 0, 0, 0, 0}));
  EXPECT_FALSE(client.receive(answer({0x4B, 0x41, 0x60, 0, 0x37, 0x02, 0, 0})));
  EXPECT_FALSE(client.busy());
  const SdoResult result = client.take_result();
  EXPECT_TRUE(result.ok());
  EXPECT_EQ(result.data, (std::vector<std::uint8_t>{0x37, 0x02}));
}

TEST(SdoClient, SegmentedUploadAlternatesItsToggleBit) {
  SdoClient client(0x601);
  client.upload(0x1008, 0);
  auto next = client.receive(answer({0x41, 0x08, 0x10, 0, 9, 0, 0, 0}));
  ASSERT_TRUE(next);
  EXPECT_EQ(next->data, (Bytes{0x60, 0, 0, 0, 0, 0, 0, 0}));
  next = client.receive(answer({0x00, 'f', 'o', 'r', 'c', 'e', 'a', 'x'}));
  ASSERT_TRUE(next);
  EXPECT_EQ(next->data[0], 0x70);
  // Last segment: five bytes without data, toggle set.
  EXPECT_FALSE(client.receive(answer({0x1B, 'i', 's', 0, 0, 0, 0, 0})));
  EXPECT_EQ(client.take_result().data, bytes_of("forceaxis"));
}

TEST(SdoClient, UploadThatLostBytesIsAborted) {
  SdoClient client(0x601);
  client.upload(0x1008, 0);
  client.receive(answer({0x41, 0x08, 0x10, 0, 9, 0, 0, 0}));
  const auto next = client.receive(answer({0x0B, 'i', 's', 0, 0, 0, 0, 0}));
  ASSERT_TRUE(next);
  EXPECT_EQ(next->data, (Bytes{0x80, 0x08, 0x10, 0, 0x10, 0x00, 0x07, 0x06}));
  EXPECT_EQ(client.take_result().abort, 0x06070010U);
}

TEST(SdoClient, WrongToggleIsAborted) {
  SdoClient client(0x601);
  client.upload(0x1008, 0);
  client.receive(answer({0x41, 0x08, 0x10, 0, 9, 0, 0, 0}));
  const auto next = client.receive(answer({0x10, 'f', 'o', 'r', 'c', 'e', 'a', 'x'}));
  ASSERT_TRUE(next);
  EXPECT_EQ(next->data, (Bytes{0x80, 0x08, 0x10, 0, 0, 0, 0x03, 0x05}));
  EXPECT_FALSE(client.busy());
}

TEST(SdoClient, AnUploadThatWasAskedForTwiceIsAnsweredTwice) {
  SdoClient client(0x601);
  client.upload(0x1008, 0);
  client.time_out();
  client.take_result();
  client.upload(0x1008, 0);
  // The first answer was only late. The server has a value of another length for the second one.
  ASSERT_TRUE(client.receive(answer({0x41, 0x08, 0x10, 0, 12, 0, 0, 0})));
  EXPECT_FALSE(client.receive(answer({0x41, 0x08, 0x10, 0, 9, 0, 0, 0})));
  EXPECT_TRUE(client.busy());
  ASSERT_TRUE(client.receive(answer({0x00, 'f', 'o', 'r', 'c', 'e', 'a', 'x'})));
  EXPECT_FALSE(client.receive(answer({0x1B, 'i', 's', 0, 0, 0, 0, 0})));
  const SdoResult result = client.take_result();
  EXPECT_TRUE(result.ok());
  EXPECT_EQ(result.data, bytes_of("forceaxis"));
  // After a segment, an upload that begins anew is an error.
  client.upload(0x1008, 0);
  client.receive(answer({0x41, 0x08, 0x10, 0, 9, 0, 0, 0}));
  client.receive(answer({0x00, 'f', 'o', 'r', 'c', 'e', 'a', 'x'}));
  const auto last = client.receive(answer({0x41, 0x08, 0x10, 0, 9, 0, 0, 0}));
  ASSERT_TRUE(last);
  EXPECT_EQ(last->data[0], 0x80);
}

TEST(SdoClient, ExpeditedDownload) {
  SdoClient client(0x601);
  const std::vector<std::uint8_t> value{0x0F, 0x00};
  EXPECT_EQ(client.download(0x6040, 0, value).data, (Bytes{0x2B, 0x40, 0x60, 0, 0x0F, 0, 0, 0}));
  EXPECT_FALSE(client.receive(answer({0x60, 0x40, 0x60, 0, 0, 0, 0, 0})));
  EXPECT_TRUE(client.take_result().ok());
}

TEST(SdoClient, SegmentedDownload) {
  SdoClient client(0x601);
  EXPECT_EQ(client.download(0x2000, 1, bytes_of("forceaxis")).data,
            (Bytes{0x21, 0x00, 0x20, 1, 9, 0, 0, 0}));
  auto next = client.receive(answer({0x60, 0x00, 0x20, 1, 0, 0, 0, 0}));
  ASSERT_TRUE(next);
  EXPECT_EQ(next->data, (Bytes{0x00, 'f', 'o', 'r', 'c', 'e', 'a', 'x'}));
  next = client.receive(answer({0x20, 0, 0, 0, 0, 0, 0, 0}));
  ASSERT_TRUE(next);
  EXPECT_EQ(next->data, (Bytes{0x1B, 'i', 's', 0, 0, 0, 0, 0}));
  EXPECT_FALSE(client.receive(answer({0x30, 0, 0, 0, 0, 0, 0, 0})));
  EXPECT_FALSE(client.busy());
  EXPECT_TRUE(client.take_result().ok());
}

TEST(SdoClient, AbortOfTheServerEndsTheTransfer) {
  SdoClient client(0x601);
  client.upload(0x5000, 0);
  EXPECT_FALSE(client.receive(answer({0x80, 0x00, 0x50, 0, 0x00, 0x00, 0x02, 0x06})));
  const SdoResult result = client.take_result();
  EXPECT_EQ(result.abort, 0x06020000U);
  EXPECT_FALSE(result.silent);
  EXPECT_EQ(forceaxis::canopen::abort_text(result.abort), "no such object (abort 06020000h)");
}

TEST(SdoClient, WhatDoesNotBelongToTheTransferChangesNothing) {
  SdoClient client(0x601);
  client.upload(0x6041, 0);
  // Another index, a cut frame, the answer to a download, an abort of another transfer.
  EXPECT_FALSE(client.receive(answer({0x4B, 0x64, 0x60, 0, 1, 0, 0, 0})));
  EXPECT_FALSE(client.receive({0x581, 7, {0x4B, 0x41, 0x60, 0, 1, 0, 0, 0}}));
  EXPECT_FALSE(client.receive(answer({0x60, 0x41, 0x60, 0, 0, 0, 0, 0})));
  EXPECT_FALSE(client.receive(answer({0x80, 0x64, 0x60, 0, 0, 0, 2, 6})));
  EXPECT_TRUE(client.busy());
  client.receive(answer({0x4B, 0x41, 0x60, 0, 0x50, 0x02, 0, 0}));
  EXPECT_EQ(client.take_result().data, (std::vector<std::uint8_t>{0x50, 0x02}));
}

TEST(SdoClient, SilenceIsAnAbortOfItsOwn) {
  SdoClient client(0x601);
  client.upload(0x6041, 0);
  EXPECT_EQ(client.time_out().data, (Bytes{0x80, 0x41, 0x60, 0, 0, 0, 0x04, 0x05}));
  const SdoResult result = client.take_result();
  EXPECT_TRUE(result.silent);
  EXPECT_EQ(result.abort, 0x05040000U);
  // What comes too late is not taken for the next answer.
  client.upload(0x6064, 0);
  client.receive(answer({0x4B, 0x41, 0x60, 0, 1, 0, 0, 0}));
  EXPECT_TRUE(client.busy());
}

}  // namespace
