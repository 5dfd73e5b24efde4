#include "host/canopen/sdo_client.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <string_view>

namespace forceaxis::canopen {
namespace {

// SDO command specifiers in bits 5 to 7 of the first byte (CiA 301, 7.2.4.3).
constexpr unsigned kDownloadSegment = 0, kDownloadBegin = 1, kUploadBegin = 2, kUploadSegment = 3,
                   kAbort = 4;
constexpr unsigned kAnswerUploadSegment = 0, kAnswerDownloadSegment = 1, kAnswerUpload = 2,
                   kAnswerDownload = 3;
constexpr unsigned kSized = 1, kExpedited = 2, kLast = 1, kToggle = 16;
constexpr std::size_t kSegment = 7;

std::uint32_t load_u32(const std::uint8_t *from) {
  return from[0] | static_cast<std::uint32_t>(from[1]) << 8 |
         static_cast<std::uint32_t>(from[2]) << 16 | static_cast<std::uint32_t>(from[3]) << 24;
}

void store_u32(std::uint32_t value, std::uint8_t *to) {
  for (int i = 0; i < 4; ++i) to[i] = static_cast<std::uint8_t>(value >> (8 * i));
}

struct AbortText {
  std::uint32_t code;
  std::string_view text;
};

constexpr std::array<AbortText, 26> kTexts{{
    {0x05030000, "toggle bit did not alternate"},
    {0x05040000, "no answer in time"},
    {0x05040001, "unknown SDO command"},
    {0x06010000, "access not supported"},
    {0x06010001, "write-only"},
    {0x06010002, "read-only"},
    {0x06020000, "no such object"},
    {0x06040041, "cannot be mapped into this PDO"},
    {0x06040042, "the mapped objects are longer than a PDO"},
    {0x06040043, "parameters contradict each other"},
    {0x06040047, "internal incompatibility"},
    {0x06060000, "no memory for parameters"},
    {0x06070010, "wrong length of the value"},
    {0x06070012, "too long"},
    {0x06070013, "too short"},
    {0x06090011, "no such sub-index"},
    {0x06090030, "value not valid"},
    {0x06090031, "value too high"},
    {0x06090032, "value too low"},
    {0x06090036, "maximum below minimum"},
    {0x08000000, "general error"},
    {0x08000020, "not stored: expected the text \"save\" or \"load\""},
    {0x08000021, "another source owns the axis"},
    {0x08000022, "not in this state"},
    {0x08000023, "no object dictionary"},
    {0x08000024, "no data"},
}};

}  // namespace

std::string abort_text(std::uint32_t abort) {
  char code[16];
  std::snprintf(code, sizeof code, "%08Xh", abort);
  const auto *const found = std::ranges::find(kTexts, abort, &AbortText::code);
  const std::string text = found == kTexts.end() ? "refused" : std::string(found->text);
  return text + " (abort " + code + ")";
}

Frame SdoClient::request(std::uint8_t command) const { return {request_id_, 8, {command}}; }

Frame SdoClient::addressed(std::uint8_t command) const {
  Frame frame = request(command);
  frame.data[1] = static_cast<std::uint8_t>(index_);
  frame.data[2] = static_cast<std::uint8_t>(index_ >> 8);
  frame.data[3] = sub_;
  return frame;
}

Frame SdoClient::upload(std::uint16_t index, std::uint8_t sub) {
  state_ = State::upload;
  index_ = index;
  sub_ = sub;
  toggle_ = false;
  size_.reset();
  data_.clear();
  result_ = {};
  return addressed(kUploadBegin << 5);
}

Frame SdoClient::download(std::uint16_t index, std::uint8_t sub,
                          std::span<const std::uint8_t> data) {
  state_ = State::download;
  index_ = index;
  sub_ = sub;
  toggle_ = false;
  data_.assign(data.begin(), data.end());
  sent_ = 0;
  result_ = {};
  const auto size = static_cast<unsigned>(data.size());
  if (size >= 1 && size <= 4) {
    Frame frame = addressed(
        static_cast<std::uint8_t>(kDownloadBegin << 5 | (4 - size) << 2 | kExpedited | kSized));
    std::ranges::copy(data, frame.data.begin() + 4);
    sent_ = size;
    return frame;
  }
  Frame frame = addressed(kDownloadBegin << 5 | kSized);
  store_u32(size, &frame.data[4]);
  return frame;
}

Frame SdoClient::next_segment() {
  const std::size_t count = std::min(kSegment, data_.size() - sent_);
  const bool last = sent_ + count == data_.size();
  Frame frame = request(static_cast<std::uint8_t>(kDownloadSegment << 5 | (toggle_ ? kToggle : 0) |
                                                  (kSegment - count) << 1 | (last ? kLast : 0)));
  std::copy_n(data_.begin() + static_cast<std::ptrdiff_t>(sent_), count, frame.data.begin() + 1);
  sent_ += count;
  state_ = State::download_segment;
  return frame;
}

Frame SdoClient::abort(std::uint32_t code) {
  state_ = State::idle;
  result_ = {code, false, {}};
  Frame frame = addressed(kAbort << 5);
  store_u32(code, &frame.data[4]);
  return frame;
}

Frame SdoClient::time_out() {
  const Frame frame = abort(kAbortTimeout);
  result_.silent = true;
  return frame;
}

std::optional<std::uint32_t> SdoClient::announced_size(const Frame &answer) {
  if ((answer.data[0] & kSized) == 0) return std::nullopt;
  return load_u32(&answer.data[4]);
}

std::optional<Frame> SdoClient::begin_upload(const Frame &answer) {
  const unsigned command = answer.data[0];
  if ((command & kExpedited) != 0) {
    const std::size_t count = (command & kSized) != 0 ? 4 - (command >> 2 & 3) : 4;
    result_.data.assign(answer.data.begin() + 4,
                        answer.data.begin() + 4 + static_cast<std::ptrdiff_t>(count));
    state_ = State::idle;
    return std::nullopt;
  }
  size_ = announced_size(answer);
  state_ = State::upload_segment;
  return request(kUploadSegment << 5);
}

// Processes the second answer to a request. A request is answered twice if it was repeated because
// its first answer was late. With the second answer, the server has begun the upload again, before
// it has received the request for the first segment.
std::optional<Frame> SdoClient::second_answer(const Frame &answer) {
  if (!data_.empty()) return abort(kAbortCommand);
  size_ = announced_size(answer);
  return std::nullopt;
}

std::optional<Frame> SdoClient::upload_segment(const Frame &answer) {
  const unsigned command = answer.data[0];
  if (command >> 5 != kAnswerUploadSegment) return abort(kAbortCommand);
  if (((command & kToggle) != 0) != toggle_) return abort(kAbortToggle);
  const std::size_t count = kSegment - (command >> 1 & 7);
  data_.insert(data_.end(), answer.data.begin() + 1,
               answer.data.begin() + 1 + static_cast<std::ptrdiff_t>(count));
  if ((command & kLast) == 0) {
    toggle_ = !toggle_;
    return request(static_cast<std::uint8_t>(kUploadSegment << 5 | (toggle_ ? kToggle : 0)));
  }
  // If the length of the data differs from the announced length, segments were lost.
  if (size_ && *size_ != data_.size()) return abort(kAbortLength);
  result_.data = std::move(data_);
  data_.clear();
  state_ = State::idle;
  return std::nullopt;
}

bool SdoClient::has_address(const Frame &answer) const {
  return answer.data[1] == (index_ & 0xFF) && answer.data[2] == index_ >> 8 &&
         answer.data[3] == sub_;
}

std::optional<Frame> SdoClient::receive(const Frame &answer) {
  if (!busy() || answer.length != 8) return std::nullopt;
  const unsigned specifier = answer.data[0] >> 5;
  const bool ours = has_address(answer);
  if (specifier == kAbort) {
    if (!ours) return std::nullopt;
    result_ = {load_u32(&answer.data[4]), false, {}};
    if (result_.abort == 0) result_.abort = 0x08000000;
    state_ = State::idle;
    return std::nullopt;
  }
  switch (state_) {
    case State::upload:
      if (specifier != kAnswerUpload || !ours) return std::nullopt;
      return begin_upload(answer);
    case State::upload_segment:
      return specifier == kAnswerUpload && ours ? second_answer(answer) : upload_segment(answer);
    case State::download:
      if (specifier != kAnswerDownload || !ours) return std::nullopt;
      break;
    default:
      if (specifier != kAnswerDownloadSegment) return abort(kAbortCommand);
      if (((answer.data[0] & kToggle) != 0) != toggle_) return abort(kAbortToggle);
      toggle_ = !toggle_;
      break;
  }
  // At this point, the server has accepted all data that was sent.
  if (sent_ < data_.size() || (data_.empty() && state_ == State::download)) return next_segment();
  state_ = State::idle;
  return std::nullopt;
}

}  // namespace forceaxis::canopen
