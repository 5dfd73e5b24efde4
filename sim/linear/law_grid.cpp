#include "sim/linear/law_grid.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <numbers>
#include <tuple>
#include <utility>

#include "sim/matrix/wide.hpp"

namespace forceaxis::sim {
namespace {

using Complex = std::complex<double>;
using Extended = long double;

// Lowest frequency of a grid in Hz; its highest frequency is half the tick rate.
constexpr double kLowestHz = 0.02;
// Below this frequency a grid has fewer points per decade.
constexpr double kSlowHz = 1.0;
constexpr double kPointsPerDecade = 60, kFastPointsPerDecade = 270;
// Number of grid points on each side of a resonance, and distance of the farthest point in
// half-widths of the resonance.
constexpr double kPointsPerSide = 42;
constexpr Extended kFarthestHalfWidths = 25;
constexpr double kDampingMax = 0.3;  // largest damping ratio of a root near which the frequency
                                     // grid must be denser
constexpr double kNone = std::numeric_limits<double>::infinity();
constexpr double kHalfPower = 0.5;     // value of |S|^2 at -3 dB
constexpr double kStableShare = 1e-9;  // smallest damping ratio of a stable pole

// Largest distance of a computed pole from z = 1 that is treated as a rounding error, as a fraction
// of the tick rate.
constexpr double kRounding = 1e-11;
// The bandwidth of a law is computed at this fraction of the largest permitted gain. At the largest
// gain itself the bandwidth would jump if a peak of |S| is close to -3 dB.
constexpr double kGainShare = 0.97;
// The force may leave its permitted band at a ramp of the set-point by a fraction x of the
// set-point. The value of the law is then divided by 1 + kRampWeight x.
constexpr double kRampWeight = 30;

// A point of a frequency grid: its frequency, and its index among the points that all grids have,
// or kOwn.
constexpr std::size_t kOwn = std::numeric_limits<std::size_t>::max();
struct Point {
  double hz;
  std::size_t common = kOwn;
  bool operator<(const Point &other) const { return hz < other.hz; }
  bool operator==(const Point &other) const { return hz == other.hz; }
};

// Makes the frequency grids of all plants with one density of points. What the points that all
// grids have need of trigonometry is computed once.
class GridMaker {
 public:
  // Returns the maker for these arguments. It is made at the first call, and kept.
  static const GridMaker &of(double density, double tick_s, int cycle_ticks) {
    static std::mutex lock;
    static std::map<std::tuple<double, double, int>, GridMaker> makers;
    const std::lock_guard guard(lock);
    return makers.try_emplace({density, tick_s, cycle_ticks}, density, tick_s, cycle_ticks)
        .first->second;
  }

  GridMaker(double density, double tick_s, int cycle_ticks)
      : tick_s_(tick_s), cycle_ticks_(cycle_ticks), cycle_hz_(1 / (tick_s * cycle_ticks)) {
    add_rising(kLowestHz, kSlowHz, density * kPointsPerDecade);
    add_rising(kSlowHz, 0.5 * cycle_hz_, density * kFastPointsPerDecade);
    const auto side = static_cast<int>(std::nearbyint(density * kPointsPerSide));
    const Extended widest = std::asinh(2 * kFarthestHalfWidths);
    for (int i = -side; i <= side; ++i)
      around_.push_back(static_cast<double>(std::sinh(widest * Extended(i) / side) / 2));
    for (int k = 0; k < cycle_ticks; ++k)
      for (const Point &point : common_) common_w_.push_back(tangent(point.hz, k));
  }

  std::vector<Point> grid_of(const ForcePlant &plant) const {
    std::vector<Point> grid = common_;
    for (const auto *roots : {&plant.poles(), &plant.zeros()})
      for (const Complex root : *roots)
        if (is_light(root)) add_around(grid, root);
    std::sort(grid.begin(), grid.end());
    grid.erase(std::unique(grid.begin(), grid.end()), grid.end());
    return grid;
  }

  // Returns w = tan(pi f T) at alias frequency k of a point.
  double w_of(const Point &point, int k) const {
    return point.common == kOwn ? tangent(point.hz, k) : common_w_[index_of(point, k)];
  }

  // Returns the factors of a hold at the alias frequencies of all common points. They are kept for
  // the next plants with this hold.
  std::shared_ptr<const std::vector<Complex>> factors_of(const Hold &hold) const {
    const std::lock_guard guard(lock_);
    for (const auto &[known, factors] : factors_)
      if (known == hold) return factors;
    std::vector<Complex> factors;
    for (const double w : common_w_) factors.push_back(hold.at(w));
    if (factors_.size() == kHoldsMax) factors_.pop_front();
    return factors_.emplace_back(hold, std::make_shared<std::vector<Complex>>(std::move(factors)))
        .second;
  }

  // Returns the index, in the result of factors_of(), of alias frequency k of a common point.
  std::size_t index_of(const Point &point, int k) const {
    return static_cast<std::size_t>(k) * common_.size() + point.common;
  }

 private:
  static constexpr std::size_t kHoldsMax = 8;

  double tangent(double hz, int k) const {
    return tangent_of(k == 0 ? hz : alias_of(hz, k, tick_s_, cycle_ticks_), tick_s_);
  }

  void add_common(Extended hz) { common_.push_back({static_cast<double>(hz), common_.size()}); }

  // Adds frequencies with equal ratios to the points that all grids have.
  void add_rising(Extended low, Extended high, double per_decade) {
    const auto count = static_cast<int>(std::nearbyint(per_decade * std::log10(high / low)));
    const Extended ratio = std::pow(high / low, Extended{1} / (count - 1));
    for (int i = 0; i + 1 < count; ++i, low *= ratio) add_common(low);
    add_common(high);
  }

  static bool is_light(Complex root) {
    return std::isfinite(root.real()) && root.imag() > 0 &&
           std::abs(root.real()) < kDampingMax * std::sqrt(std::norm(root));
  }

