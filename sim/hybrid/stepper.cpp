#include "sim/hybrid/stepper.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "sim/hybrid/crossing.hpp"
#include "sim/hybrid/kernel.hpp"

namespace forceaxis::sim {
namespace {

using kernel::dot;
using kernel::magnitude;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kRounding = 0x1p-46;  // bound on the relative rounding of a channel's value
constexpr int kMostChangesPerTick = 20000;
constexpr int kMostChangesPerInstant = 1000;
constexpr std::size_t kRecentModes = 64;

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
  end_ = z_;
  for (const Network::Switch &s : net.switches())
    count_stride_ = std::max(count_stride_, s.state_names.size());
  counts_.assign(net.switches().size() * count_stride_ * count_stride_, 0);
  supplied_.resize(net.supplies().size());
  dissipated_.resize(net.dampers().size());
  set_mode(net.home_key(false));
  check_finite();
  settle(false);
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
  }
  mode_ = slot.mode;
  audit_mode_ = slot.audit;
  if (result_.size() < mode_->tick_stride) result_.resize(mode_->tick_stride);
  if (curve_.size() < mode_->curve_stride) curve_.resize(mode_->curve_stride);
  const std::size_t chain = (mode_->order + 1) * mode_->flow_stride;
  if (chain_.size() < chain) chain_.resize(chain);
  if (polynomial_.size() < mode_->order + 1) polynomial_.resize(mode_->order + 1);
}

void Stepper::check_finite() const {
  for (const double value : z_)
    if (!(magnitude(value) < 1e100))
      throw SimulationError("the plant's state left all bounds at t = " +
                            std::to_string(static_cast<double>(tick_) / kTickRateHz) +
                            " s: the loop is unstable; lower the gain or check the model");
}

void Stepper::fail_switching(int switch_index, double s) const {
  throw SimulationError(
      network().switches()[static_cast<std::size_t>(switch_index)].element +
      " keeps switching without end at t = " +
      std::to_string((static_cast<double>(tick_) + s) / kTickRateHz) +
      " s: its states contradict each other there; change this element or its neighbours");
}

void Stepper::step(double command, bool enable) {
  const std::size_t n = mode_->states;
  bool unsettled = false;
  if (Network::enabled(mode_->key) != enable) {
    if (!enable)
      for (const int state : network().drive_states()) z_[static_cast<std::size_t>(state)] = 0.0;
    z_[n + 1] = command;
    set_mode(network().with_enable(mode_->key, enable));
    settle(false);
    unsettled = true;
  }
  z_[n + 1] = command;
  if (!quiet_tick()) {
    // The new command may have put signals beyond their bounds at once.
    if (!unsettled) settle(true);
    if (!quiet_tick()) {
      cross_tick();
      ++tick_;
      return;
    }
  }
  if (audit_) audit_tick();
  for (std::size_t i = 0; i < n; ++i) z_[i] = result_[i];
  ++tick_;
}

bool Stepper::quiet_tick() {
  const Mode &m = *mode_;
  if (m.samples == 0) return false;
  const double *z = z_.data();
  kernel::multiply(m.tick.data(), m.tick_stride, z, m.columns, result_.data());
  if (m.channels == 0) return true;
  for (std::size_t j = 0; j < m.columns; ++j) absolute_[j] = magnitude(z[j]);
  kernel::multiply(m.curve.data(), m.curve_stride, absolute_.data(), m.columns, curve_.data());
  const double *at = result_.data() + kernel::padded(m.states);
  const double *dip = curve_.data();
  const double *low = m.low.data();
  const double *high = m.high.data();
  const std::size_t stride = m.channel_stride;
  bool inside = true;
  for (std::size_t k = 0; k < m.samples; ++k, at += stride, dip += stride)
    for (std::size_t i = 0; i < stride; ++i) {
      const double a = at[i];
      const double b = at[i + stride];
      const double least = (a < b ? a : b) - dip[i];
      const double most = (a < b ? b : a) + dip[i];
      inside = inside & (least >= low[i]) & (most <= high[i]);
    }
  return inside;
}

// Moves every switch whose signal lies clearly beyond its bound, in dependency order, until none
// does. Signals on their bound (within rounding) stay: their next derivative decides, in examine().
void Stepper::settle(bool count_jumps) {
  for (int changes = 0;; ++changes) {
    const Mode &m = *mode_;
    bool moved = false;
    for (std::size_t i = 0; i < m.channels && !moved; ++i) {
      const Channel &channel = m.channel[i];
      const double value = dot(&m.signal[i * m.columns], z_.data(), m.columns);
      double scale = 0.0;
      for (std::size_t j = 0; j < m.columns; ++j)
        scale += m.size[i * m.columns + j] * magnitude(z_[j]);
      const bool below = value < channel.low - kRounding * (scale + magnitude(channel.low));
      const bool above = value > channel.high + kRounding * (scale + magnitude(channel.high));
      if (!below && !above) continue;
      if (changes > kMostChangesPerInstant) fail_switching(channel.switch_index, 0.0);
      change(i, above, 0.0, true, count_jumps);
      moved = true;
    }
    if (!moved) return;
  }
}

