#include "host/link/exchange.hpp"

#include <algorithm>

namespace forceaxis::host {
namespace {

using std::chrono::milliseconds;

// Time after which the plant repeats a message for the first time: several round-trip times on an
// idle machine. The time doubles with every repetition, to limit the load of a busy machine.
constexpr milliseconds kFirstRepeat{3};
constexpr milliseconds kLongestRepeat{100};

// After this number of received messages without effect, the plant reads the clock.
constexpr unsigned kUselessWithoutClock = 16;

// The firmware reads the clock after a call without a message, and after every kCallsPerClock
// calls.
constexpr unsigned kCallsPerClock = 512;

std::string seconds_text(milliseconds time) {
  std::string text = std::to_string(static_cast<double>(time.count()) / 1000);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text + " s";
}

unsigned bit(std::uint8_t axis) { return 1U << (axis - 1); }

}  // namespace

std::string axes_text(unsigned axes) {
  std::string text;
  for (int i = 0; i < kMostAxes; ++i) {
    if ((axes >> i & 1U) != 0) text += (text.empty() ? "" : ", ") + std::to_string(i + 1);
  }
  return (text.size() > 1 ? "axes " : "axis ") + text;
}

// Receives messages. Bit i of the result is set if a message answers inputs[i].
unsigned PlantExchange::take(std::span<const LinkInputs> inputs, std::span<LinkOutputs> outputs,
                             milliseconds wait) {
  std::array<LinkOutputs, 2 * kMostAxes> came;
  const std::uint64_t foreign = transport_.foreign();
  const std::size_t n = transport_.receive(came, wait);
  idle_ = n == 0 && transport_.foreign() == foreign;
  unsigned answered = 0;
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t i = 0; i < inputs.size(); ++i) {
      if (came[k].axis != inputs[i].axis) continue;
      ++statistics_.received;
      if (came[k].tick == inputs[i].tick && (answered >> i & 1U) == 0) {
        outputs[i] = came[k];
        answered |= 1U << i;
      } else {
        ++statistics_.duplicates;
      }
    }
  }
  return answered;
}

void PlantExchange::exchange(std::span<const LinkInputs> inputs, std::span<LinkOutputs> outputs) {
  transport_.send(inputs);
  statistics_.sent += inputs.size();
  unsigned missing = (1U << inputs.size()) - 1;
  // Usually all answers arrive during the first wait, sometimes with a late answer of the previous
  // tick. In this case the clock need not be read.
  for (unsigned useless = 0; missing != 0;) {
    const unsigned answered = take(inputs, outputs, kFirstRepeat) & missing;
    missing &= ~answered;
    if (answered == 0 && (idle_ || ++useless == kUselessWithoutClock)) {
      wait_on(inputs, outputs, missing);
      break;
    }
  }
  for (const LinkInputs &in : inputs) answered_ |= bit(in.axis);
}

// Repeats the inputs whose answers are late until the answers arrive or the timeout has expired.
void PlantExchange::wait_on(std::span<const LinkInputs> inputs, std::span<LinkOutputs> outputs,
                            unsigned missing) {
  using Clock = std::chrono::steady_clock;
  Clock::time_point start = Clock::now();
  Clock::time_point repeat_at = start;
  milliseconds interval = kFirstRepeat;
  while (missing != 0) {
    const Clock::time_point now = Clock::now();
    unsigned quiet = 0;
    milliseconds allowed{0};
    for (std::size_t i = 0; i < inputs.size(); ++i) {
      if ((missing >> i & 1U) == 0) continue;
      const unsigned axis = bit(inputs[i].axis);
      const milliseconds limit = (answered_ & axis) != 0 ? timeouts_.running : timeouts_.start;
      if (now - start >= limit) {
        quiet |= axis;
        allowed = std::max(allowed, limit);
      }
    }
    if (quiet != 0 && (answered_ & quiet) == quiet && silent && silent(quiet)) {
      start = Clock::now();
    } else if (quiet != 0) {
      throw LinkSilent("axis_node (" + axes_text(quiet) + ") silent for " + seconds_text(allowed) +
                       " at tick " + std::to_string(inputs[0].tick) +
                       ((answered_ & quiet) != 0
                            ? ": axis_node has ended, does not respond or runs a shorter experiment"
                            : ": axis_node never answered; run axis_node on "
                              "this link and with this run id"));
    }
    if (late) late();
    if (now >= repeat_at) {
      for (std::size_t i = 0; i < inputs.size(); ++i) {
        if ((missing >> i & 1U) == 0) continue;
        transport_.send(inputs.subspan(i, 1));
        ++statistics_.sent;
        ++statistics_.repeated;
      }
      repeat_at = now + interval;
      interval = std::min(2 * interval, kLongestRepeat);
    }
    const auto left = std::chrono::ceil<milliseconds>(repeat_at - now);
    missing &= ~take(inputs, outputs, std::max(left, milliseconds{1}));
  }
}