  void add_around(std::vector<Point> &grid, Complex root) const {
    double center = root.imag() / (2 * std::numbers::pi);
    // A mode of vibration above half the cycle rate of a bus appears at a lower frequency.
    while (center > cycle_hz_) center -= cycle_hz_;
    center = std::min(center, cycle_hz_ - center);
    const double width = std::max(std::abs(root.real()) / (2 * std::numbers::pi), 1e-5 * center);
    for (const double step : around_) {
      const double hz = center + width * step;
      if (hz >= kLowestHz && hz <= 0.5 * cycle_hz_) grid.push_back({hz});
    }
  }

  double tick_s_;
  int cycle_ticks_;
  double cycle_hz_;  // rate in Hz at which the drive receives commands
  std::vector<Point> common_;
  std::vector<double> common_w_;  // tan(pi f tick_s) of all common points: first at one alias
                                  // frequency, then at the next
  mutable std::mutex lock_;
  mutable std::deque<std::pair<Hold, std::shared_ptr<const std::vector<Complex>>>> factors_;
  std::vector<double> around_;  // distances of the grid points around a resonance from the
                                // resonance, divided by its width
};

// Returns true if a pole of the plant is an integral.
bool integrates(const ForcePlant &plant) {
  const double least = kRounding / plant.tick_s();
  return std::any_of(plant.poles().begin(), plant.poles().end(),
                     [&](Complex pole) { return std::norm(pole) <= least * least; });
}

double logarithm(double value) { return static_cast<double>(std::log(Extended(value))); }

// Returns the frequency between two points at which a level rises to 1. Frequency and level are
// interpolated on logarithmic scales.
double between(double low_hz, double high_hz, double low_level, double high_level) {
  const double low = logarithm(low_level);
  const double span = logarithm(high_level) - low;
  const double share = std::clamp(-low / (span == 0 ? 1.0 : span), 0.0, 1.0);
  return static_cast<double>(low_hz * std::exp(share * std::log(Extended(high_hz) / low_hz)));
}

}  // namespace

// Real and imaginary part of the loop gain L with one delay. With a bus, `square` has |L|^2.
struct LawGrid::Turned {
  std::vector<double> real, imag, square;
};

// The loop gain L at some points of the grid, for a law with the gain 1. The first arrays have the
// real and imaginary part without a delay, |L|^2, and the square of the magnitude of the law
// without its integral part. `turned` has the real and imaginary part with each delay.
//
// Over a bus with a cycle of m ticks, the firmware's code is sampled once in a cycle. Its spectrum
// is the sum over m frequencies (alias_of). Real and imaginary part without a delay and the noise
// then have m values for each point, one frequency after the other, and `turned` has the sums.
struct LawGrid::Loop {
  void resize(std::size_t points, std::size_t delays, std::size_t aliases);

