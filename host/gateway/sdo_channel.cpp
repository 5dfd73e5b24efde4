#include "host/gateway/sdo_channel.hpp"

namespace forceaxis::nodes {

Task<canopen::SdoResult> SdoChannel::upload(std::uint16_t index, std::uint8_t sub) {
  return transfer(index, sub, true, {});
}

Task<canopen::SdoResult> SdoChannel::download(std::uint16_t index, std::uint8_t sub,
                                              const std::vector<std::uint8_t> &data) {
  return transfer(index, sub, false, data);
}

Task<canopen::SdoResult> SdoChannel::transfer(std::uint16_t index, std::uint8_t sub, bool is_upload,
                                              std::vector<std::uint8_t> data) {
  Completion<canopen::SdoResult> done(loop_);
  waiting_.push_back({index, sub, is_upload, std::move(data), &done, is_upload ? kReadTries : 1});
  if (waiting_.size() == 1) begin_next();
  canopen::SdoResult result = co_await done;
  co_return result;
}

void SdoChannel::begin_next() {
  if (waiting_.empty()) return;
  Waiting &next = waiting_.front();
  --next.tries;
  send_(next.is_upload ? client_.upload(next.index, next.sub)
                       : client_.download(next.index, next.sub, next.data));
  expect_answer();
}

void SdoChannel::expect_answer() {
  loop_.cancel(timer_);
  const auto wait = waiting_.front().is_upload ? timeout_ / kReadTries : timeout_;
  timer_ = loop_.at(EventLoop::Clock::now() + wait, [this] {
    send_(client_.time_out());
    if (waiting_.front().tries == 0) return end();
    client_.take_result();
    begin_next();
  });
}

void SdoChannel::receive(const canopen::Frame &answer) {
  if (!client_.busy()) return;
  const auto next = client_.receive(answer);
  if (next) send_(*next);
  if (!client_.busy()) {
    end();
  } else if (next) {
    expect_answer();
  }
}

void SdoChannel::end() {
  loop_.cancel(timer_);
  Completion<canopen::SdoResult> &done = *waiting_.front().done;
  waiting_.pop_front();
  done.set(client_.take_result());
  begin_next();
}

}  // namespace forceaxis::nodes
