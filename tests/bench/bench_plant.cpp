// Cost of the plant alone on the benchmark plant: whole runs of 2 s (with conversion, a minimal
// force law and recording) as real-time factors, and what a new mode costs.
#include <benchmark/benchmark.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "sim/hybrid/plant.hpp"
#include "sim/model/elements/adc.hpp"

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
      const SensorCodes &codes = plant.codes();
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

// Bodies between springs, the first driven by the benchmark plant's motor, the last one touching a
// wall: 2 `bodies` + 2 states, without events.
std::shared_ptr<const Model> chain_model(int bodies) {
  const auto indexed = [](char letter, int i) { return letter + std::to_string(i); };
  std::string text;
  for (int i = 1; i <= bodies; ++i) {
    const std::string name = indexed('b', i);
    const std::string before = i > 1 ? indexed('b', i - 1) : std::string("ground");
    text += "[[body]]\nname = \"" + name + "\"\nmass = 20\n[[spring]]\nname = \"" +
            indexed('s', i) + "\"\nbetween = [\"" + before + "\", \"" + name +
            "\"]\nstiffness = 1e6\ndamping = 500\n";
  }
  text += "[[contact]]\nname = \"wall\"\nbetween = [\"" + indexed('b', bodies) +
          "\", \"ground\"]\nstiffness = 4e5\ngap = -1e-4\n[drive]\ntype = \"dc_motor\"\n"
          "body = \"b1\"\nk_preamp_cmd = 3.9\nk_preamp_fdbk = 4.2\na_preamp_fdbk = 942\n"
          "k_tach = 0.039\nk_torque = 0.5\nk_back_emf = 0.5\nL = 0.0158\nR = 4.5\n"
          "r_trans = 0.004043\nk_current = 0.3333333333333333\nk_amp = 15\namp_break = 2\n"
          "k_amp_outer = 7.5\nsupply_limit = 60\n[encoder]\nbody = \"b1\"\nscale = 1e6\n"
          "[[adc]]\nchannel = 0\nsignal = \"wall.force\"\nper_count = 2\nzero_code = 128\n";
  const auto path = std::filesystem::temp_directory_path() /
                    ("forceaxis_bench_" + std::to_string(::getpid()) + ".toml");
  std::ofstream(path) << text;
  auto model = std::make_shared<const Model>(load_model(path));
  std::filesystem::remove(path);
  return model;
}

// Quiet ticks against the number of bodies: 2 give the 6 states of the benchmark plant, 6 give 14.
void BM_QuietChain(benchmark::State &state) {
  const auto cache = std::make_shared<ModeCache>(chain_model(static_cast<int>(state.range(0))));
  std::int64_t crossings = 0;
  for (auto _ : state) {
    Plant plant(cache);
    for (int k = 0; k < kTicks; ++k) {
      const SensorCodes &codes = plant.codes();
      plant.step(codes.adc[0] > 140 ? 1 : 2, true);
    }
    crossings = plant.crossings();
  }
  state.counters["crossings"] = static_cast<double>(crossings);
}

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
BENCHMARK(BM_QuietChain)->Arg(2)->Arg(6)->Unit(benchmark::kMicrosecond);
BENCHMARK(BM_NewMode)->Unit(benchmark::kMicrosecond);
BENCHMARK(BM_Signals);

}  // namespace