  std::vector<double> real, imag, square, noise;
  std::vector<Turned> turned;  // loop gain with each delay
  Turned apart;                // loop gain with one delay, separately for each alias frequency
};

// The loop gain L with one delay around one plant: real part, imaginary part and |L|^2 at the grid
// frequencies of the plant.
struct LawGrid::Curve {
  std::span<const double> real, imag, square, hz;
};

LawGrid::LawGrid(std::vector<ForcePlant> plants, std::vector<int> delays_ticks, double density)
    : plants_(std::move(plants)),
      delays_(std::move(delays_ticks)),
      tick_s_(plants_.front().tick_s()),
      aliases_(static_cast<std::size_t>(plants_.front().bus().ticks)),
      begin_{0} {
  const GridMaker &maker = GridMaker::of(density, tick_s_, plants_.front().bus().ticks);
  for (const ForcePlant &plant : plants_) {
    const std::vector<Point> grid = maker.grid_of(plant);
    for (const Point &point : grid) hz_.push_back(point.hz);
    for (int k = 0; k < plant.bus().ticks; ++k)
      for (const Point &point : grid) add_frequency(maker.w_of(point, k));
    const std::size_t first = aliases_ * begin_.back();
    const auto w = std::span(w_).subspan(first);
    std::vector<Complex> values(w.size());
    if (const Hold *hold = plant.hold()) {
      const auto factors = maker.factors_of(*hold);
      plant.response(w, values);
      for (std::size_t i = 0; i < values.size(); ++i) {
        const Point &point = grid[i % grid.size()];
        const int k = static_cast<int>(i / grid.size());
        values[i] *= point.common == kOwn ? hold->at(w[i]) : (*factors)[maker.index_of(point, k)];
      }
    } else {
      plant.held_response(w, values);
    }
    for (const Complex value : values) {
      real_.push_back(value.real());
      imag_.push_back(value.imag());
    }
    begin_.push_back(hz_.size());
    integrates_.push_back(integrates(plant));
  }
}

void LawGrid::add_frequency(double w) {
  w_.push_back(w);
  // The point on the unit circle is z = (1 + j w) / (1 - j w).
  const double scale = 1 / (1 + w * w);
  cosine_.push_back((1 - w * w) * scale);
  sine_.push_back(2 * w * scale);
}

std::span<const double> LawGrid::frequency_hz(std::size_t plant) const {
  return std::span(hz_).subspan(begin_[plant], begin_[plant + 1] - begin_[plant]);
}

std::vector<Complex> LawGrid::response(std::size_t plant) const {
  const std::size_t count = begin_[plant + 1] - begin_[plant];
  const std::size_t first = aliases_ * begin_[plant];
  std::vector<Complex> values(count);
  for (std::size_t i = 0; i < aliases_ * count; ++i)
    values[i % count] += Complex(real_[first + i], imag_[first + i]);
  return values;
}

namespace {

// Arrays with the grid points of one plant, and arrays for the loop gain that is computed at these
// points.
struct Block {
  std::size_t count;
  const double *w, *plant_re, *plant_im;
  double *re, *im, *square, *noise;
};

[[gnu::always_inline]] inline void compute_block(const LawShape &law, double tick_s, Block b) {
  for (std::size_t i = 0; i < b.count; ++i) {
    b.re[i] = b.plant_re[i];
    b.im[i] = b.plant_im[i];
    b.noise[i] = 1.0;
  }
  for (const LawSection s : law.sections)
    for (std::size_t i = 0; i < b.count; ++i) {
      const double w2 = b.w[i] * b.w[i];
      const double n_re = s.n0 - s.n2 * w2;
      const double n_im = s.n1 * b.w[i];
      const double d_re = s.d0 - s.d2 * w2;
      const double d_im = s.d1 * b.w[i];
      const double scale = 1 / (d_re * d_re + d_im * d_im);
      const double h_re = (n_re * d_re + n_im * d_im) * scale;
      const double h_im = (n_im * d_re - n_re * d_im) * scale;
      const double before = b.re[i];
      b.re[i] = before * h_re - b.im[i] * h_im;
      b.im[i] = before * h_im + b.im[i] * h_re;
      b.noise[i] *= (n_re * n_re + n_im * n_im) * scale;
    }
  const double rate = law.integral_rad_per_s * tick_s / 2;
  const double whole = 1 + rate;
  for (std::size_t i = 0; i < b.count; ++i) {
    const double turn = -rate / b.w[i];
    const double before = b.re[i];
    b.re[i] = before * whole - b.im[i] * turn;
    b.im[i] = before * turn + b.im[i] * whole;
    b.square[i] = b.re[i] * b.re[i] + b.im[i] * b.im[i];
  }
}

FORCEAXIS_WIDE void compute_wide(const LawShape &law, double tick_s, const Block &block) {
  compute_block(law, tick_s, block);
}

void compute_narrow(const LawShape &law, double tick_s, const Block &block) {
  compute_block(law, tick_s, block);
}

// Arrays with the grid points of one plant, and arrays with the loop gain that is multiplied by 1/z
// = cosine - j sine.
struct Turn {
  std::size_t count;
  const double *cosine, *sine;
  double *re, *im;
};

[[gnu::always_inline]] inline void delay_block(const Turn &t) {
  for (std::size_t i = 0; i < t.count; ++i) {
    const double before = t.re[i];
    t.re[i] = before * t.cosine[i] + t.im[i] * t.sine[i];
    t.im[i] = t.im[i] * t.cosine[i] - before * t.sine[i];
  }
}

FORCEAXIS_WIDE void delay_wide(const Turn &turn) { delay_block(turn); }
void delay_narrow(const Turn &turn) { delay_block(turn); }

}  // namespace

void LawGrid::Loop::resize(std::size_t points, std::size_t delays, std::size_t aliases) {
  for (auto *values : {&real, &imag, &square, &noise, &apart.real, &apart.imag})
    values->resize(aliases * points);
  turned.resize(delays);
  for (auto &one : turned)
    for (auto *values : {&one.real, &one.imag, &one.square}) values->resize(points);
}

// Computes the loops with all delays around one plant. The points of `loop` begin at the point
// `first` of the grid.
void LawGrid::compute(const LawShape &law, std::size_t plant, std::size_t first, Loop &loop) const {
  const std::size_t begin = aliases_ * begin_[plant];
  const std::size_t at = begin - aliases_ * first;
  const std::size_t points = begin_[plant + 1] - begin_[plant];
  const std::size_t count = aliases_ * points;
  const Block block{count,          &w_[begin],     &real_[begin],    &imag_[begin],
                    &loop.real[at], &loop.imag[at], &loop.square[at], &loop.noise[at]};
  (kWide ? compute_wide : compute_narrow)(law, tick_s_, block);
  for (std::size_t d = 0; d < delays_.size(); ++d) {
    auto &[real, imag, square] = aliases_ == 1 ? loop.turned[d] : loop.apart;
    std::copy_n(&loop.real[at], count, &real[at]);
    std::copy_n(&loop.imag[at], count, &imag[at]);
    const Turn turn{count, &cosine_[begin], &sine_[begin], &real[at], &imag[at]};
    for (int tick = 0; tick < delays_[d]; ++tick) (kWide ? delay_wide : delay_narrow)(turn);
    if (aliases_ > 1) add_aliases(loop.apart, at, loop.turned[d], begin_[plant] - first, points);
  }
}

// Adds the loop gains at all alias frequencies of a loop over a bus. `at` is the index of the first
// point in `apart`, and `to` its index in `sum`.
void LawGrid::add_aliases(const Turned &apart, std::size_t at, Turned &sum, std::size_t to,
                          std::size_t points) const {
  for (std::size_t i = 0; i < points; ++i) {
    double real = 0;
    double imag = 0;
    for (std::size_t k = 0; k < aliases_; ++k) {
      real += apart.real[at + k * points + i];
      imag += apart.imag[at + k * points + i];
    }
    sum.real[to + i] = real;
    sum.imag[to + i] = imag;
    sum.square[to + i] = real * real + imag * imag;
  }
}

// Returns the loop gain around one plant. The points of `loop` begin at the point `first` of the
// grid.
LawGrid::Curve LawGrid::curve(const Loop &loop, std::size_t first, std::size_t plant,
                              std::size_t delay) const {
  const auto part = [&](const std::vector<double> &values, std::size_t begin) {
    return std::span(values).subspan(begin_[plant] - begin, begin_[plant + 1] - begin_[plant]);
  };
  const auto &[real, imag, square] = loop.turned[delay];
  const auto &size = aliases_ == 1 ? loop.square : square;
  return {part(real, first), part(imag, first), part(size, first), part(hz_, 0)};
}

namespace {

// The largest of some positive values, and the index of this value. A search for a larger value
// begins with the value that is known.
struct Largest {
  double value = 0.0;
  std::size_t at = kNowhere;
  static constexpr std::size_t kNowhere = static_cast<std::size_t>(-1);

