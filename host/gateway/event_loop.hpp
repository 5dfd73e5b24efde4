#pragma once
// A loop in one thread that waits for events of file descriptors and for times, and runs
// coroutines.
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

  // Waits for events of a file descriptor from now on. `events` is called before each poll() and
  // returns the events of interest. `ready` is called with the events that poll() has reported.
  void watch(int fd, std::function<short()> events, std::function<void(short)> ready);
  void unwatch(int fd) { watched_.erase(fd); }

  // Calls `call` once, at the given time or later. Returns a number with which cancel() can cancel
  // the call.
  std::uint64_t at(Time time, Call call);
  void cancel(std::uint64_t timer);

  // Calls `call` before the loop waits again. All posted calls run in the order of post().
  void post(Call call) { posted_.push_back(std::move(call)); }

  // Runs the loop until stop() is called. Throws the exception that a spawned coroutine has thrown.
  void run();
  void stop() { stopped_ = true; }
  bool running() const { return !stopped_; }

  // Starts a coroutine that no other coroutine awaits. The loop owns the coroutine until the
  // coroutine ends or abandon() is called.
  void spawn(Task<void> task);
  // Destroys all spawned coroutines. All objects to which these coroutines refer must still exist.
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

// A value that one function sets and that one coroutine awaits. Any function may set the
// value. The coroutine then continues in the next cycle of the loop.
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

// A queue to which several coroutines or functions add values. One coroutine removes the values in
// the same order.
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

  // Functions for `co_await mailbox`. Only one coroutine at a time may await the mailbox.
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
