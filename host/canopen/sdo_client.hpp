#pragma once
// The client of the SDO channel of one node (CiA 301, 7.2.4). The client makes expedited and
// segmented transfers, one at a time. The client does not access the bus or a clock. The caller
// must send the requests that the functions return, pass the responses to receive(), and call
// time_out() if the server does not respond in time.
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "host/canopen/frame.hpp"

namespace forceaxis::canopen {

// SDO abort codes that this client sends. All other abort codes come from the server.
constexpr std::uint32_t kAbortToggle = 0x05030000, kAbortTimeout = 0x05040000,
                        kAbortCommand = 0x05040001, kAbortLength = 0x06070010;
// Abort codes of SDO servers for which callers have a special reaction.
constexpr std::uint32_t kAbortLocked = 0x08000021, kAbortState = 0x08000022;

// Returns the meaning of an SDO abort code, such as "value too high".
std::string abort_text(std::uint32_t abort);

struct SdoResult {
  std::uint32_t abort = 0;         // SDO abort code of the transfer; 0: no error
  bool silent = false;             // true: the server sent no response; `abort` is then
                                   // kAbortTimeout
  std::vector<std::uint8_t> data;  // data of an upload

  bool ok() const { return abort == 0; }
};

class SdoClient {
 public:
  // `request_id` is the CAN identifier of the requests, 600h + node id for the default channel.
  explicit SdoClient(std::uint32_t request_id) : request_id_(request_id) {}

  // Start a transfer and return the first request. busy() must be false. `data` is little-endian.
  Frame upload(std::uint16_t index, std::uint8_t sub);
  Frame download(std::uint16_t index, std::uint8_t sub, std::span<const std::uint8_t> data);

  // Processes a response of the server. Returns the next frame that the caller must send, or
  // nothing. A response that does not belong to the transfer, such as a late response, has no
  // effect.
  std::optional<Frame> receive(const Frame &answer);

  // Ends a transfer because no response has arrived. Returns the abort frame that the caller must
  // send.
  Frame time_out();

  bool busy() const { return state_ != State::idle; }
  // Returns the result of the transfer that has ended. To be called once.
  SdoResult take_result() { return std::exchange(result_, {}); }

 private:
  enum class State { idle, upload, upload_segment, download, download_segment };

  Frame request(std::uint8_t command) const;
  Frame addressed(std::uint8_t command) const;
  Frame next_segment();
  Frame abort(std::uint32_t code);
  std::optional<Frame> begin_upload(const Frame &answer);
  std::optional<Frame> second_answer(const Frame &answer);
  bool has_address(const Frame &answer) const;  // returns true if the answer has the index and
                                                // sub-index of the request
  static std::optional<std::uint32_t> announced_size(const Frame &answer);
  std::optional<Frame> upload_segment(const Frame &answer);

  std::uint32_t request_id_;
  State state_ = State::idle;
  std::uint16_t index_ = 0;
  std::uint8_t sub_ = 0;
  bool toggle_ = false;
  // Length of the upload in bytes, if the server has announced this length.
  std::optional<std::uint32_t> size_;
  std::vector<std::uint8_t> data_;  // SDO upload: data received until now; SDO download: all data
  std::size_t sent_ = 0;
  SdoResult result_;
};

}  // namespace forceaxis::canopen
