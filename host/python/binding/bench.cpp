// The loops whose time `forceaxis bench` measures: the plant alone, the plant with firmware, and
// sweeps of the plant on several threads. No Python code runs in these loops.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <ctime>
#include <exception>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <vector>

#include "firmware/port/host/axis_host.h"
#include "host/python/binding/parts.hpp"
#include "host/python/binding/table.hpp"
#include "host/run/experiment.hpp"
#include "host/run/item.hpp"
#include "sim/hybrid/plant.hpp"
#include "sim/model/elements/adc.hpp"
#include "sim/model/elements/body.hpp"
#include "sim/model/elements/dac.hpp"
#include "sim/model/elements/drive.hpp"
#include "sim/model/elements/encoder.hpp"

namespace py = pybind11;
using forceaxis::host::Experiment;
using forceaxis::host::item;
using forceaxis::sim::ModeCache;
using forceaxis::sim::Plant;
using forceaxis::sim::SensorCodes;

namespace {

constexpr int kTicks = 3000;

double thread_cpu_s() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

std::size_t place_of(const std::vector<std::string> &names, const std::string &name) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) throw std::invalid_argument("no signal named " + name);
  return static_cast<std::size_t>(found - names.begin());
}

// The control law of the benchmark in integers, with 2 N per ADC count and `gain` DAC codes per
// count.
int integer_law(int n, int gain, int setpoint_N) {
  return std::clamp((gain * (setpoint_N - 2 * n) + 1) >> 1, -2048, 2047);
}

// The control law of the benchmark for any gain and any set-point, as doubles.
int double_law(int n, double gain, double setpoint_N) {
  const double code = std::floor(0.5 * gain * (setpoint_N - 2.0 * n) + 0.5);
  return static_cast<int>(code < -2048.0 ? -2048.0 : code > 2047.0 ? 2047.0 : code);
}

struct BenchRun {
  static constexpr const char *kName = "BenchRun";
  static constexpr const char *kMeaning =
      "A run of 2 s: the value of each tick, before the control law is computed.";
  static constexpr bool kDict = true;
  py::array_t<double> force, robot, workpiece, current;
  py::array_t<int> count;
  double seconds;
  std::int64_t events;

  static constexpr auto items() {
    using R = BenchRun;
    return std::tuple{item("force", &R::force, "contact force in N"),
                      item("robot", &R::robot, "position in m"),
                      item("workpiece", &R::workpiece, "position in m"),
                      item("current", &R::current, "current of the motor in A"),
                      item("count", &R::count, "code of ADC 0 minus the code of the force 0"),
                      item("seconds", &R::seconds, "CPU time in s"),
                      item("events", &R::events, "number of state changes of elements")};
  }
};

struct BenchSweep {
  static constexpr const char *kName = "BenchSweep";
  static constexpr const char *kMeaning =
      "Metrics of the runs of a sweep, in which the set-point changes fastest, and its time.";
  static constexpr bool kDict = true;
  py::array_t<double> peak_force_N, end_force_N;
  py::array_t<int> contact_losses, last_change;
  double wall_s, cpu_s;

  static constexpr auto items() {
    using S = BenchSweep;
    return std::tuple{
        item("peak_force_N", &S::peak_force_N),
        item("end_force_N", &S::end_force_N),
        item("contact_losses", &S::contact_losses),
        item("last_change", &S::last_change, "last tick in which the code of ADC 0 changed"),
        item("wall_s", &S::wall_s),
        item("cpu_s", &S::cpu_s, "CPU time of all threads")};
  }
};

class BenchCase {
 public:
  BenchCase(const std::filesystem::path &file, const std::string &force, const std::string &robot,
            const std::string &workpiece)
      : experiment_(forceaxis::host::load_experiment(file)),
        cache_(std::make_shared<ModeCache>(experiment_.model)) {
    const Plant plant(cache_);
    force_ = place_of(plant.signal_names(), force);
    const auto &model = *experiment_.model;
    robot_ = 2 * static_cast<std::size_t>(model.point_index(robot));
    workpiece_ = 2 * static_cast<std::size_t>(model.point_index(workpiece));
    current_ = 2 * model.bodies.size();
    zero_ = model.adc[0]->zero_code;
  }