// Taylor coefficients of the state, time in ticks: x_k = A T x_(k-1) / k.
void Stepper::expand() {
  const Mode &m = *mode_;
  const std::size_t n = m.states;
  double *block = chain_.data();
  for (std::size_t i = 0; i < n; ++i) block[i] = z_[i];
  kernel::multiply(m.flow.data(), m.flow_stride, z_.data(), m.columns, block + m.flow_stride);
  block += m.flow_stride;
  for (std::size_t k = 2; k <= m.order; ++k, block += m.flow_stride) {
    double *next = block + m.flow_stride;
    kernel::multiply(m.flow.data(), m.flow_stride, block, n, next);
    for (std::size_t i = 0; i < m.flow_stride; ++i) next[i] *= kReciprocal.value[k];
  }
}

void Stepper::evaluate(double s, double *x) const {
  const Mode &m = *mode_;
  const std::size_t n = m.states;
  const double *block = chain_.data() + m.order * m.flow_stride;
  for (std::size_t i = 0; i < n; ++i) x[i] = block[i];
  for (std::size_t k = m.order; k-- > 0;) {
    block -= m.flow_stride;
    for (std::size_t i = 0; i < n; ++i) x[i] = x[i] * s + block[i];
  }
}

// g = sign (signal - bound) >= 0 is to hold; finds where on [0, end] it ceases to.
Stepper::Verdict Stepper::examine_side(std::size_t channel, double bound, double sign, double end,
                                       double *root) {
  const Mode &m = *mode_;
  const std::size_t c = m.columns;
  double *q = polynomial_.data();
  const double *row = &m.signal[channel * c];
  for (std::size_t k = 0; k <= m.order; ++k)
    q[k] = sign * dot(row, &chain_[k * m.flow_stride], m.states);
  q[0] = sign * (dot(row, z_.data(), c) - bound);

  // How exactly value, slope and curvature at the start are known.
  double scale[3] = {magnitude(bound), 0.0, 0.0};
  const double *sizes[3] = {&m.size[channel * c], &m.slope[channel * c], &m.bend[channel * c]};
  for (int d = 0; d < 3; ++d)
    for (std::size_t j = 0; j < c; ++j) scale[d] += sizes[d][j] * magnitude(z_[j]);

  // A signal on its bound: the sign of its first derivative that is not 0 decides, and the rest is
  // searched with the root at the start divided out.
  std::size_t degree = m.order;
  for (int d = 0; d < 3 && magnitude(q[0]) <= kRounding * scale[d]; ++d) {
    ++q;
    --degree;
    while (d == 2 && degree > 0 && q[0] == 0.0) {
      ++q;
      --degree;
    }
    if (degree == 0) return q[0] < 0.0 ? Verdict::at_once : Verdict::none;
  }
  if (q[0] < 0.0) return Verdict::at_once;
  if (q[0] == 0.0) return Verdict::none;
  return first_crossing(q, degree, end, root) ? Verdict::later : Verdict::none;
}

Stepper::Verdict Stepper::examine(std::size_t channel, double end, double *root, bool *above) {
  const Channel &watched = mode_->channel[channel];
  Verdict verdict = Verdict::none;
  if (watched.low > -kInfinity) {
    verdict = examine_side(channel, watched.low, 1.0, end, root);
    *above = false;
    if (verdict == Verdict::at_once) return verdict;
    if (verdict == Verdict::later) end = *root;
  }
  if (watched.high < kInfinity) {
    double other = end;
    const Verdict upper = examine_side(channel, watched.high, -1.0, end, &other);
    if (upper != Verdict::none) {
      *root = other;
      *above = true;
      verdict = upper;
    }
  }
  return verdict;
}

