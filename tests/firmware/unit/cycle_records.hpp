#ifndef TESTS_UNIT_CYCLE_RECORDS_HPP_
#define TESTS_UNIT_CYCLE_RECORDS_HPP_

// Records of cycles that are right (firmware/cycle/program.h).
#include <cstdint>
#include <cstring>
#include <functional>
#include <random>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/support/frames.hpp"

// A force_max below the end of an 8-bit sensor whose zero or tare is up to 15 counts, in 1/256
// count.
inline constexpr std::uint32_t kForceMost = 240 * 256;

// A phase that waits for ten ticks.
inline cycle_phase_t wait_phase(std::uint8_t next) {
  cycle_phase_t phase{};
  phase.action = CYCLE_WAIT;
  phase.reaction = CYCLE_END;
  phase.force_max_q8 = 1000;
  phase.travel_max = 500;
  phase.time_max = 100;
  phase.conditions[0] = {CYCLE_TIME, next, 0, 10};
  for (int i = 1; i < CYCLE_CONDITIONS; ++i) phase.conditions[i].next = CYCLE_END;
  return phase;
}

// Completes a record of phases, with one element PEAK over all of them, which is good up to 900, or
// what `change` makes of it, and with points: those of the list, or header.points that nothing
// uses.
inline std::vector<std::uint32_t> completed(
    cycle_header_t header, const std::vector<cycle_phase_t> &phases,
    const std::function<void(cycle_element_t &)> &change = [](cycle_element_t &) {},
    const std::vector<cycle_point_t> &points = {}) {
  cycle_element_t element{};
  element.kind = CYCLE_PEAK;
  element.phases = 0xFFFF;
  element.x_least = -CYCLE_TRAVEL_MAX;
  element.x_most = CYCLE_TRAVEL_MAX;
  element.y_least = INT32_MIN;
  element.y_most = 900;
  change(element);
  header.magic = CYCLE_MAGIC;
  header.version = CYCLE_VERSION;
  header.phases = static_cast<std::uint8_t>(phases.size());
  header.elements = 1;
  if (!points.empty()) header.points = static_cast<std::uint16_t>(points.size());
  const std::size_t before = sizeof(header) + phases.size() * sizeof(cycle_phase_t);
  header.size = static_cast<std::uint16_t>(before + sizeof(element) + 8u * header.points + 4);
  std::vector<std::uint32_t> words(header.size / 4u);
  auto *bytes = reinterpret_cast<std::uint8_t *>(words.data());
  std::memcpy(bytes, &header, sizeof(header));
  std::memcpy(bytes + sizeof(header), phases.data(), phases.size() * sizeof(cycle_phase_t));
  std::memcpy(bytes + before, &element, sizeof(element));
  if (!points.empty()) {
    std::memcpy(bytes + before + sizeof(element), points.data(), points.size() * sizeof(points[0]));
  }
  words.back() = Crc32(bytes, header.size - 4u);
  return words;
}

inline std::vector<std::uint32_t> record_of(const std::vector<cycle_phase_t> &phases,
                                            std::uint32_t number = 0, std::uint16_t points = 0) {
  cycle_header_t header{};
  header.number = number;
  header.points = points;
  return completed(header, phases);
}

inline std::vector<std::uint32_t> record_with_zero(const std::vector<cycle_phase_t> &phases,
                                                   std::uint8_t zero, std::int32_t zero_level,
                                                   std::uint8_t reserved = 0) {
  cycle_header_t header{};
  header.zero = zero;
  header.zero_level = zero_level;
  header.reserved = reserved;
  return completed(header, phases);
}

// The bytes of a record of one phase: 152, and 8 more for each point.
inline Bytes cycle_record(std::uint32_t number, std::uint16_t points = 0) {
  const auto words = record_of({wait_phase(CYCLE_END)}, number, points);
  const auto *bytes = reinterpret_cast<const std::uint8_t *>(words.data());
  return {bytes, bytes + 4 * words.size()};
}

