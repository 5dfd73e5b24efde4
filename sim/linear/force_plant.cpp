#include "sim/linear/force_plant.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <string>
#include <utility>

#include "sim/matrix/hessenberg.hpp"
#include "sim/model/elements/adc.hpp"
#include "sim/model/elements/dac.hpp"
#include "sim/model/elements/drive.hpp"
#include "sim/model/elements/sampling.hpp"

namespace forceaxis::sim {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::RowVectorXd;
using Roots = std::vector<std::complex<double>>;

// A sampled system with one input, one output and no direct path.
template <typename Matrix>
struct Sampled {
  Matrix A, B, C;
};

// A Markov parameter below this fraction of the size of its terms is treated as 0, because it is a
// rounding error.
constexpr Extended kZeroShare = 1e-11L;

// Returns the relative degree r: the first nonzero Markov parameter is C A^(r-1) B. Returns nothing
// if the input does not act on the output.
std::optional<Index> relative_degree(const Sampled<ExtendedMatrix> &system) {
  ExtendedMatrix row = system.C;
  ExtendedMatrix bound = system.C.cwiseAbs();
  for (Index degree = 1; degree <= system.A.rows(); ++degree) {
    const Extended value = (row * system.B)(0, 0);
    const Extended size = (bound * system.B.cwiseAbs())(0, 0);
    if (std::abs(value) > kZeroShare * size) return degree;
    row = (row * system.A).eval();
    bound = (bound * system.A.cwiseAbs()).eval();
  }
  return std::nullopt;
}

// Changes the units of the states so that rows and columns of A have similar magnitudes.
void balance_units(Sampled<ExtendedMatrix> &system) {
  const Eigen::VectorXd d = balance(system.A);
  for (Index i = 0; i < system.A.rows(); ++i) {
    for (Index j = 0; j < system.A.cols(); ++j) system.A(i, j) *= Extended{d(j)} / d(i);
    system.B(i, 0) /= d(i);
    system.C(0, i) *= d(i);
  }
}

// Returns orthonormal columns that are orthogonal to all rows of a matrix, by Householder
// reflections.
MatrixXd complement(const MatrixXd &rows) {
  const Index n = rows.cols();
  MatrixXd work = rows.transpose();
  MatrixXd basis = MatrixXd::Identity(n, n);
  for (Index k = 0; k < rows.rows(); ++k) {
    Eigen::VectorXd turn = work.col(k).tail(n - k);
    turn(0) += std::copysign(turn.norm(), turn(0));
    turn /= turn.norm();
    const RowVectorXd moved = turn.transpose() * work.bottomRows(n - k);
    work.bottomRows(n - k) -= 2 * turn * moved;
    const Eigen::VectorXd turned = basis.rightCols(n - k) * turn;
    basis.rightCols(n - k) -= 2 * turned * turn.transpose();
  }
  return basis.rightCols(n - rows.rows());
}

// The roots only determine where a grid of frequencies is dense, so the precision of double is
// sufficient.
Roots roots_of(const MatrixXd &A) {
  Roots roots;
  if (A.rows() == 0) return roots;
  const Eigen::EigenSolver<MatrixXd> solver(A, false);
  for (const auto value : solver.eigenvalues()) roots.push_back(value);
  return roots;
}

// Returns the zeros of a balanced system. The zeros are the poles of the system with a feedback
// that keeps the output at 0. Only those states are considered for which the output and its next
// samples are 0. The number of these samples is the relative degree.
Roots zeros_of(const Sampled<MatrixXd> &system, Index degree) {
  const auto &[A, B, C] = system;
  MatrixXd rows(degree, A.cols());
  rows.row(0) = C / C.norm();
  for (Index k = 1; k < degree; ++k) {
    RowVectorXd row = rows.row(k - 1) * A;
    for (int pass = 0; pass < 2; ++pass)
      row -= ((row * rows.topRows(k).transpose()) * rows.topRows(k)).eval();
    rows.row(k) = row / row.norm();
  }
  const RowVectorXd last = rows.row(degree - 1);
  const MatrixXd held = A - B * (last * A) / (last * B)(0, 0);
  const MatrixXd basis = complement(rows);
  return roots_of(basis.transpose() * held * basis);
}

Roots per_second(Roots roots, double T) {
  for (auto &root : roots) {
    const std::complex<Extended> z(root);
    root = root == 0.0 ? std::complex<double>(-std::numeric_limits<double>::infinity(), 0.0)
                       : std::complex<double>(std::log(z) / Extended{T});
  }
  return roots;
}

// Returns the system without the states that neither the input nor a state that it moves acts on,
// such as those of a body that friction holds. They stay at 0.
Linear moved_by_input(const Linear &whole) {
  const Index n = whole.A.rows();
  std::vector<Index> moved;
  std::vector<bool> is_moved(static_cast<std::size_t>(n), false);
  const auto add = [&](const auto &column) {
    for (Index i = 0; i < n; ++i) {
      if (column(i) == 0.0 || is_moved[static_cast<std::size_t>(i)]) continue;
      is_moved[static_cast<std::size_t>(i)] = true;
      moved.push_back(i);
    }
  };
  add(whole.B.col(0));
  for (std::size_t next = 0; next < moved.size(); ++next) add(whole.A.col(moved[next]));
  std::sort(moved.begin(), moved.end());
  Linear part{
      whole.A(moved, moved), whole.B(moved, Eigen::all), whole.C(Eigen::all, moved), whole.D, {}};
  for (const Index i : moved) part.states.push_back(whole.states[static_cast<std::size_t>(i)]);
  return part;
}

// Returns true if a number differs from a whole number by less than 1e-6. An instant within 1e-6
// ticks of a tick is treated as that tick, as in a simulated run.
bool is_whole(Extended number) { return std::abs(number - std::nearbyint(number)) < 1e-6L; }

// Time in ticks from a tick to a sample that arrives just too late for this tick.
constexpr Extended kMissedBy = 1e-5L;

}  // namespace

