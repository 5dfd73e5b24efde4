#pragma once
// The plant of a force loop in which the firmware sends one code in each cycle of the bus, or in
// each tick if there is no bus. The pattern of the samples of the force sensor repeats with this
// period.
//
// The law computes an output in each tick, but only the output of the first tick of a cycle becomes
// a code. The reading of a tick is the newest sample that has arrived. For a code Z^n in cycle n,
// with Z = e^(2 pi j f m T) and m ticks in a cycle, the reading in tick t of cycle n is R_t Z^n.
// The law H acts on m frequencies f + k / (m T), so the loop is
//
//     L = sum over k of H(z_k) W_k,   W_k = 1/m sum over t of z_k^-t R_t,   z_k^m = Z.
//
// Both sums are exact: in contrast to a response with a mean age of the readings, L is the loop of
// the lifted system (host/python/forceaxis/linear/lifted.py).
#include <Eigen/Core>
#include <complex>
#include <span>
#include <vector>

#include "sim/hybrid/sinc_filter.hpp"
#include "sim/matrix/extended.hpp"

namespace forceaxis::sim {

/// The linear system x' = A x + B u and y = C x + D u, with one input and one output. `tick_s` is
/// the duration of a tick in s.
struct TickSystem {
  ExtendedMatrix A, B, C;
  Extended D = 0;
  double tick_s = 0.0;
};

/// Times of the bus and of the samples, in ticks. `every` is the time from sample to sample; a bus
/// cycle is a whole number of these times. `phase` is the time from tick 0 to a sample. `latency`
/// is the time from a sample to its arrival. `sinc_order` is the order of the converter's filter; 0
/// means no filter.
struct CodeTiming {
  int cycle_ticks = 1;
  int delay_ticks_out = 0;
  Extended every = 1, phase = 0, latency = 0;
  int sinc_order = 0;
};

class CodePeriod {
 public:
  CodePeriod(const TickSystem &plant, const CodeTiming &timing);
  /// Computes W_k in the unit of y per unit of u for the frequencies f with w = tan(pi f T), for
  /// k = 0 .. m - 1. `values` has all points of k = 0 first, then those of k = 1.
  void response(std::span<const double> w, std::span<std::complex<double>> values) const;

 private:
  class Flow;
  // A reading is the sum of its terms: Z^periods (row X + direct) with X = (Z - A)^-1 B. The row is
  // the row of `balanced_.C` that has the index of the term.
  struct Term {
    int periods;
    double direct;
  };
  struct Reading {
    std::size_t first, end;  // One reading of a sensor is the sum of the terms terms_[first] to
                             // terms_[end - 1].
    std::vector<int> ticks;  // ticks of the bus cycle in which the law uses this reading of the
                             // sensor
  };

  int cycle_ticks_;
  std::vector<Term> terms_;
  std::vector<Reading> readings_;
  Hessenberg balanced_;
};

}  // namespace forceaxis::sim
