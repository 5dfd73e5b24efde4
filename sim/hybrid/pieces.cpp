#include "sim/hybrid/pieces.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "sim/hybrid/series.hpp"

namespace forceaxis::sim {
namespace {

using Eigen::Index;

// Modes with eigenvalues above this rate, in 1/tick, are separated as fast modes.
constexpr Extended kFastRate = 4;

// Returns an upper bound of e^{|b| h} for each piece 0..halvings. h is the length of the piece.
std::vector<BoundMatrix> growths(const ExtendedMatrix &b, std::size_t halvings) {
  std::vector<BoundMatrix> result(halvings + 1);
  const std::size_t parts = std::size_t{1} << halvings;
  BoundMatrix &finest = result[halvings];
  if (absolute_series(b, parts, influence(b), kTruncation, kHighestOrder, &finest) == 0)
    finest.setConstant(std::numeric_limits<double>::infinity());
  for (std::size_t k = halvings; k-- > 0;) {
    // In a long piece, the bound may exceed the range of floating-point numbers. Such a piece never
    // passes the test.
    if (result[k + 1].allFinite())
      result[k] = product(result[k + 1], result[k + 1]);
    else
      result[k] = result[k + 1];
  }
  return result;
}

// Returns the largest deviation of e^{l t} from its chord in a piece, for each eigenvalue l.
double chord_deviation(std::complex<Extended> eigenvalue, Extended h) {
  const Extended largest = std::exp(std::max(eigenvalue.real() * h, Extended{0}));
  return static_cast<double>(largest * std::min(std::norm(eigenvalue) * h * h / 8, Extended{2}));
}

}  // namespace

std::unique_ptr<const Pieces> build_pieces(const ExtendedMatrix &a, const ExtendedMatrix &r,
                                           const ExtendedMatrix &sensor, std::size_t halvings) {
  const Index c = a.rows();
  const Index n = c - 2;
  const Index g = r.rows();
  const FastModes modes = fast_modes(a, kFastRate);
  const Index f = modes.values.rows();
  const ExtendedMatrix &b = modes.slow;
  const ExtendedMatrix square = product(b, b);
  const BoundMatrix slope_size = absolute(product(r, b));
  const ExtendedMatrix bend = product(r, square);
  const auto rows = [](Index count) { return kernel::padded(static_cast<std::size_t>(count)); };

  auto result = std::make_unique<Pieces>();
  Pieces &pieces = *result;
  pieces.halvings = halvings;
  pieces.fast = static_cast<std::size_t>(f);
  pieces.bend_place = rows(n);
  pieces.fast_place = pieces.bend_place + rows(g);
  pieces.start_place = pieces.fast_place + rows(2 * f);
  pieces.head_stride = pieces.start_place + rows(g);
  pieces.head.assign(pieces.head_stride * static_cast<std::size_t>(c), 0.0);
  const auto put_head = [&](const ExtendedMatrix &block, std::size_t place) {
    put_block(block, place, pieces.head_stride, &pieces.head);
  };
  put_head(square.topRows(n), 0);
  put_head(bend, pieces.bend_place);
  put_head(modes.left.real(), pieces.fast_place);
  put_head(modes.left.imag(), pieces.fast_place + pieces.fast);
  put_head(r, pieces.start_place);

  pieces.signal_place = rows(c);
  pieces.flow_stride = pieces.signal_place + rows(g);
  pieces.bound_stride = rows(g);

  // Each product is a sum of c terms, in the order of the columns.
  const double rounding = static_cast<double>(c + 2) * std::numeric_limits<double>::epsilon() / 2;
  const BoundMatrix left_size = modes.left.cwiseAbs().cast<double>();
  // A fast mode of a conjugate pair counts for both modes of the pair.
  BoundMatrix fast_size =
      (r.cast<std::complex<Extended>>() * modes.right).cwiseAbs().cast<double>();
  for (Index i = 0; i < f; ++i)
    if (modes.values(i, 0).imag() > 0) fast_size.col(i) *= 2;
  const BoundMatrix r_size = absolute(r);
  const BoundMatrix b_size = absolute(b);
  const BoundMatrix error = absolute(modes.error);
  const BoundMatrix square_size = absolute(square) * rounding;
  const BoundMatrix square_error = product(error, b_size) + product(b_size, error) + square_size;
  const std::vector<BoundMatrix> growth = growths(b, halvings);
  const std::vector<ExtendedMatrix> change = changes(a, halvings, kHighestOrder + 6);
  for (std::size_t k = 0; k <= halvings; ++k) {
    const double h = Pieces::length(k);
    const ExtendedMatrix phi = ExtendedMatrix::Identity(c, c) + change[k];
    pieces.flow.emplace_back(pieces.flow_stride * static_cast<std::size_t>(c), 0.0);
    const auto put_flow = [&](const ExtendedMatrix &block, std::size_t place) {
      put_block(block, place, pieces.flow_stride, &pieces.flow.back());
    };
    put_flow(phi.topRows(n), 0);
    put_flow(product(sensor, phi), static_cast<std::size_t>(n));
    put_flow(product(r, phi), pieces.signal_place);

    const BoundMatrix tail = product(slope_size, growth[k]) * (h * h * h / 8);
    BoundMatrix fast = fast_size;
    for (Index i = 0; i < f; ++i) fast.col(i) *= chord_deviation(modes.values(i, 0), h);
    const BoundMatrix doubt = (r_size + product(r_size, absolute(phi))) * rounding +
                              product(fast, left_size) * rounding +
                              product(BoundMatrix(r_size * (h * h / 8) + tail), square_error) +
                              product(tail, square_size);
    BoundMatrix bound(g, n + f + c);
    bound << tail.leftCols(n), fast, doubt;
    pieces.bound.emplace_back(pieces.bound_stride * static_cast<std::size_t>(bound.cols()), 0.0);
    put_block(bound, 0, pieces.bound_stride, &pieces.bound.back());
  }
  return result;
}

}  // namespace forceaxis::sim