  void add(double other, std::size_t index) {
    if (other > value) {
      value = other;
      at = index;
    }
  }
};

// A vector of two doubles, which may be at any address.
using Pair [[gnu::vector_size(16), gnu::aligned(8), gnu::may_alias]] = double;

const Pair &pair(const double *values) { return *reinterpret_cast<const Pair *>(values); }
Pair larger(Pair a, Pair b) { return a > b ? a : b; }

// Calls visit(i) for the points at which the value excess(i) may be positive. excess(i) computes
// the values of the points i and i + 1.
template <typename Excess, typename Visit>
void where_positive(std::size_t count, const Excess &excess, const Visit &visit) {
  std::size_t i = 0;
  for (; i + 4 <= count; i += 4) {
    const Pair most = larger(excess(i), excess(i + 2));
    if (most[0] > 0 || most[1] > 0)
      for (std::size_t k = i; k < i + 4; ++k) visit(k);
  }
  for (; i < count; ++i) visit(i);
}

// Searches the largest value 1/g over the points of the grid. At each point, g is the smallest
// positive solution of 1 + 2 g real + g^2 share q = 0 with q = |L|^2. With the gain share g, the
// loop is on its bound: |1 + g share L|^2 = 1 - share.
void first_root(std::span<const double> real, std::span<const double> square, double share,
                Largest &found) {
  const double *const re = real.data();
  const double *const q = square.data();
  // The value 1/g is ahead + sqrt(ahead^2 - share q) with ahead = -real. It exceeds the value v
  // only if ahead > v or ahead^2 - share q > (v - ahead)^2.
  const auto excess = [&](std::size_t i) -> Pair {
    const double v = found.value;
    const Pair ahead = -pair(re + i);
    return larger(ahead - v, ahead * (2 * v) - pair(q + i) * share - v * v);
  };
  where_positive(real.size(), excess, [&](std::size_t i) {
    const double ahead = -re[i];
    const double root = ahead * ahead - share * q[i];
    if (ahead > 0 && root >= 0) found.add(ahead + std::sqrt(root), i);
  });
}

// Searches the largest distance from 0 at which a curve crosses the negative real axis, or at which
// the curve ends left of 0.
void axis_crossing(std::span<const double> real, std::span<const double> imag, Largest &found) {
  const std::size_t last = real.size() - 1;
  const double *const re = real.data();
  const double *const im = imag.data();
  // A crossing lies between two points, so one of these points is at least as far from 0 as the
  // crossing.
  const auto excess = [&](std::size_t i) -> Pair {
    return larger(-pair(re + i), -pair(re + i + 1)) - found.value;
  };
  where_positive(last, excess, [&](std::size_t i) {
    if (im[i] * im[i + 1] < 0 && re[i] < 0 && re[i + 1] < 0)
      found.add(-(re[i] + (re[i + 1] - re[i]) * im[i] / (im[i] - im[i + 1])), i);
  });
  found.add(-re[last], last);
}

// Searches the largest |L| among the points whose phase differs from -180 degrees by less than the
// phase margin.
void within_phase(std::span<const double> real, std::span<const double> square, double margin_deg,
                  Largest &found) {
  const auto cosine =
      static_cast<double>(std::cos(std::numbers::pi_v<Extended> / 180 * margin_deg));
  for (std::size_t i = 0; i < real.size(); ++i) {
    const double size = std::sqrt(square[i]);
    if (-real[i] > cosine * size) found.add(size, i);
  }
}

}  // namespace

double LawGrid::noise_gain(const LawShape &law) const {
  double most = 0.0;
  Loop loop = loop_of_one();
  for (std::size_t p = 0; p < plants_.size(); ++p) {
    compute(law, p, begin_[p], loop);
    for (std::size_t i = 0; i < aliases_ * (begin_[p + 1] - begin_[p]); ++i)
      most = std::max(most, loop.noise[i]);
  }
  return std::sqrt(most);
}

// Returns a Loop with arrays that are large enough for the plant with the most points.
LawGrid::Loop LawGrid::loop_of_one() const {
  std::size_t most = 0;
  for (std::size_t p = 0; p < plants_.size(); ++p) most = std::max(most, begin_[p + 1] - begin_[p]);
  Loop loop;
  loop.resize(most, delays_.size(), aliases_);
  return loop;
}

namespace {

// The range of low frequencies, from 0 on, in which the gain of a loop with two integrals is close
// to -1 at some gain of the law.
struct LowEnd {
  std::size_t points = 0;  // number of points of the frequency grid that belong to the low range
  double least_gain = 0;  // above this gain, |S| is within its bound at all points of the low range
                          // of frequencies
};

// `share` has the same meaning as in first_root(). A loop whose phase begins below -180 degrees is
// unstable at every gain at which it does not cross the negative real axis.
LowEnd low_end(std::span<const double> real, std::span<const double> imag,
               std::span<const double> square, double share) {
  LowEnd end;
  if (!(imag[0] < 0)) end.least_gain = kNone;
  for (; end.points < real.size(); ++end.points) {
    const double ahead = -real[end.points];
    const double root = ahead * ahead - share * square[end.points];
    if (!(ahead > 0 && root >= 0)) break;
    end.least_gain = std::max(end.least_gain, share / (ahead - std::sqrt(root)));
  }
  return end;
}

}  // namespace

// Reduces a limit to the largest gain that the bounds permit for one loop. If plant and law have an
// integral each, the phase at low frequency is close to -180 degrees, and |L| is large there at
// every useful gain. At these frequencies, the bound of |S| gives a smallest permitted gain.
void LawGrid::reduce(GainLimit &limit, const LawShape &law, const Curve &curve, std::size_t plant,
                     std::size_t delay, const LawBounds &bounds) const {
  // `search` looks for a value that is larger than the value of the present limit.
  const auto add = [&](GainLimit::Bound bound, double factor, const auto &search) {
    Largest found{factor / limit.gain};
    search(found);
    if (found.at != Largest::kNowhere)
      limit = {factor / found.value, bound, plant, delay, curve.hz[found.at], limit.least};
  };
  const double share = 1 - 1 / (bounds.ms[delay] * bounds.ms[delay]);
  std::size_t from = 0;
  if (law.integral_rad_per_s > 0 && integrates_[plant]) {
    const LowEnd end = low_end(curve.real, curve.imag, curve.square, share);
    from = end.points;
    limit.least = std::max(limit.least, end.least_gain);
  }
  const auto real = curve.real.subspan(from);
  const auto square = curve.square.subspan(from);
  add(GainLimit::Bound::ms, share, [&](Largest &found) {
    first_root(real, square, share, found);
    if (found.at != Largest::kNowhere) found.at += from;
  });
  add(GainLimit::Bound::gm, 1 / bounds.gain_margin,
      [&](Largest &found) { axis_crossing(curve.real, curve.imag, found); });
  if (bounds.phase_margin_deg > 0)
    add(GainLimit::Bound::pm, 1.0, [&](Largest &found) {
      within_phase(real, square, bounds.phase_margin_deg, found);
      if (found.at != Largest::kNowhere) found.at += from;
    });
}

// Returns the largest permitted gain of each plant alone.
std::vector<GainLimit> LawGrid::limits(const LawShape &law, double hf_gain,
                                       const LawBounds &bounds) const {
  GainLimit free;
  free.gain = bounds.hf_gain / hf_gain;
  std::vector<GainLimit> found(plants_.size(), free);
  Loop loop = loop_of_one();
  for (std::size_t p = 0; p < plants_.size(); ++p) {
    compute(law, p, begin_[p], loop);
    for (std::size_t d = 0; d < delays_.size(); ++d)
      reduce(found[p], law, curve(loop, begin_[p], p, d), p, d, bounds);
    if (found[p].gain < found[p].least) found[p].gain = 0;
  }
  return found;
}

GainLimit LawGrid::largest_gain(const LawShape &law, double hf_gain,
                                const LawBounds &bounds) const {
  const auto all = limits(law, hf_gain, bounds);
  GainLimit smallest =
      *std::min_element(all.begin(), all.end(),
                        [](const GainLimit &a, const GainLimit &b) { return a.gain < b.gain; });
  for (const GainLimit &one : all) smallest.least = std::max(smallest.least, one.least);
  if (smallest.gain < smallest.least) smallest.gain = 0;
  return smallest;
}

namespace {

// Returns |1 + g L|^2 for the gain g.
double apart(double gain, double real, double square) {
  return 1 + 2 * gain * real + gain * gain * square;
}

// Returns the first frequency at which past(i) is true. The result is 0 if past(0) is true, and the
// last frequency if past(i) is true at no point. The result is interpolated to the frequency at
// which level(i) is 1, where past(i) means a level above 1. The search ends at the frequency
// `most`, and the result does not exceed `most`.
template <typename Past, typename Level>
double first_past(std::span<const double> hz, double most, const Past &past, const Level &level) {
  if (past(0)) return 0.0;
  for (std::size_t i = 1; i < hz.size() && hz[i - 1] < most; ++i)
    if (past(i)) return std::min(most, between(hz[i - 1], hz[i], level(i - 1), level(i)));
  return std::min(most, hz.back());
}

// The following two functions return the first frequency at which |S| rises above -3 dB, and the
// first frequency at which |T| falls below -3 dB.
double bandwidth_of(std::span<const double> re, std::span<const double> q,
                    std::span<const double> hz, double gain, double most) {
  return first_past(
      hz, most, [&](std::size_t i) { return kHalfPower * apart(gain, re[i], q[i]) <= 1; },
      [&](std::size_t i) { return 1 / (kHalfPower * apart(gain, re[i], q[i])); });
}

double fall_of(std::span<const double> re, std::span<const double> q, std::span<const double> hz,
               double gain, double most) {
  return first_past(
      hz, most,
      [&](std::size_t i) { return kHalfPower * apart(gain, re[i], q[i]) >= gain * gain * q[i]; },
      [&](std::size_t i) { return kHalfPower * apart(gain, re[i], q[i]) / (gain * gain * q[i]); });
}

// Returns the last frequency at which |T| falls below -3 dB, or 0 if |T| is never above -3 dB.
double last_fall_of(std::span<const double> re, std::span<const double> q,
                    std::span<const double> hz, double gain) {
  const auto level = [&](std::size_t i) {
    return gain * gain * q[i] / (kHalfPower * apart(gain, re[i], q[i]));
  };
  std::size_t i = hz.size();
  while (i > 0 && level(i - 1) < 1) --i;
  if (i == 0) return 0.0;
  return i == hz.size() ? hz[i - 1] : between(hz[i - 1], hz[i], 1 / level(i - 1), 1 / level(i));
}

// Returns the smallest factor by which the gain may rise until the curve of the loop gain crosses
// -1.
double gain_margin_of(std::span<const double> re, std::span<const double> im, double gain) {
  double least = kNone;
  const auto add = [&](double real) {
    if (real < 0 && real > -1) least = std::min(least, -1 / real);
  };
  const std::size_t last = re.size() - 1;
  for (std::size_t i = 0; i < last; ++i)
    if (im[i] * im[i + 1] < 0 && re[i] < 0)
      add(gain * (re[i] + (re[i + 1] - re[i]) * im[i] / (im[i] - im[i + 1])));
  add(gain * re[last]);
  return least;
}

// Returns the smallest magnitude of the phase margin in rad.
double phase_margin_of(std::span<const double> re, std::span<const double> im,
                       std::span<const double> q, double gain) {
  double least = kNone;
  for (std::size_t i = 0; i + 1 < re.size(); ++i) {
    const double size = gain * gain * q[i];
    const double next = gain * gain * q[i + 1];
    if ((size - 1) * (next - 1) >= 0) continue;
    const double share = logarithm(size) / (logarithm(size) - logarithm(next));
    const Extended real = re[i] * (1 - share) + re[i + 1] * share;
    const Extended imag = im[i] * (1 - share) + im[i + 1] * share;
    least = std::min(least, static_cast<double>(std::abs(std::atan2(-imag, -real))));
  }
  return least;
}

}  // namespace

std::vector<LoopFigures> LawGrid::figures(const LawShape &law, double gain) const {
  std::vector<LoopFigures> all;
  Loop loop = loop_of_one();
  for (std::size_t p = 0; p < plants_.size(); ++p) {
    compute(law, p, begin_[p], loop);
    for (std::size_t d = 0; d < delays_.size(); ++d) {
      const auto [re, im, q, hz] = curve(loop, begin_[p], p, d);
      double least = kNone;
      for (std::size_t i = 0; i < hz.size(); ++i) least = std::min(least, apart(gain, re[i], q[i]));
      all.push_back({bandwidth_of(re, q, hz, gain, kNone), last_fall_of(re, q, hz, gain),
                     1 / std::sqrt(least), gain_margin_of(re, im, gain),
                     phase_margin_of(re, im, q, gain)});
    }
  }
  return all;
}

// Computes the gain of one loop at any frequency, also between the points of the grid.
class LawGrid::Sight {
 public:
  Sight(const ForcePlant &plant, const LawShape &law, double gain, int delay_ticks)
      : plant_(plant), law_(law), gain_(gain), delay_ticks_(delay_ticks) {}

