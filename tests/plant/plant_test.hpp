#pragma once
// Models written in the test that uses them.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "sim/hybrid/plant.hpp"

namespace forceaxis::sim::test {

constexpr double kTickS = 1.0 / 1500.0;

/// Writes `text` to NAME.toml in a folder of the running test and returns the path.
inline std::filesystem::path write_model(const std::string &text,
                                         const std::string &name = "model") {
  const auto *info = testing::UnitTest::GetInstance()->current_test_info();
  const std::filesystem::path folder =
      std::filesystem::path(testing::TempDir()) / ("forceaxis_" + std::to_string(::getpid()) + "_" +
                                                   info->test_suite_name() + "_" + info->name());
  std::filesystem::create_directories(folder);
  const auto path = folder / (name + ".toml");
  std::ofstream(path, std::ios::binary) << text;
  return path;
}

inline std::shared_ptr<const Model> make_model(const std::string &text) {
  return std::make_shared<const Model>(load_model(write_model(text)));
}

inline std::uint64_t fnv1a(std::uint64_t hash, const void *bytes, std::size_t count) {
  const auto *p = static_cast<const unsigned char *>(bytes);
  for (std::size_t i = 0; i < count; ++i) hash = (hash ^ p[i]) * 0x100000001b3ULL;
  return hash;
}

inline std::uint64_t hash_state(std::uint64_t hash, const Plant &plant) {
  const auto state = plant.state();
  return fnv1a(hash, state.data(), state.size() * sizeof(double));
}

constexpr std::uint64_t kHashStart = 0xcbf29ce484222325ULL;

inline std::int64_t count_of(const Plant &plant, const std::string &element,
                             const std::string &from, const std::string &to) {
  for (const auto &entry : plant.event_counts())
    if (entry.element == element && entry.from == from && entry.to == to) return entry.count;
  return 0;
}

/// All digits, for a model's text.
inline std::string number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", value);
  return text;
}

/// A letter and a number, for the names of many bodies.
inline std::string indexed(char letter, int index) {
  std::string name(1, letter);
  name += std::to_string(index);
  return name;
}

/// The DC motor of Fig 4.4, with an amplifier curve that stands in for Fig 4.3, on a body.
inline std::string motor_drive(const std::string &body, const std::string &more = "") {
  return "[drive]\ntype = \"dc_motor\"\nbody = \"" + body +
         "\"\nk_preamp_cmd = 3.9\nk_preamp_fdbk = 4.2\na_preamp_fdbk = 942\nk_tach = 0.039\n"
         "k_torque = 0.5\nk_back_emf = 0.5\nL = 0.0158\nR = 4.5\nr_trans = 0.004043\n"
         "k_current = 0.3333333333333333\nk_amp = 15\namp_break = 2\nk_amp_outer = 7.5\n"
         "supply_limit = 60\n" +
         more;
}

}  // namespace forceaxis::sim::test