void Stepper::cross_tick() {
  check_finite();
  double done = 0.0;  // ticks; the rest is 1 - done, kept apart to end exactly
  double left = 1.0;
  int changes = 0;
  int changes_here = 0;
  while (left > 0.0) {
    const Mode &m = *mode_;
    const std::size_t n = m.states;
    const std::size_t c = m.columns;
    const double part = left < m.reach ? left : m.reach;
    expand();
    evaluate(part, end_.data());
    end_[n] = 1.0;
    end_[n + 1] = z_[n + 1];

    double first = part;
    std::size_t which = m.channels;
    bool above = false;
    for (std::size_t i = 0; i < m.channels; ++i) {
      const double *row = &m.signal[i * c];
      const double a = dot(row, z_.data(), c);
      const double b = dot(row, end_.data(), c);
      double bend = 0.0;
      double scale = 0.0;
      for (std::size_t j = 0; j < c; ++j) {
        bend += m.bend[i * c + j] * magnitude(z_[j]);
        scale += m.size[i * c + j] * (magnitude(z_[j]) + magnitude(end_[j]));
      }
      const double dip = 0.125 * part * part * bend + kRounding * scale;
      const double least = (a < b ? a : b) - dip;
      const double most = (a < b ? b : a) + dip;
      if (least >= m.low[i] && most <= m.high[i]) continue;
      double root = first;
      bool root_above = false;
      const Verdict verdict = examine(i, first, &root, &root_above);
      if (verdict == Verdict::none) continue;
      if (verdict == Verdict::at_once) root = 0.0;
      if (which < m.channels && !(root < first)) continue;
      first = root;
      which = i;
      above = root_above;
      if (verdict == Verdict::at_once) break;
    }

    if (which == m.channels) {
      if (audit_) audit_part(part);
      for (std::size_t i = 0; i < n; ++i) z_[i] = end_[i];
      left -= part;
      done += part;
      changes_here = 0;
      continue;
    }
    const int switch_index = m.channel[which].switch_index;
    if (++changes > kMostChangesPerTick) fail_switching(switch_index, done);
    if (first > 0.0) {
      if (audit_) audit_part(first);
      evaluate(first, end_.data());
      for (std::size_t i = 0; i < n; ++i) z_[i] = end_[i];
      left -= first;
      done += first;
      changes_here = 0;
    }
    if (++changes_here > kMostChangesPerInstant) fail_switching(switch_index, done);
    change(which, above, done, false, true);
  }
}

void Stepper::change(std::size_t channel, bool above, double s, bool jump, bool counted) {
  const Channel &crossed = mode_->channel[channel];
  const int index = crossed.switch_index;
  const int from = network().state_of(mode_->key, index);
  const int to = above ? crossed.state_above : crossed.state_below;
  const double before = audit_ ? stored_total() : 0.0;
  set_mode(network().with_state(mode_->key, index, to));
  if (audit_) discarded_.add(before - stored_total());
  if (!counted) return;
  jump ? ++jumps_ : ++crossings_;
  const std::size_t row = static_cast<std::size_t>(index) * count_stride_ +
                          static_cast<std::size_t>(from);
  ++counts_[row * count_stride_ + static_cast<std::size_t>(to)];
  if (events_.size() < listed_events_)
    events_.push_back({(static_cast<double>(tick_) + s) / kTickRateHz, index, from, to, jump});
}

void Stepper::kick(std::size_t body, double impulse) {
  const Network::BodyState &moved = network().bodies()[body];
  double &velocity = z_[static_cast<std::size_t>(moved.velocity)];
  const double before = velocity;
  velocity += impulse / moved.mass;
  impulse_.add(0.5 * moved.mass * (velocity - before) * (velocity + before));
  settle(true);
}

std::int64_t Stepper::count(int switch_index, int from, int to) const {
  const std::size_t row = static_cast<std::size_t>(switch_index) * count_stride_ +
                          static_cast<std::size_t>(from);
  return counts_[row * count_stride_ + static_cast<std::size_t>(to)];
}

// ---- energy -----------------------------------------------------------------------------------

void Stepper::audit_tick() {
  const std::size_t c = mode_->columns;
  const double *z = z_.data();
  const auto integral = [&](const double *form) {
    double sum = 0.0;
    for (std::size_t i = 0; i < c; ++i) sum += z[i] * dot(form + i * c, z, c);
    return sum;
  };
  for (std::size_t i = 0; i < supplied_.size(); ++i)
    supplied_[i].add(integral(&audit_mode_->supply[i * c * c]));
  for (std::size_t i = 0; i < dissipated_.size(); ++i)
    dissipated_[i].add(integral(&audit_mode_->damper[i * c * c]));
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
    return sum * s / kTickRateHz;
  };
  for (std::size_t i = 0; i < supplied_.size(); ++i) supplied_[i].add(integral(i));
  for (std::size_t i = 0; i < dissipated_.size(); ++i)
    dissipated_[i].add(integral(supplied_.size() + i));
}

std::vector<double> Stepper::stored() const {
  std::vector<double> energies;
  const std::size_t c = mode_->columns;
  const ModeAudit &rows = cache_->audit(mode_->key);
  for (std::size_t i = 0; i < network().storages().size(); ++i)
    energies.push_back(0.5 * dot(&rows.store_first[i * c], z_.data(), c) *
                       dot(&rows.store_second[i * c], z_.data(), c));
  return energies;
}

double Stepper::stored_total() const {
  double sum = 0.0;
  const std::size_t c = mode_->columns;
  for (std::size_t i = 0; i < network().storages().size(); ++i)
    sum += 0.5 * dot(&audit_mode_->store_first[i * c], z_.data(), c) *
           dot(&audit_mode_->store_second[i * c], z_.data(), c);
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