  Complex at(double hz) const {
    const BusCycle &bus = plant_.bus();
    const auto aliases = static_cast<std::size_t>(bus.ticks);
    std::vector<double> w(aliases);
    std::vector<Complex> values(aliases);
    for (int k = 0; k < bus.ticks; ++k)
      w[static_cast<std::size_t>(k)] =
          tangent_of(alias_of(hz, k, plant_.tick_s(), bus.ticks), plant_.tick_s());
    plant_.held_response(w, values);
    Complex sum = 0;
    for (std::size_t k = 0; k < aliases; ++k) {
      values[k] *= gain_ * law_.at(w[k], plant_.tick_s());
      for (int tick = 0; tick < delay_ticks_; ++tick)
        values[k] *= Complex(1, -w[k]) / Complex(1, w[k]);
      sum += values[k];
    }
    return sum;
  }
  double apart(double hz) const { return std::norm(1.0 + at(hz)); }
  // Returns the loop gain at frequency 0 without the integral of the law.
  double at_rest() const {
    const std::array<double, 1> w{0.0};
    std::array<Complex, 1> value;
    plant_.response(w, value);
    double rest = gain_ * value[0].real();
    for (const LawSection &s : law_.sections) rest *= s.n0 / s.d0;
    return rest;
  }

 private:
  const ForcePlant &plant_;
  const LawShape &law_;
  double gain_;
  int delay_ticks_;
};

namespace {

constexpr int kStepsMax = 100;

// Returns the frequency at which `value` changes its sign between two frequencies, by the method of
// Anderson and Bjorck.
template <typename Value>
double root_between(double low, double high, const Value &value) {
  double a = value(low);
  double b = value(high);
  for (int step = 0; step < kStepsMax && high - low > 1e-14 * high && a != 0; ++step) {
    double next = low - a * (high - low) / (b - a);
    if (!(next > low && next < high)) next = (low + high) / 2;
    const double c = value(next);
    if (c == 0) return next;
    if ((c < 0) == (b < 0)) {
      const double factor = 1 - c / b;
      a *= factor > 0 ? factor : 0.5;
      high = next;
      b = c;
    } else {
      const double factor = 1 - c / a;
      b *= factor > 0 ? factor : 0.5;
      low = next;
      a = c;
    }
  }
  return std::abs(a) < std::abs(b) ? low : high;
}

// Returns the smallest value between two frequencies, by golden sections of the logarithm of the
// frequency. Near a minimum the value has twice as many digits as the frequency.
template <typename Value>
double least_between(double low, double high, const Value &value) {
  constexpr double kGolden = 0.6180339887498949;
  double inner = high - kGolden * (high - low);
  double outer = low + kGolden * (high - low);
  double at_inner = value(inner);
  double at_outer = value(outer);
  while (high - low > 1e-6 * high) {
    if (at_inner < at_outer) {
      high = outer;
      outer = inner;
      at_outer = at_inner;
      inner = high - kGolden * (high - low);
      at_inner = value(inner);
    } else {
      low = inner;
      inner = outer;
      at_inner = at_outer;
      outer = low + kGolden * (high - low);
      at_outer = value(outer);
    }
  }
  return std::min(at_inner, at_outer);
}

// A grid point whose value differs from the best one by less than this fraction may be next to the
// best value between the grid points.
constexpr double kCloseShare = 0.03;

// Returns true if all poles of the plant are stable. One pole at 0 is permitted if `integral` is
// true.
bool surely_stable(const ForcePlant &plant, bool integral) {
  const double least = kRounding / plant.tick_s();
  const auto others = std::count_if(plant.poles().begin(), plant.poles().end(), [&](Complex pole) {
    return !(pole.real() < -kStableShare * std::sqrt(std::norm(pole)) - least);
  });
  return others == (integral ? 1 : 0);
}

// Returns true if the law is stable. The polynomial d0 + d1 s + d2 s^2 of a stable section has
// coefficients of the same sign.
bool surely_stable(const LawShape &law) {
  return law.integral_rad_per_s >= 0 &&
         std::all_of(law.sections.begin(), law.sections.end(), [](const LawSection &s) {
           const double square = s.d0 * s.d2;
           return square > 0 && s.d1 * s.d0 > kStableShare * std::abs(s.d0) * std::sqrt(square);
         });
}

// Returns the gain of a loop at frequency 0. `rest` is this gain without the law's integral. With
// an integral in the law, the result is infinity if `rest` is positive, and NaN otherwise.
double gain_at_rest(const LawShape &law, double rest) {
  if (!(law.integral_rad_per_s > 0)) return rest;
  return rest > 0 ? kNone : std::numeric_limits<double>::quiet_NaN();
}

// Numbers of poles and zeros of a plant whose frequencies are below the grid.
struct SlowRoots {
  std::size_t poles = 0;  // number of real poles
  std::size_t zeros = 0;
  // Number of pairs of a pole and a zero that are stable and real and differ by at most 1 %. The
  // creep of a sensor has such a pair. Below the grid, a pair changes the loop by at most 1 % and
  // turns it by less than 0.3 degrees, both monotonically; within the grid it is included in the
  // response.
  std::size_t pairs = 0;
};

SlowRoots slow_roots(const ForcePlant &plant) {
  constexpr double kLowest = 2 * std::numbers::pi * kLowestHz;
  constexpr double kPairShare = 0.01;
  const auto below = [](const std::vector<Complex> &roots) {
    std::vector<Complex> slow;
    for (const Complex root : roots)
      if (std::norm(root) < kLowest * kLowest) slow.push_back(root);
    return slow;
  };
  std::vector<Complex> poles = below(plant.poles());
  SlowRoots found;
  for (const Complex zero : below(plant.zeros())) {
    const auto pair = std::find_if(poles.begin(), poles.end(), [&](Complex pole) {
      return pole.imag() == 0 && zero.imag() == 0 && pole.real() < 0 &&
             std::abs(zero.real() - pole.real()) <= kPairShare * -pole.real();
    });
    if (pair == poles.end()) {
      ++found.zeros;
    } else {
      ++found.pairs;
      poles.erase(pair);
    }
  }
  found.poles = poles.size();
  return found;
}

// Returns true if the loop around a plant with an integral begins at -90 degrees, or just above
// -180 degrees if the law has an integral too. `real` and `imag` are the loop gain at the lowest
// frequency of the grid. Below this frequency, two integrals and a pair of SlowRoots may have a
// phase below -180 degrees. If the gain of the loop is above 1 there, this does not make the loop
// unstable.
//
// A plant with one stable real pole below the grid in place of an integral turns the loop by less
// than 90 degrees there. With an integral in the law, the loop then stays above -180 degrees.
bool begins_stable(const LawShape &law, const SlowRoots &slow, bool integral, double real,
                   double imag) {
  if (!integral) return slow.poles == 0 || (imag < 0 && slow.pairs == 0);
  return imag < 0 && (law.integral_rad_per_s <= 0 || real < (slow.pairs > 0 ? -1 : 0));
}

// Returns true if a pole or zero of the plant or of the law may have a frequency below the grid,
// except one pole of the plant: an integral, or see begins_stable().
bool is_slow(const SlowRoots &slow, const ForcePlant &plant, const LawShape &law) {
  const double w = tangent_of(kLowestHz, plant.tick_s());
  const auto has_low_root = [w](double c0, double c1, double c2) {
    return std::abs(c0) < w * std::max(std::abs(c1), w * std::abs(c2));
  };
  return slow.poles > 1U || slow.zeros > 0 ||
         std::any_of(law.sections.begin(), law.sections.end(), [&](const LawSection &s) {
           return has_low_root(s.n0, s.n1, s.n2) || has_low_root(s.d0, s.d1, s.d2);
         });
}

// Returns true if the grid shows all of the loop, and the loop is stable at small gains.
bool is_known(const SlowRoots &slow, const ForcePlant &plant, const LawShape &law, bool integral) {
  return surely_stable(plant, integral) && surely_stable(law) && !is_slow(slow, plant, law);
}

}  // namespace

// Each method computes one figure of a loop, beginning with the values at the points of the grid.
class LawGrid::Precise {
 public:
  // `at_rest` is the gain of the loop at frequency 0, which is infinite with an integral.
  Precise(const Curve &curve, const Sight &sight, double gain, double at_rest)
      : curve_(curve), sight_(sight), gain_(gain), rest_(at_rest), last_(curve.hz.size() - 1) {}

