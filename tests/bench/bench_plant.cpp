// Cost of the plant alone on the benchmark plant: whole runs of 2 s (with conversion, a minimal
// force law and recording) as real-time factors, and what a new mode costs.
#include <benchmark/benchmark.h>

#include <memory>
#include <vector>

#include "sim/hybrid/plant.hpp"

namespace {

using namespace forceaxis::sim;

constexpr int kTicks = 3000;

std::shared_ptr<const Model> axis_model() {
  static const auto model =
      std::make_shared<const Model>(load_model(FORCEAXIS_MODELS "/axis_contact.toml"));
  return model;
}

// clamp(floor(gain (setpoint / 2 - n) + 1/2)) in integers: the set-point is in N, 2 N per count.
int law(int n, int gain, int setpoint_N) {
  const int code = (gain * (setpoint_N - 2 * n) + 1) >> 1;
  return code < -2048 ? -2048 : code > 2047 ? 2047 : code;
}

void run(benchmark::State &state, int gain, int setpoint_N, bool audit) {
  const auto cache = std::make_shared<ModeCache>(axis_model());
  PlantOptions options;
  options.audit = audit;
  std::vector<double> record(3 * (kTicks + 1));
  std::int64_t crossings = 0;
  for (auto _ : state) {
    Plant plant(cache, options);
    for (int k = 0;; ++k) {
      const SensorCodes codes = plant.codes();
      record[3 * static_cast<std::size_t>(k)] = codes.adc[0];
      record[3 * static_cast<std::size_t>(k) + 1] = plant.state()[0];
      record[3 * static_cast<std::size_t>(k) + 2] = plant.state()[2];
      if (k == kTicks) break;
      plant.step(law(codes.adc[0] - 128, gain, setpoint_N), true);
    }
    benchmark::DoNotOptimize(record.data());
    crossings = plant.crossings();
  }
  state.counters["real_time_factor"] = benchmark::Counter(
      static_cast<double>(state.iterations()) * kTicks / kTickRateHz, benchmark::Counter::kIsRate);
  state.counters["crossings"] = static_cast<double>(crossings);
}

void BM_CaseA(benchmark::State &state) { run(state, 4, 59, false); }
void BM_CaseB(benchmark::State &state) { run(state, 15, 100, false); }
void BM_CaseA_Audit(benchmark::State &state) { run(state, 4, 59, true); }
void BM_CaseB_Audit(benchmark::State &state) { run(state, 15, 100, true); }

void BM_NewMode(benchmark::State &state) {
  for (auto _ : state) {
    ModeCache cache(axis_model());
    benchmark::DoNotOptimize(&cache.mode(cache.network().home_key(true)));
  }
}

void BM_Signals(benchmark::State &state) {
  Plant plant(axis_model());
  std::vector<double> values(plant.signal_names().size());
  for (auto _ : state) {
    plant.signals(values);
    benchmark::DoNotOptimize(values.data());
  }
}

BENCHMARK(BM_CaseA)->Unit(benchmark::kMicrosecond);
BENCHMARK(BM_CaseB)->Unit(benchmark::kMicrosecond);
BENCHMARK(BM_CaseA_Audit)->Unit(benchmark::kMicrosecond);
BENCHMARK(BM_CaseB_Audit)->Unit(benchmark::kMicrosecond);
BENCHMARK(BM_NewMode)->Unit(benchmark::kMicrosecond);
BENCHMARK(BM_Signals);

}  // namespace
