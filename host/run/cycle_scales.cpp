#include "host/run/cycle_scales.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "host/run/objects.hpp"
#include "sim/model/elements/adc.hpp"
#include "sim/model/elements/encoder.hpp"

extern "C" {
#include "firmware/objects/generated/axis_objects_axis.h"
#include "firmware/objects/generated/axis_objects_drive.h"
}

namespace forceaxis::host {
namespace {

using sim::Dimension;

// The values that the objects of the firmware have before tick 0.
struct Initial {
  const std::vector<ObjectWrite> &writes;

  std::int32_t operator()(std::uint16_t object, std::int32_t fallback) const {
    for (const ObjectWrite &write : writes)
      if (write.object == object) fallback = write.raw;
    return fallback;
  }
};

void expect_axis(const sim::Source &source, const sim::Model &model, const Initial &raw) {
  if (!model.encoder)
    source.fail("phase", "expected a model with an [encoder], got none; choose another model");
  bool is_force = false;
  if (model.adc[0])
    for (const sim::SignalInfo &signal : model.signal_list())
      is_force |= signal.name == model.adc[0]->signal && signal.dimension == Dimension::force;
  if (!is_force)
    source.fail("phase", "expected a model whose ADC 0 measures a force; choose another model");
  // In a program, the firmware expects positions, distances and speeds in user units.
  if (raw(AXIS_OBJ_FEED, 0) != 0 || raw(AXIS_OBJ_POLARITY, 0) != 0)
    source.fail("phase",
                "expected an axis whose user unit is the encoder count; remove feed and polarity "
                "from the experiment");
}

void set_ends(CycleScales &scales, const Initial &raw, int sign) {
  scales.most_q8 = std::numeric_limits<double>::infinity();
  scales.least_q8 = -scales.most_q8;
  const int bits = raw(AXIS_OBJ_ADC_BITS, 8);
  const int zero = raw(AXIS_OBJ_FORCE_ZERO_CODE, 0);
  const double tare = raw(AXIS_OBJ_FORCE_TARE, 0), step = 1 << (16 - bits);
  const double last = sign * step * ((1 << bits) - 1 - zero) - tare;
  const double first = -sign * step * zero - tare;
  if (sign > 0 || zero != 0) scales.most_q8 = sign > 0 ? last : first;
  if (sign < 0 || zero != 0) scales.least_q8 = sign > 0 ? first : last;
}

}  // namespace

double CycleScales::force_max_q8() const { return std::isinf(most_q8) ? -least_q8 : most_q8; }

double CycleScales::per(Dimension dimension) const {
  switch (dimension) {
    case Dimension::time:
      return ticks_per_s;
    case Dimension::length:
    case Dimension::velocity:
      return counts_per_m;
    case Dimension::force:
      return q8_per_N;
    case Dimension::stiffness:
      return q8_per_N / counts_per_m * 65536;
    case Dimension::energy:
      return q8_per_N / 256 * counts_per_m;
    case Dimension::impulse:
      return q8_per_N / 256 * ticks_per_s;
    default:
      throw std::logic_error("no unit of the firmware for this quantity");
  }
}

double CycleScales::ticks_of(double time_s) const { return std::ceil(time_s * ticks_per_s - 1e-6); }

CycleScales cycle_scales(const sim::Source &source, const sim::Model &model,
                         const std::vector<ObjectWrite> &initial) {
  const Initial raw{initial};
  expect_axis(source, model, raw);
  const auto &adc = *model.adc[0];
  const int sign = raw(AXIS_OBJ_FORCE_SIGN, 1);
  CycleScales scales;
  scales.counts_per_m = model.encoder->scale;
  scales.q8_per_N = 256.0 * sign / (adc.per_count * (1 << (adc.bits - 8)));
  if (scales.counts_per_m < 0 || scales.q8_per_N < 0)
    source.fail("phase",
                "expected a model whose encoder counts up towards the workpiece and a "
                "force_sign with which the reading rises with the force; change the "
                "model or force_sign");
  scales.rated_N = 1e-3 * raw(AXIS_OBJ_RATED_FORCE, 100000);
  scales.limit_N = scales.rated_N * raw(AXIS_OBJ_FORCE_LIMIT, 1000) / 1000;
  scales.tare_band_q8 = raw(AXIS_OBJ_TARE_BAND, 0);
  scales.position_least = raw(AXIS_OBJ_POSITION_LIMIT_MIN, INT32_MIN);
  scales.position_most = raw(AXIS_OBJ_POSITION_LIMIT_MAX, INT32_MAX);
  scales.span =
      std::min(scales.position_most - scales.position_least,
               1.0 * raw(AXIS_OBJ_POSITION_MAX, INT32_MAX) - raw(AXIS_OBJ_POSITION_MIN, INT32_MIN));
  set_ends(scales, raw, sign);
  scales.contact_q8 = raw(AXIS_OBJ_CONTACT_FORCE, object_meta(AXIS_OBJ_CONTACT_FORCE).initial);
  const std::int32_t band = raw(AXIS_OBJ_TARE_BAND, 0), tare = raw(AXIS_OBJ_FORCE_TARE, 0);
  scales.tare_least = -band - tare;
  scales.tare_most = (band == 0 ? -1 : band) - tare;
  return scales;
}

}  // namespace forceaxis::host