// A phase that moves or presses around a position in user units, with conditions of every kind.
inline cycle_phase_t random_phase(std::mt19937 &random, std::uint8_t phases, int points,
                                  std::int32_t position) {
  const auto pick = [&](int low, int high) {
    return low + static_cast<int>(random() % static_cast<unsigned>(high - low + 1));
  };
  cycle_phase_t phase = wait_phase(CYCLE_END);
  phase.force_max_q8 = static_cast<std::uint32_t>(pick(0, 3) == 0 ? 8000 : kForceMost);
  phase.travel_max = static_cast<std::uint32_t>(pick(0, 3) == 0 ? 60 : 100000);
  phase.time_max = static_cast<std::uint32_t>(pick(0, 3) == 0 ? 60 : 1500);
  phase.reaction = static_cast<std::uint8_t>(pick(0, 1) == 0 ? pick(0, phases - 1) : CYCLE_END);
  phase.action = static_cast<std::uint8_t>(pick(0, CYCLE_ACTIONS - 1));
  if (phase.action == CYCLE_PRESS || phase.action == CYCLE_FOLLOW) {
    if (phase.action == CYCLE_PRESS)
      phase.force = static_cast<std::int16_t>(pick(0, 4) == 0 ? -500 : pick(1, 1500));
    phase.slope = static_cast<std::uint32_t>(pick(1, 30000));
    if (phase.action == CYCLE_FOLLOW) {
      phase.over_travel = static_cast<std::uint8_t>(pick(0, 1));
      phase.first = static_cast<std::uint16_t>(pick(0, points - 2));
      phase.points = static_cast<std::uint8_t>(pick(2, points - phase.first));
    }
  } else if (phase.action == CYCLE_TARE) {
    phase.target = pick(1, 30);
  } else if (phase.action <= CYCLE_APPROACH) {
    phase.target = pick(-300, 300) + (phase.action == CYCLE_MOVE ? position : 0);
    phase.speed = static_cast<std::uint32_t>(pick(1, 40000));
  }
  if (phase.action == CYCLE_OUTPUT || pick(0, 9) == 0)
    phase.outputs_on = static_cast<std::uint8_t>(pick(1, CYCLE_OUTPUTS_ALL));
  phase.outputs_off = static_cast<std::uint8_t>(pick(0, 15) & ~phase.outputs_on);
  for (cycle_condition_t &condition : phase.conditions) {
    const std::int32_t levels[CYCLE_CONDITION_KINDS] = {0,
                                                        0,
                                                        pick(1, 60),
                                                        pick(-20, 60) * 256,
                                                        pick(-20, 60) * 256,
                                                        pick(1, 60),
                                                        pick(-20, 40),
                                                        pick(-20, 40),
                                                        0,
                                                        0,
                                                        pick(1, 15),
                                                        pick(1, 15),
                                                        pick(-9, 99) * 65536,
                                                        pick(-9, 99) * 65536};
    condition.when = static_cast<std::uint8_t>(pick(0, CYCLE_CONDITION_KINDS - 1));
    condition.next = static_cast<std::uint8_t>(pick(0, 5) == 0 ? CYCLE_END : pick(0, phases - 1));
    condition.count = static_cast<std::uint16_t>(pick(0, 2));
    condition.level = levels[condition.when];
    if (condition.when >= CYCLE_STIFFNESS_ABOVE)
      phase.stiffness_travel = static_cast<std::uint16_t>(pick(1, 9));
  }
  return phase;
}

inline std::vector<std::uint32_t> random_record(std::mt19937 &random, std::int32_t position) {
  const auto phases = static_cast<std::uint8_t>(1 + random() % CYCLE_PHASES_MAX);
  const auto pick = [&](int low, int high) {
    return low + static_cast<int>(random() % static_cast<unsigned>(high - low + 1));
  };
  std::vector<cycle_point_t> points(static_cast<std::size_t>(pick(2, 20)));
  std::int32_t x = pick(-40, 10);
  for (cycle_point_t &point : points) {
    point = {x, pick(-200, 1500) * 256};
    x += pick(1, 60);
  }
  const int count = static_cast<int>(points.size());
  std::vector<cycle_phase_t> drawn;
  for (int i = 0; i < phases; ++i) drawn.push_back(random_phase(random, phases, count, position));
  cycle_header_t header{};
  const int zeros[] = {CYCLE_ZERO_TOUCH, CYCLE_ZERO_TOUCH, CYCLE_ZERO_TOUCH,
                       CYCLE_ZERO_TOUCH, CYCLE_ZERO_FORCE, CYCLE_ZERO_POSITION};
  header.zero = static_cast<std::uint8_t>(zeros[pick(0, 5)]);
  header.zero_level = header.zero == CYCLE_ZERO_FORCE      ? 2560
                      : header.zero == CYCLE_ZERO_POSITION ? position
                                                           : 0;
  header.outputs_keep = static_cast<std::uint8_t>(pick(0, CYCLE_OUTPUTS_ALL));
  return completed(
      header, drawn, [](cycle_element_t &) {}, points);
}

#endif