  // Computes one run of 3000 ticks.
  py::object run(int gain, int setpoint_N, bool firmware) {
    py::array_t<double> force(kTicks + 1), robot(kTicks + 1), workpiece(kTicks + 1),
        current(kTicks + 1);
    py::array_t<int> count(kTicks + 1);
    double *const f = force.mutable_data();
    double *const xr = robot.mutable_data();
    double *const xw = workpiece.mutable_data();
    double *const i = current.mutable_data();
    int *const n = count.mutable_data();
    double seconds = 0;
    std::int64_t crossings = 0;
    const auto record = [&](std::size_t k, const Plant &plant, int code) {
      const auto state = plant.state();
      f[k] = plant.signal_at(force_);
      xr[k] = state[robot_];
      xw[k] = state[workpiece_];
      i[k] = state[current_];
      n[k] = code - zero_;
    };
    {
      const py::gil_scoped_release release;
      const double start = thread_cpu_s();
      Plant plant(cache_);
      if (firmware) {
        const std::unique_ptr<fw_t, void (*)(fw_t *)> axis(axis_host_create(), axis_host_destroy);
        for (const auto &w : experiment_.initial)
          if (fw_object_write(axis.get(), FW_SOURCE_LOCAL, w.object, w.raw) != FW_OK)
            throw std::runtime_error("the firmware refuses an object of " +
                                     experiment_.file.string());
        axis_inputs_t in{};
        in.din = AXIS_DIGITAL_INPUTS_ENABLE;
        in.sensor_valid = 1;
        axis_outputs_t out{};
        for (std::size_t k = 0;; ++k) {
          const SensorCodes &codes = plant.codes();
          record(k, plant, codes.adc[0]);
          if (k == kTicks) break;
          in.encoder_cnt = codes.encoder;
          in.drive = codes.drive;
          in.position_age = codes.encoder_age;
          in.force_age = codes.force_age;
          in.adc_code[0] = codes.adc[0];
          in.adc_code[1] = codes.adc[1];
          fw_tick(axis.get(), &in, &out);
          plant.step(axis_host_dac_code(&out, plant.model().dac->bits), out.amp_enable != 0,
                     out.brake_release != 0);
        }
      } else {
        for (std::size_t k = 0;; ++k) {
          const SensorCodes &codes = plant.codes();
          record(k, plant, codes.adc[0]);
          if (k == kTicks) break;
          plant.step(integer_law(codes.adc[0] - zero_, gain, setpoint_N), true);
        }
      }
      seconds = thread_cpu_s() - start;
      crossings = plant.crossings();
    }
    return table::object(BenchRun{force, robot, workpiece, current, count, seconds, crossings});
  }

  // Computes side x side runs with evenly spaced gains and set-points, including the ends of the
  // ranges. Returns only metrics. Each thread gets the number of its next run from a common
  // counter. All runs start with copies of one plant and share the cache of modes.
  py::object sweep(std::pair<double, double> gains, std::pair<double, double> setpoints_N, int side,
                   unsigned threads) {
    const auto runs = static_cast<std::size_t>(side) * static_cast<std::size_t>(side);
    if (side < 2) throw std::invalid_argument("a sweep wants two points a side");
    const auto size = static_cast<py::ssize_t>(runs);
    py::array_t<double> peak(size), end(size);
    py::array_t<int> losses(size), last_change(size);
    double *const peaks = peak.mutable_data();
    double *const ends = end.mutable_data();
    int *const lost = losses.mutable_data();
    int *const changed = last_change.mutable_data();

    const auto point = [side](const std::pair<double, double> &range, std::size_t k) {
      return range.first +
             (range.second - range.first) * static_cast<double>(k) / static_cast<double>(side - 1);
    };
    double wall_s = 0, cpu_s = 0;
    {
      const py::gil_scoped_release release;
      // This plant has its own cache of modes, so that the measured time includes the time to build
      // the modes.
      const Plant start(std::make_shared<ModeCache>(experiment_.model));
      std::atomic<std::size_t> next{0};
      std::mutex mutex;
      std::exception_ptr failure;
      const auto work = [&] {
        const double from = thread_cpu_s();
        try {
          for (std::size_t r; (r = next++) < runs;) {
            const double gain = point(gains, r / static_cast<std::size_t>(side));
            const double setpoint_N = point(setpoints_N, r % static_cast<std::size_t>(side));
            Plant plant = start;
            double highest = 0, before = 0;
            int losses_here = 0, last = 0, previous = 0;
            for (int k = 0;; ++k) {
              const int n = plant.codes().adc[0] - zero_;
              const double f = plant.signal_at(force_);
              highest = f > highest ? f : highest;
              losses_here += before > 0 && !(f > 0);
              if (k > 0 && n != previous) last = k;
              previous = n;
              before = f;
              if (k == kTicks) break;
              plant.step(double_law(n, gain, setpoint_N), true);
            }
            peaks[r] = highest;
            ends[r] = before;
            lost[r] = losses_here;
            changed[r] = last;
          }
        } catch (...) {
          const std::lock_guard lock(mutex);
          if (!failure) failure = std::current_exception();
          next = runs;
        }
        const std::lock_guard lock(mutex);
        cpu_s += thread_cpu_s() - from;
      };
      const auto from = std::chrono::steady_clock::now();
      std::vector<std::thread> pool;
      for (unsigned i = 0; i < std::max(1U, threads); ++i) pool.emplace_back(work);
      for (std::thread &t : pool) t.join();
      wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - from).count();
      if (failure) std::rethrow_exception(failure);
    }
    return table::object(BenchSweep{peak, end, losses, last_change, wall_s, cpu_s});
  }

 private:
  Experiment experiment_;
  std::shared_ptr<ModeCache> cache_;
  std::size_t force_ = 0, robot_ = 0, workpiece_ = 0, current_ = 0;
  int zero_ = 0;
};

}  // namespace

void add_bench(py::module_ &m) {
  table::add_results<BenchRun, BenchSweep>();
  py::class_<BenchCase>(m, "BenchCase",
                        "The simulated plant of a case of the benchmark, with its force loop.")
      .def(py::init<const std::filesystem::path &, const std::string &, const std::string &,
                    const std::string &>(),
           py::arg("experiment"), py::arg("force"), py::arg("robot"), py::arg("workpiece"))
      .def("run", &BenchCase::run, py::arg("gain"), py::arg("setpoint_N"),
           py::arg("firmware") = false, "Computes one run of 2 s.")
      .def("sweep", &BenchCase::sweep, py::arg("gains"), py::arg("setpoints_N"),
           py::arg("side") = 64, py::arg("threads") = 1, "Computes side x side runs of 2 s.");
}
