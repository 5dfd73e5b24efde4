#pragma once
// The filter of a sigma-delta converter: a sinc filter of order N, in the limit of a fast
// modulator.
//
// A sample is a weighted mean of the signal over the last N sample periods T. The weight is the
// N-fold convolution of a boxcar of the width T. This weight is a B-spline, so it is a polynomial
// of degree N - 1 in each period. So the sample is a sum of moments of the signal over the last N
// periods,
//     m_j = integral of (b - t)^(j-1) / (j-1)! y(t) dt,    j = 1..N,
// where b is the end of the period. The plant integrates these moments as chained integrals of the
// signal, m_1' = y and m_j' = m_(j-1), which start at 0 in each part of a period
// (Wiring::filter_states). The unit of time is the tick.
//
// The magnitude of the filter is |sin(pi f T) / (pi f T)|^N. Its delay is N T / 2. After a step,
// the sample N periods later is the final value.
#include <array>
#include <cmath>
#include <cstddef>
#include <span>

namespace forceaxis::sim {

class SincFilter {
 public:
  static constexpr std::size_t kHighestOrder = 5;

  SincFilter() = default;
  /// `order` is the order N of the filter, 3 to 5. `period_ticks` is the sample period T in ticks,
  /// > 0.
  SincFilter(std::size_t order, double period_ticks);

  /// Returns true if the converter has a filter.
  bool fitted() const { return order_ > 0; }
  std::size_t order() const { return order_; }
  /// Returns the weight of moment j + 1 of a period in a sample. `later` = 0 means the sample at
  /// the end of the period, `later` = 1 the next sample, and so on.
  double weight(std::size_t later, std::size_t j) const { return weights_[later][j]; }

  /// Starts the filter with a signal that has had this value at all times before tick 0. The first
  /// sample is taken `phase` ticks after tick 0, at least 0 and below T.
  void begin(double value, double phase);
  /// Adds the moments of the signal over the last `ticks` ticks.
  void add(std::span<const double> moments, double ticks);
  /// Returns the sample at the end of the period whose moments were added last. The length of this
  /// period may differ from T, because instants close to a tick are treated as this tick
  /// (SampledSensor). The filter uses T in place of such a length.
  double take();

 private:
  using Row = std::array<double, kHighestOrder>;

  std::size_t order_ = 0;
  double period_ = 0.0;
  /// Weights of the moments of a period in the sample at the end of the period, in the next sample,
  /// and so on.
  std::array<Row, kHighestOrder> weights_{};
  Row moments_{};  // moments of the signal from the start of the present period until now

  // Time in ticks from the start of the present period up to now.
  double length_ = 0.0;
  /// Contributions of past periods to the next samples, the nearest sample first.
  Row due_{};
};

// The pieces of a B-spline are computed from the pieces of the next lower order (de Boor). Piece i
// of order n is a polynomial in x. x is the position within the interval of the piece, from 0 to 1:
//   b_n,i = ((i + x) b_(n-1),i + (n - i - x) b_(n-1),(i-1)) / (n - 1)
inline SincFilter::SincFilter(std::size_t order, double period_ticks)
    : order_(order), period_(period_ticks) {
  std::array<Row, kHighestOrder> pieces{};
  pieces[0][0] = 1.0;
  for (std::size_t n = 2; n <= order; ++n) {
    std::array<Row, kHighestOrder> next{};
    for (std::size_t i = 0; i < n; ++i) {
      const auto at = static_cast<double>(i);
      for (std::size_t k = 0; k < n; ++k) {
        const double own = pieces[i][k];
        const double before = i > 0 ? pieces[i - 1][k] : 0.0;
        next[i][k] += at * own + (static_cast<double>(n) - at) * before;
        if (k + 1 < n) next[i][k + 1] += own - before;
      }
    }
    for (Row &piece : next)
      for (double &coefficient : piece) coefficient /= static_cast<double>(n - 1);
    pieces = next;
  }
  for (std::size_t i = 0; i < order; ++i) {
    double scale = 1.0 / period_;
    for (std::size_t j = 0; j < order; ++j) {
      weights_[i][j] = pieces[i][j] * scale;
      scale *= static_cast<double>(j + 1) / period_;
    }
  }
}

inline void SincFilter::begin(double value, double phase) {
  const auto constant = [&](double ticks) {
    Row moments{};
    double moment = value;
    for (std::size_t j = 0; j < order_; ++j) {
      moment *= ticks / static_cast<double>(j + 1);
      moments[j] = moment;
    }
    return moments;
  };
  const Row whole = constant(period_);
  for (std::size_t k = 0; k < order_; ++k) {
    moments_ = whole;
    length_ = period_;
    (void)take();
  }
  length_ = period_ - phase;
  moments_ = constant(length_);
}

inline void SincFilter::add(std::span<const double> moments, double ticks) {
  // The earlier moments refer to the old end b'. For the new end b, their weight is (b - t)^(j-1) =
  // ((b' - t) + ticks)^(j-1).
  for (std::size_t j = order_; j-- > 0;) {
    double sum = moments[j];
    double power = 1.0;
    for (std::size_t l = j + 1; l-- > 0;) {
      sum += moments_[l] * power;
      power *= ticks / static_cast<double>(j + 1 - l);
    }
    moments_[j] = sum;
  }
  length_ += ticks;
}

inline double SincFilter::take() {
  double stretch = 1.0;
  for (std::size_t j = 0; j < order_; ++j) {
    stretch *= period_ / length_;
    moments_[j] *= stretch;
  }
  const auto share = [&](std::size_t later) {
    double sum = 0.0;
    for (std::size_t j = 0; j < order_; ++j) sum += weights_[later][j] * moments_[j];
    return sum;
  };
  const double sample = due_[0] + share(0);
  for (std::size_t k = 0; k + 1 < order_; ++k) due_[k] = due_[k + 1] + share(k + 1);
  moments_ = {};
  length_ = 0.0;
  return sample;
}

}  // namespace forceaxis::sim
