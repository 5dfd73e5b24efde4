#include "sim/linear/code_period.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <numbers>
#include <utility>

#include "sim/matrix/hessenberg.hpp"

namespace forceaxis::sim {
namespace {

using Complex = std::complex<double>;
using Eigen::Index;
using Row = Eigen::Matrix<Extended, 1, Eigen::Dynamic>;

// Two instants that differ by less than this number of ticks are treated as equal, as in a
// simulated run.
constexpr Extended kSame = 1e-6L;

// Returns floor(number). A number that is nearly a whole number is rounded to this whole number.
// The unit of `number` is `step` ticks.
Extended floor_of(Extended number, Extended step) {
  const Extended whole = std::nearbyint(number);
  return std::abs(number - whole) * step < kSame ? whole : std::floor(number);
}

// A linear function of one period: `row` is multiplied by the state at the start of the period, and
// `direct` by the code of the period.
struct Value {
  Row row;
  Extended direct;
};

Value sum_of(const Value &a, const Value &b, Extended factor) {
  return {a.row + factor * b.row, a.direct + factor * b.direct};
}

// A sample of the force as a sum over several periods. The key is the number of the period, counted
// from the first tick of a cycle.
using Parts = std::map<int, Value>;

void add_to(Parts &parts, Extended periods, const Value &value, Extended factor) {
  const auto [place, is_new] =
      parts.try_emplace(static_cast<int>(periods), Value{Row::Zero(value.row.size()), Extended{0}});
  place->second = sum_of(place->second, value, factor);
}

// Returns the system for hessenberg_response(), with states in units that balance the matrix A.
Hessenberg balanced(ExtendedMatrix A, ExtendedMatrix B, ExtendedMatrix C) {
  const Eigen::VectorXd d = balance(A);
  for (Index i = 0; i < A.rows(); ++i) {
    for (Index j = 0; j < A.rows(); ++j) A(i, j) *= Extended{d(j)} / d(i);
    B(i, 0) /= d(i);
    C.col(i) *= d(i);
  }
  return hessenberg(A, B, C);
}

}  // namespace

// The plant within one period. One DAC code acts during a period. Instants are in ticks from the
// start of the period, in (0, cycle_ticks]. The direct feedthrough at the end of the period is
// still that of this code.
class CodePeriod::Flow {
 public:
  Flow(const TickSystem &plant, const CodeTiming &timing)
      : states_(plant.A.rows()),
        order_(timing.sinc_order),
        cycle_(timing.cycle_ticks),
        every_(timing.every),
        filter_(static_cast<std::size_t>(order_), static_cast<double>(every_)),
        C_(plant.C),
        D_(plant.D),
        tick_s_(plant.tick_s) {
    const Index size = states_ + order_;
    A_ = ExtendedMatrix::Zero(size, size);
    B_ = ExtendedMatrix::Zero(size, 1);
    A_.topLeftCorner(states_, states_) = plant.A;
    B_.topRows(states_) = plant.B;
    // Chained integrals of the force, whose unit of time is the tick.
    if (order_ > 0) {
      A_.row(states_).head(states_) = plant.C / Extended{tick_s_};
      B_(states_, 0) = plant.D / Extended{tick_s_};
    }
    for (Index k = states_ + 1; k < size; ++k) A_(k, k - 1) = 1 / Extended{tick_s_};
  }

  // Returns a matrix of n x (n + 1) elements for an instant t. The first n columns are e^(A t) of
  // the plant. The last column is the effect of the code.
  ExtendedMatrix moved(Extended ticks) const {
    ExtendedMatrix state = step(ticks).topRows(states_);
    ExtendedMatrix result(states_, states_ + 1);
    result << state.leftCols(states_), state.col(states_ + order_);
    result.leftCols(states_) += ExtendedMatrix::Identity(states_, states_);
    return result;
  }

  // Returns the sample of the force at `instant`, in ticks after the start of a period.
  Parts sample(Extended instant) const {
    Parts parts;
    if (order_ == 0) {
      // At the end of a period, the code of this period still acts.
      const Extended periods = -floor_of(-instant / cycle_, cycle_) - 1;
      add_to(parts, periods, force(instant - periods * cycle_), 1);
    }
    for (int later = 0; later < order_; ++later) add_interval(parts, instant, later);
    return parts;
  }

 private:
  // Adds the effect of the force in the interval between two samples. The effect is on the sample
  // that is `later` samples after the end of this interval.
  void add_interval(Parts &parts, Extended instant, int later) const {
    const Extended end = instant - later * every_;
    for (Extended low = end - every_; end - low > kSame;) {
      const Extended periods = floor_of(low / cycle_, cycle_);
      const Extended start = periods * cycle_;
      const Extended high = std::min(end, start + cycle_);
      const auto found =
          about(moments(std::max(low - start, Extended{0}), high - start), end - high);
      for (std::size_t j = 0; j < found.size(); ++j)
        add_to(parts, periods, found[j], filter_.weight(static_cast<std::size_t>(later), j));
      low = high;
    }
  }

  // Returns the force at an instant.
  Value force(Extended ticks) const {
    const ExtendedMatrix state = moved(ticks);
    const Row row = C_ * state;
    return {row.head(states_), row(states_) + D_};
  }

  // Returns the moments of the force over the part of a period from `low` to `high`, about `high`:
  // moment j is the integral of (high - t)^(j - 1) / (j - 1)! times the force.
  std::vector<Value> moments(Extended low, Extended high) const {
    std::vector<Value> found = from_start(high);
    const std::vector<Value> before = about(from_start(low), high - low);
    for (std::size_t j = 0; j < found.size(); ++j) found[j] = sum_of(found[j], before[j], -1);
    return found;
  }

