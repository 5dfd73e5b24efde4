#ifndef TESTS_UNIT_CYCLE_RECORDS_HPP_
#define TESTS_UNIT_CYCLE_RECORDS_HPP_

#include <cstdint>
#include <cstring>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/support/frames.hpp"

// A phase of 10 ticks at standstill.
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

// A record of phases, with one element PEAK over all of them, which is good up to 900, and with
// points that no element uses.
inline std::vector<std::uint32_t> record_of(const std::vector<cycle_phase_t> &phases,
                                            std::uint32_t number = 0, std::uint16_t points = 0) {
  cycle_element_t element{};
  element.kind = CYCLE_PEAK;
  element.phases = 0xFFFF;
  element.x_least = -CYCLE_TRAVEL_MAX;
  element.x_most = CYCLE_TRAVEL_MAX;
  element.y_least = INT32_MIN;
  element.y_most = 900;
  cycle_header_t header{};
  header.magic = CYCLE_MAGIC;
  header.version = CYCLE_VERSION;
  header.phases = static_cast<std::uint8_t>(phases.size());
  header.elements = 1;
  header.points = points;
  header.number = number;
  const std::size_t before = sizeof(header) + phases.size() * sizeof(cycle_phase_t);
  header.size = static_cast<std::uint16_t>(before + sizeof(element) + 8u * points + 4);
  std::vector<std::uint32_t> words(header.size / 4u);
  auto *bytes = reinterpret_cast<std::uint8_t *>(words.data());
  std::memcpy(bytes, &header, sizeof(header));
  std::memcpy(bytes + sizeof(header), phases.data(), phases.size() * sizeof(cycle_phase_t));
  std::memcpy(bytes + before, &element, sizeof(element));
  words.back() = Crc32(bytes, header.size - 4u);
  return words;
}

// The bytes of a record of one phase: 140, and 8 more for each point.
inline Bytes cycle_record(std::uint32_t number, std::uint16_t points = 0) {
  const auto words = record_of({wait_phase(CYCLE_END)}, number, points);
  const auto *bytes = reinterpret_cast<const std::uint8_t *>(words.data());
  return {bytes, bytes + 4 * words.size()};
}

#endif
