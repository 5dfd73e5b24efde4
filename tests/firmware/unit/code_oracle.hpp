#ifndef TESTS_UNIT_CODE_ORACLE_HPP_
#define TESTS_UNIT_CODE_ORACLE_HPP_

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "firmware/port/host/firmware.hpp"

// The bounds on the code, written from the manual of the objects and apart from the firmware: what
// goes out in a tick is judged by the parameters, by the inputs of this tick and the ones before,
// and by nothing that the firmware computes. It knows neither latency_ticks nor bump bias, gains or
// excitation, since no bound depends on them. Bounds of the command are about output_bias, with
// which the axis holds its weight; output_limit bounds the sum.
class CodeOracle {
 public:
  // Parameters as they stand in the tick; those of 43b2af7's object table.
  struct Bounds {
    Bounds() = default;
    explicit Bounds(const fw_t &fw) {
      const auto read = [&fw](std::uint16_t object) {
        std::int32_t value = 0;
        (void)fw_object_read(&fw, object, &value);
        return value;
      };
      adc_bits = read(AXIS_OBJ_ADC_BITS);
      zero_code = read(AXIS_OBJ_FORCE_ZERO_CODE);
      sign = read(AXIS_OBJ_FORCE_SIGN);
      tare_q8 = read(AXIS_OBJ_FORCE_TARE);
      contact_q8 = read(AXIS_OBJ_CONTACT_FORCE);
      output_limit = read(AXIS_OBJ_OUTPUT_LIMIT);
      // A multiple of the output's resolution, halves upward, and never more than the limit.
      const int step = 1 << (16 - read(AXIS_OBJ_DAC_BITS));
      const double steps = std::floor(read(AXIS_OBJ_OUTPUT_BIAS) / (1.0 * step) + 0.5);
      bias_fine = std::clamp(static_cast<std::int32_t>(steps) * step, -16 * output_limit,
                             16 * output_limit);
      engage_ticks = read(AXIS_OBJ_BRAKE_ENGAGE_TICKS);
      position_min = read(AXIS_OBJ_POSITION_MIN);
      position_max = read(AXIS_OBJ_POSITION_MAX);
      loss_cap = read(AXIS_OBJ_CONTACT_LOSS_CAP);
      loss_dwell_ms = read(AXIS_OBJ_CONTACT_LOSS_DWELL);
    }

    std::int32_t adc_bits = 8, zero_code = 0, sign = 1, tare_q8 = 0, contact_q8 = 0;
    std::int32_t bias_fine = 0;  // output_bias as it acts, in 1/16 code
    std::int32_t engage_ticks = 0;
    std::int32_t output_limit = 0, position_min = 0, position_max = 0;
    std::int32_t loss_cap = 0, loss_dwell_ms = 0;
    bool operator==(const Bounds &) const = default;
  };

  // The force in 1/256 count of a reading of 16 bits.
  static std::int32_t Reading(const Bounds &bounds, const axis_inputs_t &in) {
    const int step = 1 << (16 - bounds.adc_bits);
    return bounds.sign * (in.adc_code[0] - bounds.zero_code) * step - bounds.tare_q8;
  }

  // The bias was taken away at an end of the travel, beyond which it drove the axis.
  static bool Released(const Bounds &bounds, const axis_inputs_t &in, const axis_outputs_t &out) {
    const auto switches = AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE | AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE;
    const bool ends = (in.din & switches) != 0 || in.encoder_cnt > bounds.position_max ||
                      in.encoder_cnt < bounds.position_min;
    return ends && out.dac_fine == 0 && bounds.bias_fine != 0;
  }

  // The output about output_bias, in whole codes away from 0; a bias that was taken away is no
  // command against it.
  static int Net(const Bounds &bounds, const axis_inputs_t &in, const axis_outputs_t &out) {
    if (Released(bounds, in, out)) return 0;
    const int fine = out.dac_fine - bounds.bias_fine;
    return (fine > 0 ? fine + 15 : fine - 15) / 16;
  }