  // Returns true if |S| or |T| passes -3 dB at a frequency below the grid.
  bool passes_below() const {
    const bool open = !std::isinf(rest_);
    const bool far = !open || (1 + rest_) * (1 + rest_) * kHalfPower > 1;
    const bool whole = !open || rest_ * rest_ >= kHalfPower * (1 + rest_) * (1 + rest_);
    return far != (size(0) * kHalfPower > 1) || whole != (below(0) <= 0);
  }

  // Returns the largest distance from 0 at which the curve of the loop gain crosses the negative
  // real axis.
  double axis_distance() const {
    const auto [re, im, q, hz] = curve_;
    double most = std::max(-rest_, -gain_ * re[last_]);
    for (std::size_t i = 0; i < last_; ++i) {
      if (im[i] * im[i + 1] >= 0 || re[i] + re[i + 1] >= 0) continue;
      if (gain_ * std::max(-re[i], -re[i + 1]) < (1 - kCloseShare) * most) continue;
      const double at = root(i, [&](double f) { return sight_.at(f).imag(); });
      most = std::max(most, -sight_.at(at).real());
    }
    return most;
  }

  double fS_hz() const {
    if (size(0) * kHalfPower <= 1) return 0.0;
    for (std::size_t i = 0; i < last_; ++i)
      if (size(i + 1) * kHalfPower <= 1)
        return root(i, [&](double f) { return 1 / kHalfPower - sight_.apart(f); });
    return kNone;
  }

