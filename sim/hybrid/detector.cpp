#include "sim/hybrid/detector.hpp"

#include <limits>

#include "sim/hybrid/crossing.hpp"

namespace forceaxis::sim {
namespace {

using kernel::magnitude;

// Number of ticks in which the second test runs before the quiet test. This number affects only the
// computing time.
constexpr int kCalmTicks = 31;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

void Detector::enter(const Mode &mode) {
  mode_ = &mode;
  const auto grow = [](auto &buffer, std::size_t size) {
    if (buffer.size() < size) buffer.resize(size);
  };
  grow(result_, mode.tick_stride);
  grow(curve_, mode.curve_stride);
  grow(calm_, mode.calm_stride);
  grow(absolute_, mode.columns);
  grow(grid_signal_, mode.grid_signal_stride);
  grow(grid_dip_, mode.grid_dip_stride);
  grow(parts_in_doubt_, mode.channels);
  grow(polynomial_, mode.series_stride);
  if (mode.pieces) {
    grow(result_, mode.pieces->flow_stride);
    grow(curve_, mode.pieces->bound_stride);
    grow(piece_head_, mode.pieces->head_stride);
    grow(piece_sizes_, mode.states + mode.pieces->fast + mode.columns);
  }
}

bool Detector::still_calm(const double *z) {
  --calm_left_;
  multiply_(mode_->tick.data(), mode_->tick_stride, z, mode_->columns, result_.data());
  if (passes_second_test(z)) return true;
  calm_left_ = 0;
  return false;
}

bool Detector::calm(const double *z) {
  if (!passes_second_test(z)) {
    expected_calm_ = nullptr;
    return false;
  }
  calm_mode_ = mode_;
  calm_left_ = kCalmTicks;
  return true;
}

// Runs the second test that is described at Mode. The quiet test must have computed the signals in
// result_ before.
bool Detector::passes_second_test(const double *z) {
  return calm_test_(mode_->calm, z, result_.data() + mode_->signal_place, calm_.data(),
                    curve_.data());
}

bool Detector::beyond_after(double change) const {
  const Mode &m = *mode_;
  const double *at = result_.data() + m.signal_place + m.samples * m.channel_stride;
  for (const std::size_t i : m.fed) {
    const double value = at[i] + m.signal[(i + 1) * m.columns - 1] * change;
    if (!(value >= m.low[i] && value <= m.high[i])) return true;
  }
  return false;
}

bool Detector::beyond_now() const {
  const Mode &m = *mode_;
  if (m.samples == 0) return true;
  const double *at = result_.data() + m.signal_place;
  for (std::size_t i = 0; i < m.channels; ++i)
    if (!(at[i] >= m.low[i] && at[i] <= m.high[i])) return true;
  return false;
}

// Finds the first instant in [0, end] at which the polynomial g = polynomial_ becomes negative.
Detector::Verdict Detector::examine_side(std::size_t channel, double bound, double end,
                                         double *root) {
  const Mode &m = *mode_;
  const std::size_t c = m.columns;
  const double *q = polynomial_.data();

  // If a signal is on its bound, the sign of the first Taylor coefficient above the rounding error
  // decides. The polynomial is divided by its root at 0 before the search for a root. If no
  // coefficient is above the rounding error, the signal stays on its bound in this part. The
  // rounding error is that of the state in the balanced norm (Mode::doubt). For example, if
  // positions have a rounding error of 1e-18 m, a velocity below 1e-18 m times the fastest rate is
  // ignored. Otherwise the last bits of the positions would open and close contacts whose force is
  // 0.
  const double *doubt = &m.doubt[channel * (m.order + 1) * c];
  for (std::size_t k = 0; k <= m.order; ++k, doubt += c) {
    double scale = k == 0 ? magnitude(bound) : 0.0;
    for (std::size_t j = 0; j < c; ++j) scale += doubt[j] * absolute_[j];
    if (!(magnitude(q[k]) > rounding_ * scale)) continue;
    if (q[k] < 0.0) return Verdict::at_once;
    if (k == m.order) return Verdict::none;
    return first_crossing(q + k, m.order - k, end, root) ? Verdict::later : Verdict::none;
  }
  return Verdict::none;
}

Detector::Verdict Detector::examine(const double *z, std::size_t channel, double end, double *root,
                                    bool *above) {
  const Mode &m = *mode_;
  const Channel &watched = m.channel[channel];
  double *q = polynomial_.data();
  multiply_(&m.series[channel * m.columns * m.series_stride], m.series_stride, z, m.columns, q);
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

// Returns the parts of the time grid in which the signal of one channel can reach a bound. The
// result has one bit for each part.
std::uint64_t Detector::parts_in_doubt(const double *z, std::size_t channel, std::size_t wanted) {
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
  const std::uint64_t doubt = grid_(test, z, grid_signal_.data(), grid_dip_.data());
  return doubt & (~std::uint64_t{0} >> (64 - wanted));
}

std::uint64_t Detector::doubtful_parts(const double *z, std::size_t wanted) {
  std::uint64_t doubtful = 0;
  for (std::size_t i = 0; i < mode_->channels; ++i)
    doubtful |= parts_in_doubt_[i] = parts_in_doubt(z, i, wanted);
  return doubtful;
}

void Detector::start_piece(const double *z) {
  const Pieces &pieces = *mode_->pieces;
  multiply_(pieces.head.data(), pieces.head_stride, z, mode_->columns, piece_head_.data());
  double *size = piece_sizes_.data();
  for (std::size_t j = 0; j < mode_->states; ++j) *size++ = magnitude(piece_head_[j]);
  const double *fast = &piece_head_[pieces.fast_place];
  for (std::size_t i = 0; i < pieces.fast; ++i)
    *size++ = magnitude(fast[i]) + magnitude(fast[pieces.fast + i]);
  for (std::size_t j = 0; j < mode_->columns; ++j) *size++ = magnitude(z[j]);
}

// Returns the rounding error of the signal of a channel, in the same norm as examine_side().
double Detector::piece_rounding(const double *z, std::size_t channel, double bound) const {
  const Mode &m = *mode_;
  const double *doubt = &m.doubt[channel * (m.order + 1) * m.columns];
  double scale = magnitude(bound);
  for (std::size_t j = 0; j < m.columns; ++j) scale += doubt[j] * magnitude(z[j]);
  return rounding_ * scale;
}

const double *Detector::end_of_piece(const double *z, std::size_t halvings) {
  const Pieces &pieces = *mode_->pieces;
  multiply_(pieces.flow[halvings].data(), pieces.flow_stride, z, mode_->columns, result_.data());
  return result_.data();
}

bool Detector::passes_piece(const double *z, std::size_t halvings) {
  const Mode &m = *mode_;
  const Pieces &pieces = *m.pieces;
  end_of_piece(z, halvings);
  multiply_(pieces.bound[halvings].data(), pieces.bound_stride, piece_sizes_.data(),
            m.states + pieces.fast + m.columns, curve_.data());
  const double length = Pieces::length(halvings);
  bool passes = true;
  for (std::size_t i = 0; i < m.channels; ++i) {
    const double a = piece_head_[pieces.start_place + i];
    const double b = result_[pieces.signal_place + i];
    const double bend = magnitude(piece_head_[pieces.bend_place + i]);
    const double dip = curve_[i] + 0.125 * length * length * bend;
    parts_in_doubt_[i] = 0;
    if (kernel::inside(a, b, dip, m.low[i], m.high[i])) continue;
    const Channel &channel = m.channel[i];
    if (kernel::inside(a, b, dip, channel.low - piece_rounding(z, i, channel.low),
                       channel.high + piece_rounding(z, i, channel.high)))
      continue;
    parts_in_doubt_[i] = 1;
    passes = false;
  }
  return passes;
}

bool Detector::first_change(const double *z, std::size_t part, double end, Change *found) {
  for (std::size_t j = 0; j < mode_->columns; ++j) absolute_[j] = magnitude(z[j]);
  bool any = false;
  found->after = end;
  for (std::size_t i = 0; i < mode_->channels; ++i) {
    if ((parts_in_doubt_[i] >> part & 1U) == 0) continue;
    double root = found->after;
    bool above = false;
    const Verdict verdict = examine(z, i, found->after, &root, &above);
    if (verdict == Verdict::none) continue;
    if (verdict == Verdict::at_once) root = 0.0;
    if (any && !(root < found->after)) continue;
    *found = {i, above, root};
    any = true;
    if (verdict == Verdict::at_once) break;
  }
  return any;
}

}  // namespace forceaxis::sim