  // What is wrong with the outputs of a tick, or "". `presses`: mode 4 or 10 is in force in this
  // tick, enabled, neither being left nor stopped with a ramp. `uncertified`: the largest code of a
  // law without a certificate, -1 with one. `test_code`: the largest code of the test before the
  // first motion while it runs, else -1.
  std::string Judge(const Bounds &bounds, const axis_inputs_t &in, const axis_outputs_t &out,
                    bool presses, std::int32_t uncertified = -1, std::int32_t test_code = -1) {
    const std::int32_t reading = Reading(bounds, in);
    const bool touches = std::abs(reading) > bounds.contact_q8;
    const std::string wrong = Wrong(bounds, in, out, presses, touches, uncertified, test_code);
    if (!presses || out.amp_enable == 0) {
      since_contact_ = kNever;
    } else if (touches) {
      since_contact_ = 0;
      side_ = reading > 0 ? 1 : -1;
    }
    touched_ = presses && touches && out.amp_enable != 0;
    const bool comes_on = (in.drive & kDriveOn) == AXIS_DRIVE_REPORT_FITTED;
    engaging_ = out.amp_enable != 0 && out.brake_release == 0 && !comes_on ? engaging_ + 1 : 0;
    // A velocity is that from the last valid count to a count of this tick.
    placed_ = in.sensor_valid != 0 && in.position_age == 0;
    place_ = in.encoder_cnt;
    if (since_contact_ != kNever) ++since_contact_;
    return wrong;
  }

  // The law was left between two ticks: it begins anew, with an approach where nothing is touched.
  void Leave() {
    since_contact_ = kNever;
    touched_ = false;
  }

  // Ticks so far in which the bound on a lost contact was judged, and in which a law pressed.
  long judged_after_loss() const { return after_loss_; }
  long pressed() const { return pressed_; }

 private:
  static constexpr std::int64_t kNever = -1;
  static constexpr int kDriveOn = AXIS_DRIVE_REPORT_FITTED | AXIS_DRIVE_REPORT_ON;

  std::string Wrong(const Bounds &bounds, const axis_inputs_t &in, const axis_outputs_t &out,
                    bool presses, bool touches, std::int32_t uncertified, std::int32_t test_code) {
    const int code = Net(bounds, in, out);
    if (out.amp_enable == 0) {
      return out.dac_code == 0 && out.brake_release == 0 ? "" : Said("the amplifier is off", code);
    }
    if (std::abs(out.dac_fine) > 16 * bounds.output_limit) return Said("output_limit", code);
    // Behind a closed brake the drive comes on, or the bias holds until the brake does.
    if (out.brake_release == 0 && out.dac_fine != 0) {
      if (out.dac_fine != bounds.bias_fine) return Said("the brake engages", code);
      if (engaging_ >= bounds.engage_ticks) return Said("brake_engage_ticks", code);
    }
    const bool fits = in.sensor_valid != 0;
    const bool up = fits && (in.din & AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE) != 0;
    const bool down = fits && (in.din & AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE) != 0;
    if (code > 0 && up) return Said("limit_pos", code);
    if (code < 0 && down) return Said("limit_neg", code);
    const bool above = up || in.encoder_cnt > bounds.position_max;
    const bool below = down || in.encoder_cnt < bounds.position_min;
    if (code > 0 && above) return Said("position_max", code);
    if (code < 0 && below) return Said("position_min", code);
    const auto moved = static_cast<std::int32_t>(static_cast<std::uint32_t>(in.encoder_cnt) -
                                                 static_cast<std::uint32_t>(place_));
    const bool known = fits && placed_ && in.position_age == 0 && !(above && below);
    if (known && above && moved > 0 && out.dac_fine > 0) return Said("moves up", code);
    if (known && below && moved < 0 && out.dac_fine < 0) return Said("moves down", code);
    if (test_code >= 0 && std::abs(code) > test_code) return Said("first_motion_code", code);
    pressed_ += presses && touches ? 1 : 0;
    // The second tick of a contact is the law's at the latest.
    if (uncertified >= 0 && presses && touches && touched_ && std::abs(code) > uncertified) {
      return Said("uncertified_output", code);
    }
    const auto dwell = static_cast<std::int64_t>(std::ceil(1.5 * bounds.loss_dwell_ms));
    if (presses && !touches && since_contact_ != kNever && since_contact_ <= dwell) {
      ++after_loss_;
      if (code * side_ > bounds.loss_cap) return Said("contact_loss_cap", code);
    }
    return "";
  }

  static std::string Said(const char *bound, int code) {
    return std::string(bound) + ": code " + std::to_string(code);
  }

  int engaging_ = 0;                     // ticks with the amplifier on behind a closed brake
  std::int64_t since_contact_ = kNever;  // ticks since the latest one with contact
  int side_ = 0;                         // and the sign of its reading
  bool touched_ = false;                 // in the tick before
  bool placed_ = false;                  // the encoder count of the tick before is valid
  std::int32_t place_ = 0;
  long after_loss_ = 0;
  long pressed_ = 0;
};

#endif