double tangent_of(double frequency_hz, double tick_s) {
  constexpr Extended kRight = std::numbers::pi_v<Extended> / 2 - Extended{1e-9};
  const Extended angle = std::numbers::pi_v<Extended> * frequency_hz * tick_s;
  return static_cast<double>(std::tan(std::clamp(angle, -kRight, kRight)));
}

double alias_of(double hz, int k, double tick_s, int cycle_ticks) {
  const double alias = hz + k / (tick_s * cycle_ticks);
  return 2 * alias * tick_s > 1 ? alias - 1 / tick_s : alias;
}

std::optional<ForcePlant> ForcePlant::of(const Model &model, const LinearMode &mode,
                                         double tick_s) {
  if (!model.drive)
    throw InputError(model.file, "drive",
                     "expected a model with a [drive], got a model without a drive; choose another "
                     "model");
  if (!model.adc[0])
    throw InputError(model.file, "adc",
                     "expected a model with an ADC on channel 0, got none; choose another model");
  const std::array<std::string, 1> inputs{"drive.command"};
  const std::array<std::string, 1> outputs{"reading"};
  const Linear linear = moved_by_input(linearise(model, mode, inputs, outputs));
  const Index n = linear.A.rows();
  const ExtendedMatrix step = sampled(linear.A.cast<Extended>(), linear.B.cast<Extended>(), tick_s);
  Sampled<ExtendedMatrix> system{ExtendedMatrix::Identity(n, n) + step.leftCols(n), step.col(n),
                                 linear.C.cast<Extended>()};
  // The ADC converts immediately before the new DAC code acts. A direct path from the code to the
  // measured force therefore acts one tick later.
  if (linear.D(0, 0) != 0.0) {
    system.A.conservativeResizeLike(ExtendedMatrix::Zero(n + 1, n + 1));
    system.B.conservativeResizeLike(ExtendedMatrix::Ones(n + 1, 1));
    system.C.conservativeResize(1, n + 1);
    system.C(0, n) = linear.D(0, 0);
  }
  balance_units(system);
  const auto degree = relative_degree(system);
  if (!degree) return std::nullopt;
  ForcePlant plant;
  plant.tick_s_ = tick_s;
  plant.bus_ = model.drive->bus;
  plant.hold_.bus_ticks = plant.bus_.ticks;
  plant.hold_.bus_delay_ticks = plant.bus_.delay_ticks_out;
  plant.hold_.sinc_order = model.adc[0]->sinc_order;
  plant.continuous_ = {linear.A.cast<Extended>(), linear.B.cast<Extended>(),
                       linear.C.cast<Extended>(), linear.D(0, 0), tick_s};
  if (const auto &sampling = model.adc[0]->sampling) {
    const Extended every = 1 / (Extended{sampling->rate_hz} * tick_s);
    plant.timing_ = {plant.bus_.ticks,
                     plant.bus_.delay_ticks_out,
                     every,
                     Extended{sampling->phase_s} / tick_s,
                     Extended{sampling->latency_s} / tick_s,
                     plant.hold_.sinc_order};
    if (is_whole(plant.bus_.ticks / every)) {
      plant.newer_by_ = sampling->phase_known ? 0 : every;
      if (plant.newer_by_ > 0) plant.timing_.phase = plant.phase_of(kMissedBy);
      plant.period_.emplace(plant.continuous_, plant.timing_);
    } else {
      plant.set_ages(*sampling);
    }
  }
  plant.balanced_ = hessenberg(system.A, system.B, system.C);
  const auto &adc = *model.adc[0];
  plant.count_per_code_ = model.dac->volts_per_code() /
                          (std::abs(adc.per_count) * static_cast<double>(1 << (adc.bits - 8)));
  const Sampled<MatrixXd> rounded{system.A.cast<double>(), system.B.cast<double>(),
                                  system.C.cast<double>()};
  plant.poles_ = per_second(roots_of(rounded.A), tick_s);
  plant.zeros_ = per_second(zeros_of(rounded, *degree), tick_s);
  return plant;
}

