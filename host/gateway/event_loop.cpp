#include "host/gateway/event_loop.hpp"

#include <algorithm>
#include <vector>

namespace forceaxis::nodes {

struct EventLoop::Detached {
  struct promise_type {
    Detached get_return_object() {
      return {std::coroutine_handle<promise_type>::from_promise(*this)};
    }
    std::suspend_always initial_suspend() noexcept { return {}; }
    std::suspend_never final_suspend() noexcept { return {}; }
    void return_void() {}
    void unhandled_exception() { std::terminate(); }
  };
  std::coroutine_handle<promise_type> handle;
};

namespace {

// An awaitable object that returns the handle of the awaiting coroutine without suspending this
// coroutine.
struct OwnHandle {
  void *address = nullptr;
  bool await_ready() const { return false; }
  bool await_suspend(std::coroutine_handle<> self) {
    address = self.address();
    return false;
  }
  void *await_resume() const { return address; }
};

}  // namespace

EventLoop::Detached EventLoop::drive(Task<void> task) {
  void *const self = co_await OwnHandle{};
  try {
    co_await task;
  } catch (...) {
    if (!error_) error_ = std::current_exception();
  }
  detached_.erase(self);
}

void EventLoop::spawn(Task<void> task) {
  const auto handle = drive(std::move(task)).handle;
  detached_.insert(handle.address());
  post([handle] { handle.resume(); });
}

void EventLoop::abandon() {
  // Timers and posted calls are deleted, because they contain handles of the coroutines that are
  // destroyed here.
  timers_.clear();
  timer_times_.clear();
  posted_.clear();
  while (!detached_.empty()) {
    void *const address = *detached_.begin();
    detached_.erase(detached_.begin());
    std::coroutine_handle<>::from_address(address).destroy();
  }
}

void EventLoop::watch(int fd, std::function<short()> events, std::function<void(short)> ready) {
  watched_[fd] = {std::move(events), std::move(ready)};
}

std::uint64_t EventLoop::at(Time time, Call call) {
  const std::uint64_t timer = ++last_timer_;
  timers_.emplace(std::pair(time, timer), std::move(call));
  timer_times_.emplace(timer, time);
  return timer;
}

void EventLoop::cancel(std::uint64_t timer) {
  const auto found = timer_times_.find(timer);
  if (found == timer_times_.end()) return;
  timers_.erase({found->second, timer});
  timer_times_.erase(found);
}

void EventLoop::run_posted() {
  // Calls that are posted during this loop are also executed, before run() waits for file
  // descriptors.
  while (!posted_.empty() && !stopped_ && !error_) {
    const Call call = std::move(posted_.front());
    posted_.pop_front();
    call();
  }
}

void EventLoop::run_timers() {
  const Time now = Clock::now();
  while (!timers_.empty() && timers_.begin()->first.first <= now && !stopped_ && !error_) {
    const auto first = timers_.begin();
    const Call call = std::move(first->second);
    timer_times_.erase(first->first.second);
    timers_.erase(first);
    call();
    run_posted();
  }
}

int EventLoop::milliseconds_left() const {
  if (timers_.empty()) return -1;
  const auto left =
      std::chrono::ceil<std::chrono::milliseconds>(timers_.begin()->first.first - Clock::now());
  return static_cast<int>(std::clamp<std::int64_t>(left.count(), 0, 60000));
}

void EventLoop::run() {
  stopped_ = false;
  std::vector<pollfd> fds;
  while (!stopped_ && !error_) {
    run_posted();
    run_timers();
    if (stopped_ || error_) break;
    fds.clear();
    for (const auto &[fd, watched] : watched_) fds.push_back({fd, watched.events(), 0});
    if (::poll(fds.data(), fds.size(), milliseconds_left()) <= 0) continue;
    for (const pollfd &found : fds) {
      // `ready` of one file descriptor can call unwatch() for another file descriptor.
      const auto watched = watched_.find(found.fd);
      if (found.revents == 0 || watched == watched_.end()) continue;
      const auto ready = watched->second.ready;
      ready(found.revents);
      run_posted();
      if (stopped_ || error_) break;
    }
  }
  if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
}

}  // namespace forceaxis::nodes
