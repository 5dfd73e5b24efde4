#pragma once
// An SDO client that several coroutines share. Transfers run one after the other. Each transfer
// ends with an answer or after a timeout.
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <vector>

#include "host/canopen/sdo_client.hpp"
#include "host/gateway/event_loop.hpp"

namespace forceaxis::nodes {

class SdoChannel {
 public:
  using Send = std::function<void(const canopen::Frame &)>;

  // `request_id` is the CAN identifier of the requests, `answer_id` the CAN identifier of the
  // answers.
  SdoChannel(EventLoop &loop, Send send, std::uint32_t request_id, std::uint32_t answer_id,
             std::chrono::milliseconds timeout)
      : loop_(loop),
        send_(std::move(send)),
        client_(request_id),
        answer_id_(answer_id),
        timeout_(timeout) {}

  std::uint32_t answer_id() const { return answer_id_; }
  void receive(const canopen::Frame &answer);

  Task<canopen::SdoResult> upload(std::uint16_t index, std::uint8_t sub);
  Task<canopen::SdoResult> download(std::uint16_t index, std::uint8_t sub,
                                    const std::vector<std::uint8_t> &data);

 private:
  struct Waiting {
    std::uint16_t index;
    std::uint8_t sub;
    bool is_upload;
    std::vector<std::uint8_t> data;
    Completion<canopen::SdoResult> *done;
    int tries;  // number of further times that the request may be sent
  };
  // A read changes nothing, so a read is sent again if a frame may have been lost. A write is not
  // sent again.
  static constexpr int kReadTries = 2;

  Task<canopen::SdoResult> transfer(std::uint16_t index, std::uint8_t sub, bool is_upload,
                                    std::vector<std::uint8_t> data);
  void begin_next();
  void expect_answer();
  void end();

  EventLoop &loop_;
  Send send_;
  canopen::SdoClient client_;
  std::uint32_t answer_id_;
  std::chrono::milliseconds timeout_;
  std::deque<Waiting> waiting_;  // queue of transfers; the first transfer is in progress
  std::uint64_t timer_ = 0;
};

}  // namespace forceaxis::nodes
