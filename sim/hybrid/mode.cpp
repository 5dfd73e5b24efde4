#include "sim/hybrid/mode.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "sim/hybrid/kernel.hpp"

namespace forceaxis::sim {
namespace {

// Highest order of the Taylor series on a part of a tick.
constexpr int kHighestOrder = 13;
// Number of grid parts in one sample of the quiet test.
constexpr std::size_t kFewestParts = 8;
// A mode has a quiet test only if a tick has at most this number of grid parts.
constexpr std::size_t kMostTested = 128;
// Largest number of grid parts; a word of 64 bits has one bit for each.
constexpr std::size_t kMostGrid = 64;
constexpr std::size_t kFastGrid = 8;  // number of grid parts in a mode without a quiet test
constexpr std::size_t kMostTickParts = 1 << 16;
constexpr Extended kTruncation = 0x1p-58L;
// Upper bound of the relative rounding error of a sum of products.
constexpr Extended kRounding = 0x1p-46L;

// Computes the product a b and skips the terms in which an entry of b is 0. Four rows are summed
// together so that the sums stay in registers, because stores in extended precision take most of
// the time.
ExtendedMatrix product(const ExtendedMatrix &a, const ExtendedMatrix &b) {
  ExtendedMatrix c(a.rows(), b.cols());
  struct Factor {
    const Extended *column;  // column of a
    Extended value;
  };
  std::vector<Factor> factors(static_cast<std::size_t>(a.cols()));
  for (Eigen::Index j = 0; j < b.cols(); ++j) {
    std::size_t count = 0;
    for (Eigen::Index k = 0; k < a.cols(); ++k)
      if (b(k, j) != 0) factors[count++] = {a.data() + k * a.rows(), b(k, j)};
    Eigen::Index i = 0;
    for (; i + 4 <= a.rows(); i += 4) {
      Extended sum0 = 0, sum1 = 0, sum2 = 0, sum3 = 0;
      for (std::size_t n = 0; n < count; ++n) {
        const Extended *column = factors[n].column + i;
        const Extended value = factors[n].value;
        sum0 += column[0] * value;
        sum1 += column[1] * value;
        sum2 += column[2] * value;
        sum3 += column[3] * value;
      }
      c(i, j) = sum0;
      c(i + 1, j) = sum1;
      c(i + 2, j) = sum2;
      c(i + 3, j) = sum3;
    }
    for (; i < a.rows(); ++i) {
      Extended sum = 0;
      for (std::size_t n = 0; n < count; ++n) sum += factors[n].column[i] * factors[n].value;
      c(i, j) = sum;
    }
  }
  return c;
}

ExtendedMatrix absolute(const ExtendedMatrix &a) { return a.cwiseAbs(); }

// The influence of each entry of z on each other entry, which is the sum of all W^k with W = |a| /
// rate. `rate` is at least twice the spectral radius of |a| and at least 1. The truncation error of
// a Taylor series is relative to this influence.
struct Influence {
  // Scale of the matrix `a`: a power of two in the unit of the entries of `a`.
  Extended rate = 1;
  ExtendedMatrix sum;
};

Influence influence(const ExtendedMatrix &a) {
  // The matrix |a|^(2^k) is power * 2^exponent. The 2^k-th root of the norm of this matrix is an
  // upper bound of the spectral radius.
  constexpr int kSquarings = 8;
  ExtendedMatrix power = absolute(a);
  long exponent = 0;
  const auto normalize = [&](Extended size) {
    int bits = 0;
    std::frexp(size, &bits);
    power *= std::ldexp(Extended{1}, -bits);
    exponent += bits;
  };
  for (int k = 0; k < kSquarings && power.maxCoeff() > 0; ++k) {
    normalize(power.maxCoeff());
    power = product(power, power);
    exponent *= 2;
  }
  Influence result;
  if (power.maxCoeff() > 0) {
    normalize(power.rowwise().sum().maxCoeff());
    constexpr long kRoot = 1L << kSquarings;
    const long whole = exponent >= 0 ? (exponent + kRoot - 1) / kRoot : -(-exponent / kRoot);
    result.rate = std::max(std::ldexp(Extended{2}, static_cast<int>(whole)), Extended{1});
  }
  // 2^7 terms are sufficient, because the norm of each term is at most half the norm of the
  // previous term, and no path through the states has more steps.
  ExtendedMatrix w = absolute(a) / result.rate;
  result.sum = ExtendedMatrix::Identity(a.rows(), a.cols()) + w;
  for (int k = 1; k < 7; ++k) {
    w = product(w, w);
    result.sum += product(result.sum, w);
  }
  return result;
}

// Computes an upper bound of e^|b| with b = a / parts. The terms |b|^k / k! are summed until every
// entry of the remaining terms is below `accuracy` times the influence; this amount is then added.
// Returns the number of terms after the identity, or 0 if `most` terms are not sufficient.
int absolute_series(const ExtendedMatrix &a, std::size_t parts, const Influence &scale,
                    Extended accuracy, int most, ExtendedMatrix *sum) {
  const ExtendedMatrix size = absolute(a) / static_cast<Extended>(parts);
  const Extended step = scale.rate / static_cast<Extended>(parts);
  *sum = ExtendedMatrix::Identity(a.rows(), a.cols());
  ExtendedMatrix term = *sum;
  for (int k = 1; k <= most; ++k) {
    term = product(size, term) / static_cast<Extended>(k);
    *sum += term;
    // By |b| = step W, and because W times the influence is at most the influence, the terms
    // decrease fast. If term k is below e times the influence, term k + 1 is below e times the
    // influence times step / (k + 1), term k + 2 is below e times the influence times step^2 / ((k
    // + 1) (k + 2)), and so on.
    if (2 * step > static_cast<Extended>(k + 1)) continue;
    if ((term.array() <= accuracy * scale.sum.array()).all()) {
      *sum += accuracy * scale.sum;
      return k;
    }
  }
  return 0;
}

ExtendedMatrix series(const ExtendedMatrix &b, int terms) {
  ExtendedMatrix sum = ExtendedMatrix::Identity(b.rows(), b.cols());
  ExtendedMatrix term = sum;
  std::vector<ExtendedMatrix> all;
  for (int k = 1; k <= terms; ++k) {
    term = product(b, term) / static_cast<Extended>(k);
    all.push_back(term);
  }
  // The terms are added from the smallest to the largest.
  ExtendedMatrix tail = ExtendedMatrix::Zero(b.rows(), b.cols());
  for (auto it = all.rbegin(); it != all.rend(); ++it) tail += *it;
  return sum + tail;
}

void put_rows(const ExtendedMatrix &rows, std::vector<double> *out) {
  for (Eigen::Index i = 0; i < rows.rows(); ++i)
    for (Eigen::Index j = 0; j < rows.cols(); ++j) out->push_back(static_cast<double>(rows(i, j)));
}

// Copies `rows` into a matrix that is stored by columns. The first row is copied to the row
// `first`.
void put_block(const ExtendedMatrix &rows, std::size_t first, std::size_t stride,
               kernel::Vector *out, std::size_t offset = 0) {
  for (Eigen::Index j = 0; j < rows.cols(); ++j)
    for (Eigen::Index i = 0; i < rows.rows(); ++i)
      (*out)[offset + static_cast<std::size_t>(j) * stride + first + static_cast<std::size_t>(i)] =
          static_cast<double>(rows(i, j));
}

Extended tick_s(const ModeCache &cache) {
  return 1.0L / (static_cast<Extended>(kTickRateHz) * static_cast<Extended>(cache.parts()));
}

ExtendedMatrix square_flow(const ModeCache &cache, const ModeEquations &equations) {
  const Eigen::Index n = equations.flow.rows();
  ExtendedMatrix a = ExtendedMatrix::Zero(n + 2, n + 2);
  a.topRows(n) = equations.flow * tick_s(cache);
  return a;
}

// Computes the flow matrix at every point of the grid. Computes the quiet test on the larger
// samples from these matrices.
void add_grid(Mode &mode, const ExtendedMatrix &part_flow, int order, const ExtendedMatrix &growth,
              const ExtendedMatrix &a, const ExtendedMatrix &r, const ExtendedMatrix &sensor) {
  const auto n = static_cast<Eigen::Index>(mode.states);
  const auto c = static_cast<Eigen::Index>(mode.columns);
  const std::size_t g = mode.channels;
  const ExtendedMatrix part = series(part_flow, order + 6);
  // By |e^{A t}| <= e^{|A| t}, the growth over a sample of eight parts is the growth over one part,
  // squared three times.
  ExtendedMatrix sample_growth = growth;
  for (std::size_t k = 1; k < kFewestParts; k *= 2)
    sample_growth = product(sample_growth, sample_growth);

  const std::size_t first = kernel::padded(mode.states + 2);
  const std::size_t stride = kernel::padded(g);
  const ExtendedMatrix slope = product(r, a);
  const ExtendedMatrix bend = product(slope, a);
  const ExtendedMatrix square = product(a, a).topRows(n);
  const ExtendedMatrix square_size = absolute(square);
  const Extended part_share = static_cast<Extended>(mode.reach * mode.reach) / 8;
  const Extended sample_share = part_share * static_cast<Extended>(kFewestParts * kFewestParts);
  mode.channel_stride = stride;
  mode.signal_place = first;
  mode.tick_stride = first + (mode.samples + 1) * stride;
  mode.tick.assign(mode.tick_stride * mode.columns, 0.0);
  mode.curve_stride = mode.samples * stride;
  mode.curve.assign(mode.curve_stride * mode.columns, 0.0);
  mode.quiet = {mode.tick.data(),
                mode.tick_stride,
                mode.curve.data(),
                mode.curve_stride,
                mode.low.data(),
                mode.high.data(),
                first,
                stride,
                mode.samples,
                mode.columns};
  mode.calm_stride = kernel::padded(mode.states) + mode.curve_stride;
  mode.calm_head.assign(mode.calm_stride * mode.columns, 0.0);
  mode.calm_tail.assign(mode.curve_stride * mode.states, 0.0);
  mode.calm_doubt.assign(mode.curve_stride, 0.0);
  if (mode.samples > 0) put_block(square, 0, mode.calm_stride, &mode.calm_head);
  mode.grid_flow.assign(mode.grid * mode.flow_stride * mode.columns, 0.0);
  mode.grid_signal_stride = kernel::padded(mode.grid + 1);
  mode.grid_signal.assign(g * mode.grid_signal_stride * mode.columns, 0.0);
  mode.grid_dip_stride = kernel::padded(mode.grid);
  mode.grid_dip.assign(g * mode.grid_dip_stride * mode.columns, 0.0);

  ExtendedMatrix flow = ExtendedMatrix::Identity(c, c);
  ExtendedMatrix signal = r;
  // |r| |Phi|, to which the rounding error of a signal is relative.
  ExtendedMatrix size = absolute(r);
  const std::size_t parts = mode.samples > 0 ? mode.samples * kFewestParts : mode.grid;
  for (std::size_t k = 0; k <= parts; ++k) {
    const bool sampled = mode.samples > 0 && k % kFewestParts == 0;
    const std::size_t sample = k / kFewestParts;
    if (k <= mode.grid)
      for (std::size_t i = 0; i < g; ++i)
        put_block(signal.row(static_cast<Eigen::Index>(i)), k, mode.grid_signal_stride,
                  &mode.grid_signal, i * mode.columns * mode.grid_signal_stride);
    if (sampled) put_block(signal, first + sample * stride, mode.tick_stride, &mode.tick);
    if (k == parts) break;

    // The second derivative is s'' = r A^2 e^{A t} z. A and e^{A t} commute, so the order of the
    // factors may change.
    const ExtendedMatrix curvature = product(bend, flow);
    const ExtendedMatrix here = absolute(curvature);
    if (sampled) {
      const ExtendedMatrix rounding = product(size, sample_growth) * (2 * kRounding);
      put_block(product(here, sample_growth) * sample_share + rounding, sample * stride,
                mode.curve_stride, &mode.curve);
      const Extended length = static_cast<Extended>(mode.reach) * kFewestParts;
      const ExtendedMatrix tail =
          product(absolute(product(slope, flow)), sample_growth) * (sample_share * length);
      put_block(curvature * sample_share, kernel::padded(mode.states) + sample * stride,
                mode.calm_stride, &mode.calm_head);
      put_block(tail.leftCols(n), sample * stride, mode.curve_stride, &mode.calm_tail);
      const ExtendedMatrix doubt =
          rounding +
          (here * sample_share + product(ExtendedMatrix(tail.leftCols(n)), square_size)) *
              kRounding;
      for (std::size_t i = 0; i < g; ++i)
        mode.calm_doubt[sample * stride + i] =
            static_cast<double>(doubt.row(static_cast<Eigen::Index>(i)).sum());
    }
    flow = product(part, flow);
    signal = product(r, flow);
    const ExtendedMatrix next_size = product(absolute(r), absolute(flow));
    if (k < mode.grid) {
      const ExtendedMatrix dip =
          product(here, growth) * part_share + (size + next_size) * kRounding;
      for (std::size_t i = 0; i < g; ++i)
        put_block(dip.row(static_cast<Eigen::Index>(i)), k, mode.grid_dip_stride, &mode.grid_dip,
                  i * mode.columns * mode.grid_dip_stride);
      put_block(flow.topRows(n), 0, mode.flow_stride, &mode.grid_flow,
                k * mode.flow_stride * mode.columns);
    }
    size = next_size;
  }
  if (mode.samples == 0) return;
  put_block(flow.topRows(n), 0, mode.tick_stride, &mode.tick);
  put_block(product(sensor, flow), mode.states, mode.tick_stride, &mode.tick);
}

[[noreturn]] void fail_too_fast(const std::string &file, const Network::Fastest &fastest) {
  char seconds[24];
  std::snprintf(seconds, sizeof seconds, "%.2g", 1.0 / fastest.rate);
  throw InputError(file, fastest.element,
                   "expected time constants of at least 1e-7 s, got " + std::string(seconds) +
                       " s with " + fastest.state +
                       "; make this element less stiff, damped or fast, or increase masses and "
                       "inductances at its ends");
}

std::unique_ptr<const Mode> build_mode(const ModeCache &cache, ModeKey key) {
  const Network &network = cache.network();
  const Model &model = cache.model();
  const ModeEquations equations = network.equations(key);
  const ExtendedMatrix a = square_flow(cache, equations);
  const Eigen::Index n = network.states();
  const Eigen::Index c = network.columns();
  const auto g = static_cast<Eigen::Index>(equations.channels.size());

  auto mode = std::make_unique<Mode>();
  mode->key = key;
  mode->states = static_cast<std::size_t>(n);
  mode->columns = static_cast<std::size_t>(c);
  mode->channels = equations.channels.size();
  mode->channel = equations.channels;

  // Parts of a tick are halved until a short Taylor series is accurate to the rounding error.
  std::size_t parts = kFewestParts;
  const Influence scale = influence(a);
  ExtendedMatrix growth;  // e^{|A| T / parts}
  int order = 0;
  while ((order = absolute_series(a, parts, scale, kTruncation, kHighestOrder, &growth)) == 0) {
    parts *= 2;
    if (parts > kMostTickParts) fail_too_fast(model.file, network.fastest(equations));
  }
  const ExtendedMatrix b = a / static_cast<Extended>(parts);
  mode->order = static_cast<std::size_t>(std::max(order, 2));
  mode->reach = 1.0 / static_cast<double>(parts);
  mode->samples = parts <= kMostTested ? parts / kFewestParts : 0;
  mode->grid = mode->samples > 0 ? std::min(parts, kMostGrid) : kFastGrid;

  ExtendedMatrix r(g, c);
  for (Eigen::Index i = 0; i < g; ++i)
    r.row(i) = equations.wires.row(equations.channels[static_cast<std::size_t>(i)].wire);
  mode->flow_stride = kernel::padded(mode->states);
  mode->taylor.assign(mode->order * mode->flow_stride * mode->columns, 0.0);
  ExtendedMatrix term = ExtendedMatrix::Identity(c, c);
  mode->series_stride = kernel::padded(mode->order + 1);
  mode->series.assign(mode->channels * mode->series_stride * mode->columns, 0.0);
  mode->doubt.resize((mode->order + 1) * mode->channels * mode->columns);
  for (std::size_t k = 0; k <= mode->order; ++k) {
    if (k > 0) {
      term = product(a, term) / static_cast<Extended>(k);
      put_block(term.topRows(n), (k - 1) * mode->flow_stride, mode->order * mode->flow_stride,
                &mode->taylor);
    }
    const ExtendedMatrix rows = product(r, term);
    for (Eigen::Index i = 0; i < g; ++i)
      put_block(rows.row(i), k, mode->series_stride, &mode->series,
                static_cast<std::size_t>(i) * mode->columns * mode->series_stride);
    // Upper bound of the rounding error of a Taylor coefficient, for a state with a relative
    // rounding error in the balanced norm. The bound includes the effect of the rounding errors of
    // all states within a time constant.
    const ExtendedMatrix doubt = product(product(absolute(r), absolute(term)), scale.sum);
    for (Eigen::Index i = 0; i < g; ++i)
      for (Eigen::Index j = 0; j < c; ++j)
        mode->doubt[(static_cast<std::size_t>(i) * (mode->order + 1) + k) * mode->columns +
                    static_cast<std::size_t>(j)] = static_cast<double>(doubt(i, j));
  }
  put_rows(r, &mode->signal);
  for (Eigen::Index i = 0; i < g; ++i)
    if (r(i, c - 1) != 0) mode->fed.push_back(static_cast<std::size_t>(i));

  mode->low.assign(kernel::padded(mode->channels), -std::numeric_limits<double>::infinity());
  mode->high.assign(kernel::padded(mode->channels), std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < mode->channels; ++i) {
    const Channel &channel = mode->channel[i];
    constexpr double kPull = static_cast<double>(kRounding);
    mode->low[i] = channel.low + kPull * kernel::magnitude(channel.low);
    mode->high[i] = channel.high - kPull * kernel::magnitude(channel.high);
    if (!(channel.low > -std::numeric_limits<double>::infinity())) mode->low[i] = channel.low;
    if (!(channel.high < std::numeric_limits<double>::infinity())) mode->high[i] = channel.high;
  }

  const auto &signal_wires = network.signal_wires();
  ExtendedMatrix truth(static_cast<Eigen::Index>(signal_wires.size()), c);
  for (std::size_t i = 0; i < signal_wires.size(); ++i)
    truth.row(static_cast<Eigen::Index>(i)) = equations.wires.row(signal_wires[i]);
  put_rows(truth, &mode->truth);

  put_rows(equations.slip, &mode->slip);

  ExtendedMatrix sensor = ExtendedMatrix::Zero(2, c);
  for (std::size_t channel = 0; channel < 2; ++channel)
    if (const int wire = network.adc_wires()[channel]; wire >= 0)
      sensor.row(static_cast<Eigen::Index>(channel)) = equations.wires.row(wire);
  mode->sensor.assign(kernel::padded(2) * mode->columns, 0.0);
  put_block(sensor, 0, kernel::padded(2), &mode->sensor);
  add_grid(*mode, b, order, growth, a, r, sensor);
  return mode;
}

// Computes the integral of Phi(t)' q Phi(t) dt over one tick. The Taylor series gives the integral
// over a short part of the tick. The length of the part is then doubled until the part is a tick.
class Gram {
 public:
  Gram(const ExtendedMatrix &a, Extended tick) : tick_(tick) {
    const Influence scale = influence(a);
    ExtendedMatrix growth;
    while ((order_ = absolute_series(a, parts_, scale, 0x1p-66L, 28, &growth)) == 0) parts_ *= 2;
    b_ = a / static_cast<Extended>(parts_);
    if (parts_ > 1) flows_.push_back(series(b_, order_ + 4));
    for (std::size_t k = parts_; k > 2; k /= 2)
      flows_.push_back(product(flows_.back(), flows_.back()));
  }

