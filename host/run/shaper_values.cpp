#include "host/run/shaper_values.hpp"

#include <cmath>
#include <numbers>
#include <string>

#include "sim/hybrid/mode.hpp"
#include "sim/model/read.hpp"

extern "C" {
#include "firmware/drive/shaper.h"
#include "firmware/objects/generated/axis_objects_drive.h"
}

namespace forceaxis::host {
namespace {

constexpr int kDelayMax = SHAPER_TICKS - 1;
constexpr std::int32_t kSum = 65536;

}  // namespace

std::optional<std::uint16_t> shaper_of_key(std::string_view key) {
  if (key == "shaper_force") return AXIS_OBJ_FORCE_SHAPER_IMPULSES;
  if (key == "shaper_motion") return AXIS_OBJ_MOTION_SHAPER_IMPULSES;
  return std::nullopt;
}

std::vector<ObjectWrite> read_shaper(sim::Section &section, std::uint16_t first) {
  sim::Names names;
  const auto given = sim::read_table<Shaper>(section, names);
  const int last = given.kind == ShaperKind::zv ? 1 : 2;
  const double damping = given.damping;
  const double root = std::sqrt(1.0 - damping * damping);
  const double half_ticks = sim::kTickRateHz / 2.0;
  const double mode = section.within("mode_Hz", sim::Dimension::frequency,
                                     half_ticks * last / (kDelayMax * root), half_ticks / root);
  const double half = half_ticks / (mode * root);
  const double ratio = std::exp(-damping * std::numbers::pi / root);
  // Each weight is a binomial coefficient times a power of the decay in half a period. The weights
  // are then divided by their sum.
  double sum = 0.0;
  double weight[SHAPER_IMPULSES] = {};
  for (int i = 0; i <= last; ++i) {
    weight[i] = (i == 1 ? last : 1) * std::pow(ratio, i);
    sum += weight[i];
  }
  std::int32_t amplitude[SHAPER_IMPULSES] = {kSum};
  for (int i = 1; i <= last; ++i) {
    amplitude[i] = static_cast<std::int32_t>(std::lround(kSum * weight[i] / sum));
    amplitude[0] -= amplitude[i];
  }
  std::vector<ObjectWrite> writes = {{first, last + 1}};
  for (int i = 0; i <= last; ++i) {
    writes.push_back({static_cast<std::uint16_t>(first + 1 + i), amplitude[i]});
    writes.push_back({static_cast<std::uint16_t>(first + 1 + SHAPER_IMPULSES + i),
                      static_cast<std::int32_t>(std::lround(i * half))});
  }
  return writes;
}

}  // namespace forceaxis::host