void ForcePlant::response(std::span<const double> w, std::span<std::complex<double>> values) const {
  std::vector<std::complex<double>> points(w.size());
  for (std::size_t k = 0; k < points.size(); ++k) {
    const double size = 1 + w[k] * w[k];
    points[k] = {(1 - w[k] * w[k]) / size, 2 * w[k] / size};  // z = (1 + j w) / (1 - j w)
  }
  hessenberg_response(balanced_.H, balanced_.B, balanced_.C, MatrixXd::Zero(1, 1), points, values);
  for (auto &value : values) value *= count_per_code_;
}

// Without a bus, the pattern of the samples repeats after `readings` ticks. In these ticks, the
// age of the reading has `readings` values at equal distances, none smaller than the latency. Over
// a bus, the code depends on the reading in the first tick of a cycle, so the largest age in these
// ticks is used.
void ForcePlant::set_ages(const Sampling &sampling) {
  constexpr int kReadingsMax = 150;
  const Extended every = 1 / (Extended{sampling.rate_hz} * tick_s_);
  hold_.sample_ticks = every;
  const Extended latency = Extended{sampling.latency_s} / tick_s_;
  const Extended phase = Extended{sampling.phase_s} / tick_s_;
  // Returns the age of the newest sample at a tick, less the latency. Samples arrive every `step`
  // ticks.
  const auto rest = [&](int tick, Extended step) {
    const Extended past = (tick - latency - phase) / step;
    return is_whole(past) ? Extended{0} : (past - std::floor(past)) * step;
  };
  hold_.readings = 1;
  if (bus_.ticks > 1) {
    Extended most = sampling.phase_known ? 0 : every;
    for (int cycle = 0; sampling.phase_known && cycle < kReadingsMax; ++cycle)
      most = std::max(most, rest(cycle * bus_.ticks, every));
    hold_.least_age = latency + most;
    newer_by_ = sampling.phase_known ? 0 : every;
    return;
  }
  while (hold_.readings < kReadingsMax && !is_whole(hold_.readings / every)) ++hold_.readings;
  hold_.between_ages = every / hold_.readings;
  hold_.least_age =
      latency + (sampling.phase_known ? rest(0, hold_.between_ages) : hold_.between_ages);
  newer_by_ = sampling.phase_known ? 0 : hold_.between_ages;
}

// Returns the phase of the samples if they arrive `arrives` ticks after a tick.
Extended ForcePlant::phase_of(Extended arrives) const {
  const Extended past = (arrives - timing_.latency) / timing_.every;
  return (past - std::floor(past)) * timing_.every;
}

std::vector<ForcePlant> ForcePlant::with_other_phases(bool all_phases) const {
  std::vector<ForcePlant> found;
  if (newer_by_ == 0) return found;
  if (!period_) {
    ForcePlant &plant = found.emplace_back(*this);
    plant.hold_.least_age -= newer_by_;
    return found;
  }
  const auto add = [&](Extended arrives) {
    ForcePlant &plant = found.emplace_back(*this);
    plant.timing_.phase = phase_of(arrives);
    plant.period_.emplace(continuous_, plant.timing_);
  };
  add(0);
  if (!all_phases) return found;
  // The phases are those of Samples.phases in host/python/forceaxis/linear/lifted.py. Samples and
  // ticks can follow each other in several orders. Each order has three phases: with the oldest
  // readings, with readings of medium age, and with the newest readings.
  const auto samples = static_cast<int>(std::nearbyint(bus_.ticks / timing_.every));
  const int orders = bus_.ticks / std::gcd(bus_.ticks, samples);
  const Extended step = timing_.every / orders;
  for (int order = 0; order < orders; ++order)
    for (const Extended late : {kMissedBy, step / 2, Extended{0}})
      if (order > 0 || late == step / 2) add(order * step + late);
  return found;
}

void ForcePlant::held_response(std::span<const double> w,
                               std::span<std::complex<double>> values) const {
  if (period_) {
    const std::size_t points = w.size() / static_cast<std::size_t>(bus_.ticks);
    period_->response(w.first(points), values);
    for (auto &value : values) value *= count_per_code_;
    return;
  }
  response(w, values);
  if (immediate()) return;
  for (std::size_t i = 0; i < values.size(); ++i) values[i] *= hold_.at(w[i]);
}

}  // namespace forceaxis::sim
