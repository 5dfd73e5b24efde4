#pragma once
// One thread that waits for file descriptors and times, and runs coroutines between them.
#include <poll.h>

#include <chrono>
#include <coroutine>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "host/gateway/task.hpp"

namespace forceaxis::nodes {

class EventLoop {
 public:
  using Clock = std::chrono::steady_clock;
  using Time = Clock::time_point;
  using Call = std::function<void()>;

  EventLoop() = default;
  EventLoop(const EventLoop &) = delete;
  EventLoop &operator=(const EventLoop &) = delete;
  ~EventLoop() { abandon(); }

  // `ready` is called with what poll() found. `events` is asked before each wait.
  void watch(int fd, std::function<short()> events, std::function<void(short)> ready);
  void unwatch(int fd) { watched_.erase(fd); }

  // Calls once, at or after a time. The number cancels it.
  std::uint64_t at(Time time, Call call);
  void cancel(std::uint64_t timer);

  // Calls before the next wait, in the order of posting.
  void post(Call call) { posted_.push_back(std::move(call)); }

  // Until stop(). Throws what a spawned coroutine threw.
  void run();
  void stop() { stopped_ = true; }
  bool running() const { return !stopped_; }

  // Begins a coroutine that nobody awaits; the loop holds it until it ends or abandon() is called.
  void spawn(Task<void> task);
  // Destroys what is still under way. Nothing that it refers to may be gone before.
  void abandon();

  auto sleep(Clock::duration duration) {
    struct Awaiter {
      EventLoop &loop;
      Clock::duration duration;
      bool await_ready() const { return false; }
      void await_suspend(std::coroutine_handle<> waiting) {
        loop.at(Clock::now() + duration, [waiting] { waiting.resume(); });
      }
      void await_resume() const {}
    };
    return Awaiter{*this, duration};
  }

 private:
  struct Watched {
    std::function<short()> events;
    std::function<void(short)> ready;
  };
  struct Detached;

  Detached drive(Task<void> task);
  void run_posted();
  void run_timers();
  int milliseconds_left() const;

  std::map<int, Watched> watched_;
  std::map<std::pair<Time, std::uint64_t>, Call> timers_;
  std::map<std::uint64_t, Time> timer_times_;
  std::deque<Call> posted_;
  std::set<void *> detached_;
  std::exception_ptr error_;
  std::uint64_t last_timer_ = 0;
  bool stopped_ = false;
};

// One value that somebody else will set, and one coroutine that awaits it. Whoever sets it may do
// so at any time and in any call: the coroutine goes on from the loop.
template <class T>
class Completion {
 public:
  explicit Completion(EventLoop &loop) : loop_(loop) {}
  Completion(const Completion &) = delete;
  Completion &operator=(const Completion &) = delete;

  void set(T value) {
    value_ = std::move(value);
    if (waiting_) loop_.post([waiting = waiting_] { waiting.resume(); });
  }

  bool await_ready() const { return value_.has_value(); }
  void await_suspend(std::coroutine_handle<> waiting) { waiting_ = waiting; }
  T await_resume() { return std::move(*value_); }

 private:
  EventLoop &loop_;
  std::optional<T> value_;
  std::coroutine_handle<> waiting_;
};

// What several give and one coroutine takes, in order.
template <class T>
class Mailbox {
 public:
  explicit Mailbox(EventLoop &loop) : loop_(loop) {}
  Mailbox(const Mailbox &) = delete;
  Mailbox &operator=(const Mailbox &) = delete;

  void push(T item) {
    items_.push_back(std::move(item));
    if (waiting_) loop_.post([waiting = std::exchange(waiting_, {})] { waiting.resume(); });
  }
  std::size_t size() const { return items_.size(); }

  // `co_await mailbox`, by one coroutine at a time.
  bool await_ready() const { return !items_.empty(); }
  void await_suspend(std::coroutine_handle<> waiting) { waiting_ = waiting; }
  T await_resume() {
    T item = std::move(items_.front());
    items_.pop_front();
    return item;
  }

 private:
  EventLoop &loop_;
  std::deque<T> items_;
  std::coroutine_handle<> waiting_;
};

}  // namespace forceaxis::nodes