  double first_fall_hz() const {
    if (below(0) > 0) return 0.0;
    for (std::size_t i = 0; i < last_; ++i)
      if (below(i + 1) > 0) return fall(i);
    return kNone;
  }

  double last_fall_hz() const {
    if (below(last_) <= 0) return kNone;
    for (std::size_t i = last_; i-- > 0;)
      if (below(i) <= 0) return fall(i);
    return 0.0;
  }

  double ms() const {
    double least = kNone;
    for (std::size_t i = 0; i <= last_; ++i) least = std::min(least, size(i));
    const double close = (1 + kCloseShare) * least;
    for (std::size_t i = 0; i <= last_; ++i) {
      const std::size_t before = i > 0 ? i - 1 : 0;
      const std::size_t after = std::min(i + 1, last_);
      if (size(i) > close || size(before) < size(i) || size(after) < size(i)) continue;
      least = std::min(least, least_between(curve_.hz[before], curve_.hz[after],
                                            [&](double f) { return sight_.apart(f); }));
    }
    return 1 / std::sqrt(least);
  }

  double phase_margin_rad() const {
    double least = kNone;
    const double level = 1 / (gain_ * gain_);
    for (std::size_t i = 0; i < last_; ++i) {
      if ((curve_.square[i] < level) == (curve_.square[i + 1] < level)) continue;
      const Complex at = sight_.at(root(i, [&](double f) { return std::norm(sight_.at(f)) - 1; }));
      const Extended angle = std::atan2(Extended{-at.imag()}, Extended{-at.real()});
      least = std::min(least, static_cast<double>(std::abs(angle)));
    }
    return least;
  }

