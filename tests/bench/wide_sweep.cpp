// The wide sweep of the benchmark scenario "axis-contact", every run beside a slow independent
// stepper (Runge-Kutta in double, tests/loop/axis_contact_reference.hpp):
//
//   wide_sweep [EVERY [THREADS]]
//
// runs 64 x 64 points (or every EVERY-th in both directions) of K = 1..16 DAC counts per ADC count
// and fd = 10..130 N, 2 s each. The forces of both must agree to 1e-6 N at every tick until the two
// read different ADC codes, which they may only where the force lies within 1e-6 N of a code's
// edge; such runs are listed and at most 20 of 4096. Exit status 1 if not.
#include <algorithm>
#include <atomic>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <thread>
#include <vector>

#include "sim/hybrid/plant.hpp"
#include "sim/model/elements/adc.hpp"
#include "tests/loop/axis_contact_reference.hpp"

namespace {

constexpr int kPoints = 64;
constexpr int kTicks = 3000;
constexpr int kStepsPerTick = 4;
constexpr double kTolerance_N = 1e-6;

struct Outcome {
  double gain = 0.0;
  double setpoint_N = 0.0;
  int ticks = 0;            // compared
  double error_N = 0.0;     // largest difference while the codes agreed
  int parted = -1;          // tick of the first different code
  double margin_N = 0.0;    // there: distance of the reference's force to the nearest edge
  double closest_N = 1e30;  // to an edge, over all ticks compared
  int crossings = 0;
  bool agrees() const {
    return error_N <= kTolerance_N && (parted < 0 || margin_N <= kTolerance_N);
  }
};

// The law exactly as the scenario writes it.
int law(double gain, double setpoint_N, int n) {
  const double q = 20.0 / 4096;
  const double kf = gain * q / 2;
  const double c = std::floor(kf * (setpoint_N - 2.0 * n) / q + 0.5);
  return static_cast<int>(c < -2048 ? -2048 : c > 2047 ? 2047 : c);
}

int convert(double force_N) {
  const double n = std::floor(force_N / 2 + 0.5);
  return static_cast<int>(n < -128 ? -128 : n > 127 ? 127 : n);
}

double edge_distance(double force_N) {
  const double y = force_N / 2 + 0.5;
  if (y > 127) return 2 * (y - 127);  // beyond the last edge
  return 2 * std::fabs(y - std::round(y));
}

Outcome compare(const std::shared_ptr<forceaxis::sim::ModeCache> &cache, double gain,
                double setpoint_N) {
  Outcome o{gain, setpoint_N};
  forceaxis::sim::Plant plant(cache);
  axis_contact::PlantOf<double> slow;
  axis_contact::Reference counts;
  for (int k = 0;; ++k) {
    const int code = plant.codes().adc[0] - 128;
    const double want_N = slow.force();
    const double error_N = std::fabs(plant.signal("tip.force") - want_N);
    o.error_N = std::isfinite(error_N) ? std::max(o.error_N, error_N) : error_N;
    o.closest_N = std::min(o.closest_N, edge_distance(want_N));
    o.ticks = k;
    if (code != convert(want_N)) {
      o.parted = k;
      o.margin_N = edge_distance(want_N);
      break;
    }
    if (k == kTicks || !(o.error_N <= kTolerance_N)) break;
    const int dac = law(gain, setpoint_N, code);
    plant.step(dac, true);
    slow.volts = dac * (20.0 / 4096);
    slow.tick(kStepsPerTick, k / 1500.0, counts);
  }
  o.crossings = counts.crossings;
  return o;
}

int number(const char *text) {
  int value = 0;
  const char *end = text + std::strlen(text);
  const auto [at, error] = std::from_chars(text, end, value);
  return error == std::errc() && at == end ? value : 0;
}

}  // namespace

int main(int argc, char **argv) {
  const int every = argc > 1 ? number(argv[1]) : 1;
  const int threads = argc > 2 ? number(argv[2]) : 2;
  if (argc > 3 || every < 1 || every >= kPoints || threads < 1 || threads > 64) {
    std::fprintf(stderr, "wide_sweep [EVERY 1..63 [THREADS 1..64]]\n");
    return 2;
  }
  std::vector<Outcome> outcomes;
  for (int i = 0; i < kPoints; i += every)
    for (int j = 0; j < kPoints; j += every) {
      Outcome o;
      o.gain = 1.0 + 15.0 * i / (kPoints - 1);
      o.setpoint_N = 10.0 + 120.0 * j / (kPoints - 1);
      outcomes.push_back(o);
    }
  const auto cache =
      std::make_shared<forceaxis::sim::ModeCache>(std::make_shared<const forceaxis::sim::Model>(
          forceaxis::sim::load_model(FORCEAXIS_MODELS "/axis_contact.toml")));
  std::atomic<std::size_t> next{0};
  std::vector<std::thread> pool;
  for (int t = 0; t < threads; ++t)
    pool.emplace_back([&] {
      for (std::size_t i; (i = next++) < outcomes.size();)
        outcomes[i] = compare(cache, outcomes[i].gain, outcomes[i].setpoint_N);
    });
  for (std::thread &t : pool) t.join();

  int parted = 0;
  int wrong = 0;
  long ticks = 0;
  long crossings = 0;
  double worst_N = 0.0;
  for (const Outcome &o : outcomes) {
    ticks += o.ticks;
    crossings += o.crossings;
    worst_N = std::max(worst_N, o.error_N);
    if (o.parted >= 0 && o.agrees())
      std::printf("parted at an edge: K %.17g, fd %.17g N, tick %d, %.2g N from the edge\n", o.gain,
                  o.setpoint_N, o.parted, o.margin_N);
    parted += o.parted >= 0 && o.agrees();
    if (o.agrees()) continue;
    ++wrong;
    std::printf("DIFFERS: K %.17g, fd %.17g N, tick %d, by %.3g N%s\n", o.gain, o.setpoint_N,
                o.ticks, o.error_N, o.parted >= 0 ? ", other code" : "");
  }
  const auto close = std::count_if(outcomes.begin(), outcomes.end(),
                                   [](const Outcome &o) { return o.closest_N <= kTolerance_N; });
  std::printf(
      "%zu runs, %ld ticks compared, %ld crossings, largest difference %.3g N, %ld runs came "
      "within %.0e N of an edge, %d parted there, %d differ\n",
      outcomes.size(), ticks, crossings, worst_N, static_cast<long>(close), kTolerance_N, parted,
      wrong);
  return wrong == 0 && parted <= 20 ? 0 : 1;
}