  // Converts moments to moments about an instant that is `later` ticks later.
  static std::vector<Value> about(const std::vector<Value> &moments, Extended later) {
    std::vector<Value> moved = moments;
    for (std::size_t j = 0; j < moments.size(); ++j) {
      Extended factor = 1;
      for (std::size_t back = 1; back <= j; ++back) {
        factor *= later / static_cast<Extended>(back);
        moved[j] = sum_of(moved[j], moments[j - back], factor);
      }
    }
    return moved;
  }

  std::vector<Value> from_start(Extended ticks) const {
    std::vector<Value> found;
    if (ticks < kSame) {
      found.resize(static_cast<std::size_t>(order_), {Row::Zero(states_), 0});
      return found;
    }
    const ExtendedMatrix &all = step(ticks);
    for (Index k = states_; k < states_ + order_; ++k)
      found.push_back({all.row(k).head(states_), all(k, states_ + order_)});
    return found;
  }

  // Returns sampled() for a number of ticks. The result for each number is computed once.
  const ExtendedMatrix &step(Extended ticks) const {
    const auto known = std::find_if(steps_.begin(), steps_.end(), [&](const auto &one) {
      return std::abs(one.first - ticks) < kSame * kSame;
    });
    if (known != steps_.end()) return known->second;
    const auto time_s = static_cast<double>(ticks * tick_s_);
    return steps_.emplace_back(ticks, sampled(A_, B_, time_s)).second;
  }

  Index states_;
  int order_;
  Extended cycle_, every_;  // cycle time of the bus and sampling period of the sensor, in ticks
  SincFilter filter_;
  ExtendedMatrix C_;
  Extended D_;
  double tick_s_;
  ExtendedMatrix A_, B_;
  mutable std::vector<std::pair<Extended, ExtendedMatrix>> steps_;
};

CodePeriod::CodePeriod(const TickSystem &plant, const CodeTiming &timing)
    : cycle_ticks_(timing.cycle_ticks) {
  const Flow flow(plant, timing);
  std::vector<Row> rows;
  const auto add = [&](const Parts &parts, int tick) {
    const std::size_t first = terms_.size();
    for (const auto &[periods, value] : parts) {
      terms_.push_back({periods, static_cast<double>(value.direct)});
      rows.push_back(value.row);
    }
    readings_.push_back({first, terms_.size(), {tick}});
  };
  Extended before = 0;
  for (int tick = 0; tick < timing.cycle_ticks; ++tick) {
    const Extended newest =
        floor_of((tick - timing.latency - timing.phase) / timing.every, timing.every);
    if (!readings_.empty() && newest == before) {
      readings_.back().ticks.push_back(tick);
      continue;
    }
    before = newest;
    add(flow.sample(timing.phase + newest * timing.every - timing.delay_ticks_out), tick);
  }
  const ExtendedMatrix period = flow.moved(timing.cycle_ticks);
  const Index n = period.rows();
  ExtendedMatrix C(static_cast<Index>(rows.size()), n);
  for (std::size_t i = 0; i < rows.size(); ++i) C.row(static_cast<Index>(i)) = rows[i];
  if (n > 0) balanced_ = balanced(period.leftCols(n), period.col(n), std::move(C));
}

void CodePeriod::response(std::span<const double> w, std::span<Complex> values) const {
  const auto cycle = static_cast<std::size_t>(cycle_ticks_);
  std::vector<Complex> turns(w.size());  // e^(i w T) of one tick T at each frequency w
  std::vector<Complex> points(w.size());
  const auto power = [](Complex base, int exponent) {
    Complex result = 1;
    // The conjugate is the inverse, because |base| is 1.
    const Complex factor = exponent < 0 ? std::conj(base) : base;
    for (int i = 0; i < std::abs(exponent); ++i) result *= factor;
    return result;
  };
  for (std::size_t i = 0; i < w.size(); ++i) {
    const double size = 1 + w[i] * w[i];
    turns[i] = {(1 - w[i] * w[i]) / size, 2 * w[i] / size};
    points[i] = power(turns[i], cycle_ticks_);
  }
  std::vector<Complex> states(points.size() * terms_.size());
  if (balanced_.H.rows() > 0)
    hessenberg_response(balanced_.H, balanced_.B, balanced_.C,
                        Eigen::MatrixXd::Zero(balanced_.C.rows(), 1), points, states);
  std::vector<Complex> apart;  // factors e^(-2 pi j k / m)
  for (std::size_t k = 0; k < cycle; ++k) {
    const Extended angle =
        -2 * std::numbers::pi_v<Extended> * static_cast<Extended>(k) / static_cast<Extended>(cycle);
    apart.emplace_back(static_cast<double>(std::cos(angle)), static_cast<double>(std::sin(angle)));
  }
  std::fill(values.begin(), values.end(), Complex{});
  for (std::size_t i = 0; i < points.size(); ++i)
    for (const Reading &reading : readings_) {
      Complex sum = 0;
      for (std::size_t t = reading.first; t < reading.end; ++t)
        sum += power(points[i], terms_[t].periods) *
               (states[i * terms_.size() + t] + terms_[t].direct);
      sum /= static_cast<double>(cycle_ticks_);
      for (const int tick : reading.ticks) {
        const Complex turned = sum * power(turns[i], -tick);
        for (std::size_t k = 0; k < cycle; ++k)
          values[k * points.size() + i] +=
              turned * apart[k * static_cast<std::size_t>(tick) % cycle];
      }
    }
}

}  // namespace forceaxis::sim
