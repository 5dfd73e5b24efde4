#include "sim/hybrid/stepper.hpp"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

#include "sim/hybrid/crossing.hpp"
#include "sim/hybrid/kernel.hpp"

namespace forceaxis::sim {
namespace {

using kernel::dot;
using kernel::magnitude;

constexpr double kRounding = 0x1p-46;  // bound on the relative rounding of a channel's value
constexpr int kMostChangesPerTick = 5000;
constexpr int kMostChangesPerInstant = 1000;  // in settle()
constexpr double kMoment = 0x1p-20;           // of a mode's reach
constexpr std::size_t kRecentModes = 64;
constexpr int kCalmTicks = 15;  // that the second test comes first; costs speed only
constexpr double kInfinity = std::numeric_limits<double>::infinity();

double smaller(double a, double b) { return a < b ? a : b; }

// 1 / k, rounded once.
struct Reciprocals {
  double value[64];
  constexpr Reciprocals() : value{} {
    for (int k = 1; k < 64; ++k) value[k] = 1.0 / k;
  }
};
constexpr Reciprocals kReciprocal;

}  // namespace

Stepper::Stepper(std::shared_ptr<ModeCache> cache, bool audit, std::size_t listed_events)
    : cache_(std::move(cache)),
      audit_(audit),
      listed_events_(listed_events),
      recent_(kRecentModes) {
  const Network &net = network();
  z_ = net.initial();
  z_.push_back(1.0);
  z_.push_back(0.0);
  absolute_.assign(z_.size(), 0.0);
  for (const Network::Switch &s : net.switches())
    count_stride_ = std::max(count_stride_, s.state_names.size());
  counts_.assign(net.switches().size() * count_stride_ * count_stride_, 0);
  supplied_.resize(net.supplies().size());
  dissipated_.resize(net.dampers().size());
  set_mode(net.home_key(false));
  check_finite();
  slide(false);
  settle(false);
  discarded_ = {};  // finding the first mode is no change of it
}

void Stepper::Sum::add(double term) {
  const double next = value + term;
  lost += magnitude(value) >= magnitude(term) ? (value - next) + term : (term - next) + value;
  value = next;
}

void Stepper::set_mode(ModeKey key) {
  Recent &slot = recent_[((key * 0x9E3779B97F4A7C15ULL) >> 58) % kRecentModes];
  if (slot.mode == nullptr || slot.key != key) {
    slot.mode = &cache_->mode(key);
    slot.audit = audit_ ? &cache_->audit(key) : nullptr;
    slot.key = key;
    const Mode &m = *slot.mode;
    const auto grow = [](auto &buffer, std::size_t size) {
      if (buffer.size() < size) buffer.resize(size);
    };
    grow(result_, m.tick_stride);
    grow(curve_, m.curve_stride);
    grow(calm_, m.calm_stride);
    grow(grid_signal_, m.grid_signal_stride);
    grow(grid_dip_, m.grid_dip_stride);
    grow(parts_in_doubt_, m.channels);
    grow(chain_, (m.order + 1) * m.flow_stride);
    grow(polynomial_, m.series_stride);
    grow(increment_, m.flow_stride);
    if (audit_) {
      grow(forms_, slot.audit->form_stride * m.columns);
      grow(integrals_, slot.audit->form_stride);
    }
  }
  mode_ = slot.mode;
  audit_mode_ = slot.audit;
}

void Stepper::check_finite() const {
  for (const double value : z_)
    if (!(magnitude(value) < 1e100))
      throw SimulationError("the plant's state left all bounds at t = " +
                            std::to_string(static_cast<double>(tick_) / cache_->rate_hz()) +
                            " s: the loop is unstable; lower the gain or check the model");
}

void Stepper::fail_switching(int switch_index, double s) const {
  throw SimulationError(
      network().switches()[static_cast<std::size_t>(switch_index)].element +
      " keeps switching without end at t = " +
      std::to_string((static_cast<double>(tick_) + s) / cache_->rate_hz()) +
      " s: its states contradict each other there; change this element or its neighbours");
}

void Stepper::switch_drive(double command, bool enable) {
  if (!enable)
    for (const int state : network().drive_states()) z_[static_cast<std::size_t>(state)] = 0.0;
  z_[mode_->states + 1] = command;
  set_mode(network().with_enable(mode_->key, enable));
  settle(false);
}

void Stepper::step(double command, bool enable) {
  const std::size_t n = mode_->states;
  if (Network::enabled(mode_->key) != enable) {
    switch_drive(command, enable);
  } else if (sensors_in_result_ && command_jumps_ahead(command - z_[n + 1])) {
    // Only spares the quiet test: it is settle() that decides, now or after the test.
    z_[n + 1] = command;
    settle(true);
  }
  z_[n + 1] = command;
  if (!quiet_tick()) {
    // The new command may have put signals beyond their bounds at once.
    sensors_in_result_ = false;
    const bool quiet = command_jumps() && (settle(true), quiet_tick());
    if (!quiet && cross_tick()) {
      ++tick_;
      return;
    }
  }
  if (audit_) audit_tick();
  const double *next = result_.data();
  for (std::size_t i = 0; i < n; ++i) z_[i] = next[i];
  sensors_in_result_ = true;
  ++tick_;
}

void Stepper::hold(double command, bool enable) {
  if (Network::enabled(mode_->key) != enable) {
    switch_drive(command, enable);
  } else {
    z_[mode_->states + 1] = command;
    settle(true);
  }
  sensors_in_result_ = false;
}

const double *Stepper::sensors() {
  if (sensors_in_result_) return result_.data() + mode_->states;
  multiply_(mode_->sensor.data(), kernel::padded(2), z_.data(), mode_->columns, sensors_);
  return sensors_;
}

// Tests the next tick, from any instant. True: no switch changes, result_ holds its end.
bool Stepper::quiet_tick() {
  const Mode &m = *mode_;
  if (m.samples == 0) return false;
  // Where the second test was the one that passed it comes first for a while.
  if (mode_ == calm_mode_ && calm_left_ > 0) {
    --calm_left_;
    multiply_(m.tick.data(), m.tick_stride, z_.data(), m.columns, result_.data());
    if (calm_tick()) return true;
    calm_left_ = 0;
  }
  return quiet_(m.quiet, z_.data(), result_.data(), curve_.data());
}

// The second test of Mode, on the signals that the first one has left in result_.
bool Stepper::calm_tick() {
  const Mode &m = *mode_;
  const double *signal = result_.data() + m.signal_place;
  const double *at = signal;
  for (std::size_t k = 0; k <= m.samples; ++k, at += m.channel_stride)
    for (std::size_t i = 0; i < m.channels; ++i)
      if (!(at[i] >= m.low[i] && at[i] <= m.high[i])) return false;
  double largest = 0.0;
  for (std::size_t j = 0; j < m.columns; ++j)
    if (const double size = magnitude(z_[j]); !(size <= largest)) largest = size;
  multiply_(m.calm_head.data(), m.calm_stride, z_.data(), m.columns, calm_.data());
  for (std::size_t j = 0; j < m.states; ++j) calm_[j] = magnitude(calm_[j]);
  multiply_(m.calm_tail.data(), m.curve_stride, calm_.data(), m.states, curve_.data());
  const double *bend = calm_.data() + kernel::padded(m.states);
  bool calm = true;
  for (std::size_t k = 0; k < m.samples; ++k) {
    const std::size_t row = k * m.channel_stride;
    const double *a = signal + row;
    const double *b = a + m.channel_stride;
    for (std::size_t i = 0; i < m.channels; ++i) {
      double &dip = curve_[row + i];
      dip += magnitude(bend[row + i]) + m.calm_doubt[row + i] * largest;
      calm &= kernel::inside(a[i], b[i], dip, m.low[i], m.high[i]);
    }
  }
  return calm;
}

// After a quiet tick: will this step of the command put a signal beyond its bound?
bool Stepper::command_jumps_ahead(double change) const {
  const Mode &m = *mode_;
  const double *at = result_.data() + m.signal_place + m.samples * m.channel_stride;
  for (const std::size_t i : m.fed) {
    const double value = at[i] + m.signal[(i + 1) * m.columns - 1] * change;
    if (!(value >= m.low[i] && value <= m.high[i])) return true;
  }
  return false;
}

// After quiet_tick(): is a signal beyond its bound at the start already?
bool Stepper::command_jumps() const {
  const Mode &m = *mode_;
  if (m.samples == 0) return true;
  const double *at = result_.data() + m.signal_place;
  for (std::size_t i = 0; i < m.channels; ++i)
    if (!(at[i] >= m.low[i] && at[i] <= m.high[i])) return true;
  return false;
}

// Moves every switch whose signal lies clearly beyond its bound, in dependency order, until none
// does. Signals on their bound (within rounding) stay: their next derivative decides, in examine().
void Stepper::settle(bool count_jumps) {
  int changes = 0;
  for (std::size_t i = 0; i < mode_->channels; ++i) {
    const Mode &m = *mode_;
    const Channel &channel = m.channel[i];
    const double value = dot(&m.signal[i * m.columns], z_.data(), m.columns);
    if (value >= m.low[i] && value <= m.high[i]) continue;
    const double *doubt = &m.doubt[i * (m.order + 1) * m.columns];
    double scale = 0.0;
    for (std::size_t j = 0; j < m.columns; ++j) scale += doubt[j] * magnitude(z_[j]);
    const bool below = value < channel.low - kRounding * (scale + magnitude(channel.low));
    const bool above = value > channel.high + kRounding * (scale + magnitude(channel.high));
    if (!below && !above) continue;
    if (++changes > kMostChangesPerInstant) fail_switching(channel.switch_index, 0.0);
    // The new state has channels of its own, from the switch's first place in the list on; those
    // before it belong to switches that do not depend on this one.
    const int moved = channel.switch_index;
    change(i, above, 0.0, true, count_jumps);
    while (i > 0 && mode_->channel[i - 1].switch_index >= moved) --i;
    --i;
  }
}

// Taylor coefficients of the state, time in ticks.
void Stepper::expand() {
  const Mode &m = *mode_;
  for (std::size_t i = 0; i < m.states; ++i) chain_[i] = z_[i];
  multiply_(m.taylor.data(), m.order * m.flow_stride, z_.data(), m.columns,
            chain_.data() + m.flow_stride);
}

// After expand(): to the state s ticks later, s <= reach.
void Stepper::evaluate(double s) {
  const Mode &m = *mode_;
  // s^k by way of s^(k/2): the products do not wait for each other.
  powers_[0] = s;
  for (std::size_t k = 2; k <= m.order; ++k)
    powers_[k - 1] = powers_[k / 2 - 1] * powers_[(k + 1) / 2 - 1];
  // The increment first, so that only the last addition rounds at the size of the state.
  multiply_(chain_.data() + m.flow_stride, m.flow_stride, powers_, m.order, increment_.data());
  for (std::size_t i = 0; i < m.states; ++i) z_[i] = chain_[i] + increment_[i];
}

// By series, at most `reach`.
void Stepper::advance_within_part(double ticks) {
  expand();
  if (audit_) audit_part(ticks);
  evaluate(ticks);
}

// Whole parts of the grid, and what is left by series.
void Stepper::advance(double ticks) {
  const Mode &m = *mode_;
  const auto parts = static_cast<std::size_t>(ticks / m.reach);
  if (parts > 0) {
    if (audit_) audit_grid(parts);
    multiply_(&m.grid_flow[(parts - 1) * m.flow_stride * m.columns], m.flow_stride, z_.data(),
              m.columns, increment_.data());
    for (std::size_t i = 0; i < m.states; ++i) z_[i] = increment_[i];
  }
  const double left = ticks - static_cast<double>(parts) * m.reach;
  if (left > 0.0) advance_within_part(left);
}

// polynomial_ = g >= 0 is to hold; finds where on [0, end] it ceases to.
Stepper::Verdict Stepper::examine_side(std::size_t channel, double bound, double end,
                                       double *root) {
  const Mode &m = *mode_;
  const std::size_t c = m.columns;
  const double *q = polynomial_.data();

  // A signal on its bound: the sign of its first Taylor coefficient that is not rounding decides,
  // and the rest is searched with the root at the start divided out. If none differs from rounding
  // then neither does the signal on this part. Rounding is that of the state in the balanced norm
  // (Mode::doubt): places known to 1e-18 m only make speeds of less than 1e-18 m times the fastest
  // rate mean nothing, or contacts that just touch would switch with the last bits of their places.
  const double *doubt = &m.doubt[channel * (m.order + 1) * c];
  for (std::size_t k = 0; k <= m.order; ++k, doubt += c) {
    double scale = k == 0 ? magnitude(bound) : 0.0;
    for (std::size_t j = 0; j < c; ++j) scale += doubt[j] * absolute_[j];
    if (!(magnitude(q[k]) > kRounding * scale)) continue;
    if (q[k] < 0.0) return Verdict::at_once;
    if (k == m.order) return Verdict::none;
    return first_crossing(q + k, m.order - k, end, root) ? Verdict::later : Verdict::none;
  }
  return Verdict::none;
}

Stepper::Verdict Stepper::examine(std::size_t channel, double end, double *root, bool *above) {
  const Mode &m = *mode_;
  const Channel &watched = m.channel[channel];
  double *q = polynomial_.data();
  multiply_(&m.series[channel * m.columns * m.series_stride], m.series_stride, z_.data(), m.columns,
            q);
  const double value = q[0];
  Verdict verdict = Verdict::none;
  if (watched.low > -kInfinity) {
    q[0] = value - watched.low;
    verdict = examine_side(channel, watched.low, end, root);
    *above = false;
    if (verdict == Verdict::at_once) return verdict;
    if (verdict == Verdict::later) end = *root;
  }
  if (watched.high < kInfinity) {
    q[0] = watched.high - value;
    for (std::size_t k = 1; k <= m.order; ++k) q[k] = -q[k];
    const Verdict upper = examine_side(channel, watched.high, end, root);
    if (upper != Verdict::none) {
      *above = true;
      verdict = upper;
    }
  }
  return verdict;
}

// After quiet_tick() has failed: the parts of the grid in which a signal may reach a bound.
std::uint64_t Stepper::parts_in_doubt(std::size_t channel, std::size_t wanted) {
  const Mode &m = *mode_;
  const std::size_t c = m.columns;
  const double low = m.low[channel];
  const double high = m.high[channel];
  const double *at = result_.data() + m.signal_place + channel;
  const double *dip = curve_.data() + channel;
  bool clear = m.samples > 0;
  for (std::size_t k = 0; k < m.samples; ++k, at += m.channel_stride, dip += m.channel_stride)
    clear &= kernel::inside(at[0], at[m.channel_stride], dip[0], low, high);
  if (clear) return 0;
  const kernel::GridTest test{&m.grid_signal[channel * c * m.grid_signal_stride],
                              &m.grid_dip[channel * c * m.grid_dip_stride],
                              m.grid,
                              c,
                              low,
                              high};
  const std::uint64_t doubt = grid_(test, z_.data(), grid_signal_.data(), grid_dip_.data());
  return doubt & (~std::uint64_t{0} >> (64 - wanted));
}

// The first change from here on to `end`, within part `part` of the grid, of the channels that are
// in doubt there.
bool Stepper::first_change(std::size_t part, double end, Change *found) {
  for (std::size_t j = 0; j < mode_->columns; ++j) absolute_[j] = magnitude(z_[j]);
  bool any = false;
  found->after = end;
  for (std::size_t i = 0; i < mode_->channels; ++i) {
    if ((parts_in_doubt_[i] >> part & 1U) == 0) continue;
    double root = found->after;
    bool above = false;
    const Verdict verdict = examine(i, found->after, &root, &above);
    if (verdict == Verdict::none) continue;
    if (verdict == Verdict::at_once) root = 0.0;
    if (any && !(root < found->after)) continue;
    *found = {i, above, root};
    any = true;
    if (verdict == Verdict::at_once) break;
  }
  return any;
}

// After quiet_tick() has failed. False: no switch changes after all, result_ holds the tick's end.
bool Stepper::cross_tick() {
  check_finite();
  double done = 0.0;  // ticks
  bool quiet = false;
  int changes = 0;
  int changes_here = 0;
  // More than a cascade through all switches needs, several times over.
  const int enough_here = 16 + 4 * static_cast<int>(network().switches().size());
  for (;;) {
    const Mode &m = *mode_;
    const double rest = 1.0 - done;
    if (changes_here >= enough_here) {
      // Signals on their bounds whose deciding coefficients lie at the limit of rounding, on one
      // side of it in one mode and on the other in the next. A moment later, in either mode, they
      // do not: what a wrong mode does until then is far below rounding. States that contradict
      // each other in earnest go on contradicting, and the changes run out.
      const double moment = smaller(rest, kMoment * m.reach);
      advance_within_part(moment);
      done = moment < rest ? done + moment : 1.0;
      changes_here = 0;
    } else {
      // The parts of the grid that remain of the tick, the last one cut short.
      const double places = rest / m.reach;  // exact
      std::size_t parts = m.grid;
      if (places < static_cast<double>(parts)) {
        parts = static_cast<std::size_t>(places);
        if (static_cast<double>(parts) < places) ++parts;
      }
      const double covered = smaller(static_cast<double>(parts) * m.reach, rest);
      std::uint64_t doubtful = 0;
      if (!quiet) {
        for (std::size_t i = 0; i < m.channels; ++i)
          doubtful |= parts_in_doubt_[i] = parts_in_doubt(i, parts);
        if (m.samples > 0 && covered == 1.0) {
          if (doubtful == 0) return false;
          if (calm_tick()) {
            calm_mode_ = mode_;
            calm_left_ = kCalmTicks;
            return false;
          }
        }
      }
      // Doubtful parts go by series even if nothing happens: it rounds less than the flow.
      double passed = 0.0;
      bool changed = false;
      Change next;
      for (; doubtful != 0; doubtful &= doubtful - 1) {
        const auto part = static_cast<std::size_t>(std::countr_zero(doubtful));
        const double start = static_cast<double>(part) * m.reach;
        if (start > passed) advance(start - passed);
        passed = start;
        const double end = smaller(m.reach, rest - start);
        changed = first_change(part, end, &next);
        if (changed) break;
        advance_within_part(end);
        passed = smaller(start + m.reach, rest);
      }
      if (!changed) {
        if (covered > passed) advance(covered - passed);
        passed = covered;
      } else if (next.after > 0.0) {
        advance_within_part(next.after);
        passed += next.after;
      }
      if (passed > 0.0) {
        done = passed < rest ? done + passed : 1.0;
        changes_here = 0;
      }
      if (changed) {
        const int switch_index = m.channel[next.channel].switch_index;
        if (++changes > kMostChangesPerTick) fail_switching(switch_index, done);
        ++changes_here;
        change(next.channel, next.above, done, false, true);
      }
    }
    if (!(done < 1.0)) return true;
    quiet = quiet_tick();
  }
}

void Stepper::change(std::size_t channel, bool above, double s, bool jump, bool counted) {
  const Channel &crossed = mode_->channel[channel];
  switch_to(crossed.switch_index, above ? crossed.state_above : crossed.state_below, s, jump,
            counted);
}

void Stepper::switch_to(int index, int to, double s, bool jump, bool counted) {
  const int from = network().state_of(mode_->key, index);
  const double before = audit_ ? stored_total() : 0.0;
  set_mode(network().with_state(mode_->key, index, to));
  // Where a friction begins to stick, its rate is 0 but for the rounding of the instant.
  const std::size_t n = mode_->states;
  if (to == network().switches()[static_cast<std::size_t>(index)].stuck) {
    for (std::size_t i = 0; i < n; ++i) calm_[i] = dot(&mode_->slip[i * n], z_.data(), n);
    for (std::size_t i = 0; i < n; ++i) z_[i] -= calm_[i];
  }
  if (audit_) discarded_.add(before - stored_total());
  if (!counted) return;
  const double time_s = (static_cast<double>(tick_) + s) / cache_->rate_hz();
  // There and back in no time is no change.
  if (last_.switch_index == index && last_.time_s == time_s && last_.from == to &&
      last_.to == from && last_.jump == jump) {
    --(jump ? jumps_ : crossings_);
    --counts_[count_place(index, to, from)];
    if (last_listed_) events_.pop_back();
    last_.switch_index = -1;
    last_listed_ = false;
    return;
  }
  ++(jump ? jumps_ : crossings_);
  ++counts_[count_place(index, from, to)];
  last_ = {time_s, index, from, to, jump};
  last_listed_ = events_.size() < listed_events_;
  if (last_listed_) events_.push_back(last_);
}

void Stepper::kick(std::size_t body, double impulse) {
  const Network::BodyState &moved = network().bodies()[body];
  double &velocity = z_[static_cast<std::size_t>(moved.velocity)];
  const double before = velocity;
  velocity += impulse / moved.mass;
  impulse_.add(0.5 * moved.mass * (velocity - before) * (velocity + before));
  sensors_in_result_ = false;
  slide(true);
  settle(true);
}

// Velocities have just been given: every friction whose ends have different ones slides.
void Stepper::slide(bool counted) {
  constexpr double kSame = 0x1p-36;  // of the velocities: what sticks may differ by rounding
  for (const Network::FrictionEnds &friction : network().frictions()) {
    const auto velocity = [&](int state) {
      return state < 0 ? 0.0 : z_[static_cast<std::size_t>(state)];
    };
    const double a = velocity(friction.velocity_a);
    const double b = velocity(friction.velocity_b);
    if (!(magnitude(a - b) > kSame * (magnitude(a) + magnitude(b)))) continue;
    const int state = a > b ? Network::kForward : Network::kBackward;
    if (network().state_of(mode_->key, friction.switch_index) != state)
      switch_to(friction.switch_index, state, 0.0, true, counted);
  }
}

std::size_t Stepper::count_place(int switch_index, int from, int to) const {
  const std::size_t row =
      static_cast<std::size_t>(switch_index) * count_stride_ + static_cast<std::size_t>(from);
  return row * count_stride_ + static_cast<std::size_t>(to);
}

std::int64_t Stepper::count(int switch_index, int from, int to) const {
  return counts_[count_place(switch_index, from, to)];
}

// ---- energy -----------------------------------------------------------------------------------

void Stepper::audit_tick() {
  const Mode &m = *mode_;
  const std::size_t stride = audit_mode_->form_stride;
  // All forms times z, column by column, is again a matrix by columns: its product with z are the
  // integrals.
  multiply_(audit_mode_->forms.data(), stride * m.columns, z_.data(), m.columns, forms_.data());
  multiply_(forms_.data(), stride, z_.data(), m.columns, integrals_.data());
  add_integrals();
}

void Stepper::add_integrals() {
  const double *value = integrals_.data();
  for (Sum &sum : supplied_) sum.add(*value++);
  for (Sum &sum : dissipated_) sum.add(*value++);
}

// Products of two polynomials, integrated term by term over s ticks of the expansion at hand.
void Stepper::audit_part(double s) {
  const Mode &m = *mode_;
  const std::size_t c = m.columns;
  const auto integral = [&](std::size_t product) {
    double a[64];
    double b[64];
    double power = 1.0;
    for (std::size_t k = 0; k <= m.order; ++k, power *= s) {
      const double *x = &chain_[k * m.flow_stride];
      a[k] = dot(&audit_mode_->first[product * c], k == 0 ? z_.data() : x, k == 0 ? c : m.states);
      b[k] = dot(&audit_mode_->second[product * c], k == 0 ? z_.data() : x, k == 0 ? c : m.states);
      a[k] *= power;
      b[k] *= power;
    }
    double sum = 0.0;
    for (std::size_t degree = 2 * m.order + 1; degree-- > 0;) {
      double coefficient = 0.0;
      const std::size_t from = degree > m.order ? degree - m.order : 0;
      const std::size_t to = degree < m.order ? degree : m.order;
      for (std::size_t i = from; i <= to; ++i) coefficient += a[i] * b[degree - i];
      sum += coefficient * kReciprocal.value[degree + 1];
    }
    return sum * s / cache_->rate_hz();
  };
  for (std::size_t i = 0; i < supplied_.size(); ++i) supplied_[i].add(integral(i));
  for (std::size_t i = 0; i < dissipated_.size(); ++i)
    dissipated_[i].add(integral(supplied_.size() + i));
}

// The grid's flow does not go through the expansion; the integrals do, part by part.
void Stepper::audit_grid(std::size_t parts) {
  const std::vector<double> start = z_;
  for (std::size_t k = 0; k < parts; ++k) {
    expand();
    audit_part(mode_->reach);
    evaluate(mode_->reach);
  }
  z_ = start;
}

std::vector<double> Stepper::stored() const {
  std::vector<double> energies;
  const std::size_t c = mode_->columns;
  const ModeAudit &rows = cache_->audit(mode_->key);
  for (std::size_t i = 0; i < network().storages().size(); ++i)
    energies.push_back(0.5 * dot(&rows.store_first[i * c], z_.data(), c) *
                           dot(&rows.store_second[i * c], z_.data(), c) +
                       rows.store_constant[i]);
  return energies;
}

double Stepper::stored_total() const {
  double sum = 0.0;
  const std::size_t c = mode_->columns;
  for (std::size_t i = 0; i < network().storages().size(); ++i)
    sum += 0.5 * dot(&audit_mode_->store_first[i * c], z_.data(), c) *
               dot(&audit_mode_->store_second[i * c], z_.data(), c) +
           audit_mode_->store_constant[i];
  return sum;
}

double Stepper::kinetic() const {
  double sum = 0.0;
  for (const Network::BodyState &body : network().bodies()) {
    const double v = z_[static_cast<std::size_t>(body.velocity)];
    sum += 0.5 * body.mass * v * v;
  }
  return sum;
}

EnergyIntegrals Stepper::energy() const {
  EnergyIntegrals result;
  for (const Sum &sum : supplied_) result.supplied.push_back(sum.total());
  for (const Sum &sum : dissipated_) result.dissipated.push_back(sum.total());
  result.discarded = discarded_.total();
  result.impulse = impulse_.total();
  return result;
}

}  // namespace forceaxis::sim
