#pragma once
// The codes that are outputs of the plant unit and inputs of the firmware unit. Both units use the
// same names.
#include "host/fmu/unit.hpp"

namespace forceaxis::fmu {

struct Code {
  const char *name;
  Type type;
  const char *unit;
  const char *meaning;
};

enum CodeIndex : std::size_t {
  kEncoder,
  kPositionAge,
  kAdc0,
  kAdc1,
  kForceAge,
  kLimitPos,
  kLimitNeg,
  kIndexPulse,
  kHome,
  kDriveReport,
  kCodeCount
};

inline constexpr Code kCodes[kCodeCount] = {
    {"encoder_cnt", Type::int32, "count", "encoder count, which wraps at 32 bits"},
    {"position_age", Type::int32, "tick", "age of the encoder count; 255 is 255 ticks or more"},
    {"adc0_code", Type::int32, "code", "code of ADC 0, the force sensor"},
    {"adc1_code", Type::int32, "code", "code of ADC 1"},
    {"force_age", Type::int32, "tick", "age of adc0_code; 255 is 255 ticks or more"},
    {"limit_pos", Type::boolean, "", "positive limit switch is active"},
    {"limit_neg", Type::boolean, "", "negative limit switch is active"},
    {"index_pulse", Type::boolean, "", "index pulse since the last tick"},
    {"home", Type::boolean, "", "home switch is active"},
    {"drive_report", Type::int32, "",
     "report of the drive with the bits of the object drive_report; 0 without a report"},
};

}  // namespace forceaxis::fmu