 private:
  double size(std::size_t i) const { return apart(gain_, curve_.real[i], curve_.square[i]); }
  // Returns a value that is positive where |T| is below -3 dB.
  double below(std::size_t i) const {
    return kHalfPower * size(i) - gain_ * gain_ * curve_.square[i];
  }
  double fall(std::size_t i) const {
    return root(i,
                [&](double f) { return kHalfPower * sight_.apart(f) - std::norm(sight_.at(f)); });
  }
  template <typename Value>
  double root(std::size_t i, const Value &value) const {
    return root_between(curve_.hz[i], curve_.hz[i + 1], value);
  }

  const Curve &curve_;
  const Sight &sight_;
  double gain_, rest_;
  std::size_t last_;
};

PreciseFigures LawGrid::precise(const LawShape &law, double gain, std::size_t plant,
                                std::size_t delay) const {
  const ForcePlant &own = plants_[plant];
  const Sight sight(own, law, gain, delays_[delay]);
  const bool integral = integrates_[plant];
  const SlowRoots slow = slow_roots(own);
  if (!(gain > 0) || !is_known(slow, own, law, integral)) return {};
  const double rest = gain_at_rest(law, integral ? kNone : sight.at_rest());
  if (std::isnan(rest)) return {};
  Loop loop = loop_of_one();
  compute(law, plant, begin_[plant], loop);
  const Curve part = curve(loop, begin_[plant], plant, delay);
  if (!begins_stable(law, slow, integral, gain * part.real[0], gain * part.imag[0])) return {};
  const Precise precise(part, sight, gain, rest);
  const double axis = precise.axis_distance();
  if (!(axis < 1) || precise.passes_below()) return {};
  const double fS_hz = precise.fS_hz();
  return {true,
          fS_hz,
          precise.last_fall_hz(),
          precise.ms(),
          axis > 0 ? 1 / axis : kNone,
          precise.phase_margin_rad(),
          precise.first_fall_hz() < (fS_hz > 0 ? fS_hz : kNone)};
}

namespace {

// Returns the value of a law. The value is 0 if one plant needs a larger gain than another plant
// permits.
LawValue value_of(const GainLimit &limit, double hz) {
  return kGainShare * limit.gain < limit.least ? LawValue{0, 0} : LawValue{hz, limit.gain};
}

}  // namespace

LawValue LawGrid::evaluate(const LawShape &law, const LawBounds &bounds, const RampResponse *ramp,
                           double floor_hz) const {
  thread_local Loop loop;  // memory of about 100 kB for each thread; all later calls reuse it
  loop.resize(hz_.size(), delays_.size(), aliases_);
  GainLimit limit;
  limit.gain = bounds.hf_gain / law.hf_gain();
  double hz = kNone;
  const auto narrow = [&](std::size_t p) {
    const double gain = kGainShare * limit.gain;
    for (std::size_t d = 0; d < delays_.size(); ++d) {
      const Curve one = curve(loop, 0, p, d);
      hz = bandwidth_of(one.real, one.square, one.hz, gain, hz);
      if (law.integral_rad_per_s > 0) hz = fall_of(one.real, one.square, one.hz, gain, hz);
    }
  };
  const std::size_t first = ends_early_.load(std::memory_order_relaxed);
  for (std::size_t i = 0; i < plants_.size(); ++i) {
    const std::size_t p = i == 0 ? first : i - (i <= first);
    compute(law, p, 0, loop);
    for (std::size_t d = 0; d < delays_.size(); ++d)
      reduce(limit, law, curve(loop, 0, p, d), p, d, bounds);
    // At each frequency, |S| and |T| are within -3 dB only above some gain. The remaining plants
    // can only reduce the gain, so they do not increase the bandwidth.
    if (floor_hz > 0) narrow(p);
    if (hz < floor_hz) {
      ends_early_.store(p, std::memory_order_relaxed);
      return {hz, limit.gain};
    }
  }
  const double noise = *std::max_element(loop.noise.begin(), loop.noise.end());
  limit.gain = std::min(limit.gain, bounds.hf_gain / std::sqrt(noise));
  hz = kNone;
  for (std::size_t p = 0; p < plants_.size(); ++p) narrow(p);
  if (ramp != nullptr && hz >= floor_hz) {
    const double most = floor_hz > 0 ? (hz / floor_hz - 1) / kRampWeight : kNone;
    hz /= 1 + kRampWeight * ramp->excess(law, limit.gain, most);
  }
  return value_of(limit, hz);
}

}  // namespace forceaxis::sim