LinkStatistics PlantExchange::statistics() const {
  LinkStatistics s = statistics_;
  s.foreign = transport_.foreign();
  return s;
}

AxisExchange::AxisExchange(AxisTransport &transport, const LinkTimeouts &timeouts,
                           std::span<const std::uint8_t> axes,
                           std::span<const std::int64_t> last_ticks, Compute compute)
    : transport_(transport),
      timeouts_(timeouts),
      compute_(std::move(compute)),
      received_(Clock::now()) {
  for (std::size_t i = 0; i < axes.size(); ++i) {
    Axis &axis = axes_[axes[i] - 1U];
    axis.hosted = true;
    axis.last_tick = last_ticks[i];
    axis.received = received_;
    axis.answer.tick = -1;
    running_ |= bit(axes[i]);
  }
}

unsigned AxisExchange::serve(milliseconds wait) {
  std::array<LinkInputs, 2 * kMostAxes> came;
  std::array<LinkOutputs, 2 * kMostAxes> answers;
  std::size_t count = 0;
  const std::size_t n = transport_.receive(came, wait);
  for (std::size_t k = 0; k < n; ++k) {
    const LinkInputs &in = came[k];
    Axis &axis = axes_[in.axis - 1U];
    if (!axis.hosted) continue;
    ++statistics_.received;
    axis.fresh = true;
    if (in.tick == axis.answer.tick + 1 && (running_ & bit(in.axis)) != 0) {
      axis.answer = compute_(in);
      if (in.tick == axis.last_tick) running_ &= ~bit(in.axis);
    } else {
      ++statistics_.duplicates;
      if (in.tick != axis.answer.tick) continue;
      ++statistics_.repeated;
    }
    answers[count++] = axis.answer;
  }
  if (count > 0) {
    transport_.send({answers.data(), count});
    statistics_.sent += count;
  }
  if (n > 0 && ++calls_ % kCallsPerClock != 0) return 0;
  return supervise();
}

unsigned AxisExchange::supervise() {
  const Clock::time_point now = Clock::now();
  unsigned silent = 0;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    Axis &axis = axes_[i];
    if (!axis.hosted) continue;
    if (axis.fresh) received_ = axis.received = now;
    axis.fresh = false;
    const milliseconds limit = axis.answer.tick >= 0 ? timeouts_.running : timeouts_.start;
    if ((running_ >> i & 1U) != 0 && now - axis.received >= limit) silent |= 1U << i;
  }
  running_ &= ~silent;
  return silent;
}

void AxisExchange::resume(unsigned axes) {
  running_ |= axes;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    if ((axes >> i & 1U) != 0) axes_[i].received = Clock::now();
  }
}

milliseconds AxisExchange::quiet() const {
  return std::chrono::duration_cast<milliseconds>(Clock::now() - received_);
}

LinkStatistics AxisExchange::statistics() const {
  LinkStatistics s = statistics_;
  s.foreign = transport_.foreign();
  return s;
}

}  // namespace forceaxis::host
