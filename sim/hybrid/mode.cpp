#include "sim/hybrid/mode.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <utility>

#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/series.hpp"

namespace forceaxis::sim {
namespace {

// Number of grid parts in one sample of the quiet test.
constexpr std::size_t kFewestParts = 8;
// A mode has a quiet test only if a tick has at most this number of grid parts.
constexpr std::size_t kMostTested = 128;
// Largest number of grid parts; a word of 64 bits has one bit for each part.
constexpr std::size_t kMostGrid = 64;
constexpr std::size_t kMostTickParts = 1 << 20;
// Highest order of the Taylor series with kMostGrid parts. More parts do not fit into one word, so
// each of their ticks takes several searches, which cost more than some more terms.
constexpr int kHighestInGrid = 18;
// Upper bound of the relative rounding error of a sum of products.
constexpr double kRounding = 0x1p-46;

Extended tick_s(const ModeCache &cache) {
  return 1.0L / (static_cast<Extended>(kTickRateHz) * static_cast<Extended>(cache.parts()));
}

ExtendedMatrix square_flow(const ModeCache &cache, const ModeEquations &equations) {
  const Eigen::Index n = equations.flow.rows();
  ExtendedMatrix a = ExtendedMatrix::Zero(n + 2, n + 2);
  a.topRows(n) = equations.flow * tick_s(cache);
  return a;
}

// Computes the flow matrix at every point of the time grid. From these matrices, computes the quiet
// test on the samples, which consist of several grid parts.
void add_grid(Mode &mode, const ExtendedMatrix &part_flow, int order, const BoundMatrix &growth,
              const ExtendedMatrix &a, const ExtendedMatrix &r, const ExtendedMatrix &sensor) {
  const auto n = static_cast<Eigen::Index>(mode.states);
  const auto c = static_cast<Eigen::Index>(mode.columns);
  const std::size_t g = mode.channels;
  const ExtendedMatrix part = series(part_flow, order + 6);
  // By |e^{A t}| <= e^{|A| t}, the growth over a sample of eight parts is the growth over one part,
  // squared three times.
  BoundMatrix sample_growth = growth;
  for (std::size_t k = 1; k < kFewestParts; k *= 2)
    sample_growth = product(sample_growth, sample_growth);

  const std::size_t first = kernel::padded(mode.states + 2);
  const std::size_t stride = kernel::padded(g);
  const ExtendedMatrix slope = product(r, a);
  const ExtendedMatrix bend = product(slope, a);
  const ExtendedMatrix square = product(a, a).topRows(n);
  const BoundMatrix square_size = absolute(square);
  const double part_share = mode.reach * mode.reach / 8;
  const double sample_share = part_share * static_cast<double>(kFewestParts * kFewestParts);
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
  mode.calm = {mode.calm_head.data(),
               mode.calm_stride,
               mode.calm_tail.data(),
               mode.curve_stride,
               mode.calm_doubt.data(),
               mode.low.data(),
               mode.high.data(),
               kernel::padded(mode.states),
               stride,
               mode.samples,
               mode.columns,
               mode.states};
  put_block(square, 0, mode.calm_stride, &mode.calm_head);
  mode.grid_flow.assign(mode.grid * mode.flow_stride * mode.columns, 0.0);
  mode.grid_signal_stride = kernel::padded(mode.grid + 1);
  mode.grid_signal.assign(g * mode.grid_signal_stride * mode.columns, 0.0);
  mode.grid_dip_stride = kernel::padded(mode.grid);
  mode.grid_dip.assign(g * mode.grid_dip_stride * mode.columns, 0.0);

  ExtendedMatrix flow = ExtendedMatrix::Identity(c, c);
  ExtendedMatrix signal = r;
  // The product |r| |Phi|. The rounding error of a signal is relative to this product.
  const BoundMatrix r_size = absolute(r);
  BoundMatrix size = r_size;
  const std::size_t parts = mode.samples * kFewestParts;
  for (std::size_t k = 0; k <= parts; ++k) {
    const bool sampled = k % kFewestParts == 0;
    const std::size_t sample = k / kFewestParts;
    if (k <= mode.grid)
      for (std::size_t i = 0; i < g; ++i)
        put_block<Extended>(signal.row(static_cast<Eigen::Index>(i)), k, mode.grid_signal_stride,
                            &mode.grid_signal, i * mode.columns * mode.grid_signal_stride);
    if (sampled) put_block(signal, first + sample * stride, mode.tick_stride, &mode.tick);
    if (k == parts) break;

    // The second derivative is s'' = r A^2 e^{A t} z. A and e^{A t} commute, so the order of the
    // factors may change.
    const ExtendedMatrix curvature = product(bend, flow);
    const BoundMatrix here = absolute(curvature);
    if (sampled) {
      const BoundMatrix rounding = product(size, sample_growth) * (2 * kRounding);
      put_block<double>(product(here, sample_growth) * sample_share + rounding, sample * stride,
                        mode.curve_stride, &mode.curve);
      const double length = mode.reach * static_cast<double>(kFewestParts);
      const BoundMatrix tail =
          product(absolute(product(slope, flow)), sample_growth) * (sample_share * length);
      put_block<Extended>(curvature * sample_share, kernel::padded(mode.states) + sample * stride,
                          mode.calm_stride, &mode.calm_head);
      put_block<double>(tail.leftCols(n), sample * stride, mode.curve_stride, &mode.calm_tail);
      const BoundMatrix doubt =
          rounding +
          (here * sample_share + product(BoundMatrix(tail.leftCols(n)), square_size)) * kRounding;
      for (std::size_t i = 0; i < g; ++i)
        mode.calm_doubt[sample * stride + i] = doubt.row(static_cast<Eigen::Index>(i)).sum();
    }
    flow = product(part, flow);
    signal = product(r, flow);
    const BoundMatrix next_size = product(r_size, absolute(flow));
    if (k < mode.grid) {
      const BoundMatrix dip = product(here, growth) * part_share + (size + next_size) * kRounding;
      for (std::size_t i = 0; i < g; ++i)
        put_block<double>(dip.row(static_cast<Eigen::Index>(i)), k, mode.grid_dip_stride,
                          &mode.grid_dip, i * mode.columns * mode.grid_dip_stride);
      put_block<Extended>(flow.topRows(n), 0, mode.flow_stride, &mode.grid_flow,
                          k * mode.flow_stride * mode.columns);
    }
    size = next_size;
  }
  put_block<Extended>(flow.topRows(n), 0, mode.tick_stride, &mode.tick);
  put_block(product(sensor, flow), mode.states, mode.tick_stride, &mode.tick);
}

[[noreturn]] void fail_too_fast(const std::string &file, const Network::Fastest &fastest) {
  char seconds[24];
  std::snprintf(seconds, sizeof seconds, "%.2g", 1.0 / fastest.rate);
  throw InputError(file, fastest.element,
                   "expected time constants of at least 1e-8 s, got " + std::string(seconds) +
                       " s with " + fastest.state +
                       "; make this element less stiff, damped or fast, or increase masses and "
                       "inductances at its ends");
}

// Sets the bounds for the tests. They are narrower than the bounds of the channels by the rounding
// error.
void narrow_bounds(Mode &mode) {
  mode.low.assign(kernel::padded(mode.channels), -std::numeric_limits<double>::infinity());
  mode.high.assign(kernel::padded(mode.channels), std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < mode.channels; ++i) {
    const Channel &channel = mode.channel[i];
    mode.low[i] = channel.low + kRounding * kernel::magnitude(channel.low);
    mode.high[i] = channel.high - kRounding * kernel::magnitude(channel.high);
    if (!(channel.low > -std::numeric_limits<double>::infinity())) mode.low[i] = channel.low;
    if (!(channel.high < std::numeric_limits<double>::infinity())) mode.high[i] = channel.high;
  }
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
  BoundMatrix growth;  // matrix of upper bounds of the elements of e^{|A| T / parts}
  int order = 0;
  const auto highest = [&] { return parts == kMostGrid ? kHighestInGrid : kHighestOrder; };
  while ((order = absolute_series(a, parts, scale, kTruncation, highest(), &growth)) == 0) {
    parts *= 2;
    if (parts > kMostTickParts) fail_too_fast(model.file, network.fastest(equations));
  }
  const ExtendedMatrix b = a / static_cast<Extended>(parts);
  mode->order = static_cast<std::size_t>(std::max(order, 2));
  mode->reach = 1.0 / static_cast<double>(parts);
  mode->samples = parts <= kMostTested ? parts / kFewestParts : 0;
  mode->grid = mode->samples > 0 ? std::min(parts, kMostGrid) : 0;

  ExtendedMatrix r(g, c);
  for (Eigen::Index i = 0; i < g; ++i)
    r.row(i) = equations.wires.row(equations.channels[static_cast<std::size_t>(i)].wire);
  mode->flow_stride = kernel::padded(mode->states);
  mode->taylor.assign(mode->order * mode->flow_stride * mode->columns, 0.0);
  const BoundMatrix r_size = absolute(r);
  ExtendedMatrix term = ExtendedMatrix::Identity(c, c);
  mode->series_stride = kernel::padded(mode->order + 1);
  mode->series.assign(mode->channels * mode->series_stride * mode->columns, 0.0);
  mode->doubt.resize((mode->order + 1) * mode->channels * mode->columns);
  for (std::size_t k = 0; k <= mode->order; ++k) {
    if (k > 0) {
      term = product(a, term) / static_cast<Extended>(k);
      put_block<Extended>(term.topRows(n), (k - 1) * mode->flow_stride,
                          mode->order * mode->flow_stride, &mode->taylor);
    }
    const ExtendedMatrix rows = product(r, term);
    for (Eigen::Index i = 0; i < g; ++i)
      put_block<Extended>(rows.row(i), k, mode->series_stride, &mode->series,
                          static_cast<std::size_t>(i) * mode->columns * mode->series_stride);
    // Upper bound of the rounding error of a Taylor coefficient, for a state with a relative
    // rounding error in the balanced norm. The bound includes the effect of the rounding errors of
    // all states within a time constant.
    const BoundMatrix doubt = product(product(r_size, absolute(term)), scale.sum);
    for (Eigen::Index i = 0; i < g; ++i)
      for (Eigen::Index j = 0; j < c; ++j)
        mode->doubt[(static_cast<std::size_t>(i) * (mode->order + 1) + k) * mode->columns +
                    static_cast<std::size_t>(j)] = doubt(i, j);
  }
  put_rows(r, &mode->signal);
  for (Eigen::Index i = 0; i < g; ++i)
    if (r(i, c - 1) != 0) mode->fed.push_back(static_cast<std::size_t>(i));

  narrow_bounds(*mode);

  const auto &signal_wires = network.signal_wires();
  ExtendedMatrix truth(static_cast<Eigen::Index>(signal_wires.size()), c);
  for (std::size_t i = 0; i < signal_wires.size(); ++i)
    truth.row(static_cast<Eigen::Index>(i)) = equations.wires.row(signal_wires[i]);
  put_rows(truth, &mode->truth);

  put_rows(equations.slip, &mode->slip);
  mode->energy = energy_rows(network, equations);

  ExtendedMatrix sensor = ExtendedMatrix::Zero(2, c);
  for (std::size_t channel = 0; channel < 2; ++channel)
    if (const int wire = network.adc_wires()[channel]; wire >= 0)
      sensor.row(static_cast<Eigen::Index>(channel)) = equations.wires.row(wire);
  mode->sensor.assign(kernel::padded(2) * mode->columns, 0.0);
  put_block(sensor, 0, kernel::padded(2), &mode->sensor);
  if (mode->samples > 0) {
    add_grid(*mode, b, order, growth, a, r, sensor);
  } else {
    mode->pieces = build_pieces(a, r, sensor, static_cast<std::size_t>(std::countr_zero(parts)));
    mode->signal_place = mode->pieces->signal_place;
  }
  return mode;
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

const EnergyForms &ModeCache::energy_forms(ModeKey key) {
  const std::unique_ptr<const Pieces> &pieces = mode(key).pieces;
  return find_or_build(mutex_, energy_forms_, key, [&] {
    const ModeEquations equations = network_.equations(key);
    return build_energy_forms(network_, equations, square_flow(*this, equations), tick_s(*this),
                              pieces ? pieces->halvings : 0);
  });
}

std::size_t ModeCache::size() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return modes_.size();
}

}  // namespace forceaxis::sim