  ExtendedMatrix operator()(const ExtendedMatrix &q) const {  // q must be symmetric
    ExtendedMatrix term = q;
    ExtendedMatrix sum = q;
    for (int k = 1; k <= 2 * order_ + 8; ++k) {
      const ExtendedMatrix half = product(term, b_);  // Most entries of b_ are 0.
      const ExtendedMatrix mirrored = half.transpose();
      term = (half + mirrored) / static_cast<Extended>(k);
      sum += term / static_cast<Extended>(k + 1);
    }
    sum *= tick_ / static_cast<Extended>(parts_);
    for (const ExtendedMatrix &flow : flows_) {
      const ExtendedMatrix transposed = flow.transpose();
      sum += product(product(transposed, sum), flow);
    }
    return sum;
  }

 private:
  Extended tick_;  // length of a tick in s
  std::size_t parts_ = 1;
  int order_ = 0;
  ExtendedMatrix b_;
  std::vector<ExtendedMatrix> flows_;  // Flow matrices over 1, 2, 4, ... parts, up to half a tick.
};

std::unique_ptr<const ModeAudit> build_audit(const ModeCache &cache, ModeKey key) {
  const Network &network = cache.network();
  const ModeEquations equations = network.equations(key);
  const ExtendedMatrix a = square_flow(cache, equations);
  auto audit = std::make_unique<ModeAudit>();
  const Gram gram(a, tick_s(cache));
  const auto c = static_cast<std::size_t>(a.cols());
  audit->form_stride = kernel::padded(network.supplies().size() + network.dampers().size());
  audit->forms.assign(audit->form_stride * c * c, 0.0);
  std::size_t place = 0;
  const auto add = [&](const Wiring::Product &pair) {
    const ExtendedMatrix first = equations.wires.row(pair.first);
    const ExtendedMatrix second = equations.wires.row(pair.second);
    const ExtendedMatrix outer = product(first.transpose(), second);
    const ExtendedMatrix mirrored = outer.transpose();
    const ExtendedMatrix form = gram((outer + mirrored) / 2);
    for (std::size_t j = 0; j < c; ++j)
      for (std::size_t i = 0; i < c; ++i)
        audit->forms[(j * c + i) * audit->form_stride + place] =
            static_cast<double>(form(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)));
    ++place;
    put_rows(first, &audit->first);
    put_rows(second, &audit->second);
  };
  for (const auto &pair : network.supplies()) add(pair);
  for (const auto &pair : network.dampers()) add(pair);
  for (const auto &pair : network.storages()) {
    put_rows(equations.wires.row(pair.first), &audit->store_first);
    put_rows(equations.wires.row(pair.second), &audit->store_second);
    audit->store_constant.push_back(pair.constant < 0 ? 0.0
                                                      : static_cast<double>(equations.wires(
                                                            pair.constant, equations.flow.rows())));
  }
  return audit;
}

template <class Map, class Build>
const auto &find_or_build(std::mutex &mutex, Map &map, ModeKey key, Build build) {
  const std::lock_guard<std::mutex> lock(mutex);
  auto &entry = map[key];
  if (!entry) {
    try {
      entry = build();
    } catch (...) {
      map.erase(key);
      throw;
    }
  }
  return *entry;
}

}  // namespace

ModeCache::ModeCache(std::shared_ptr<const Model> model, int parts)
    : model_(std::move(model)), network_(*model_), parts_(parts) {
  if (parts < 1 || parts > kMostParts)
    throw std::invalid_argument("a tick has 1 to " + std::to_string(kMostParts) + " parts, not " +
                                std::to_string(parts));
}

const Mode &ModeCache::mode(ModeKey key) {
  return find_or_build(mutex_, modes_, key, [&] { return build_mode(*this, key); });
}

const ModeAudit &ModeCache::audit(ModeKey key) {
  return find_or_build(mutex_, audits_, key, [&] { return build_audit(*this, key); });
}

std::size_t ModeCache::size() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return modes_.size();
}

}  // namespace forceaxis::sim
