#ifndef TESTS_WIRE_PRESS_ORACLE_HPP_
#define TESTS_WIRE_PRESS_ORACLE_HPP_

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <utility>

#include "firmware/port/host/firmware.hpp"
#include "tests/firmware/unit/code_oracle.hpp"

// From one place to another; places wrap.
inline std::int32_t WayFrom(std::int32_t from, std::int32_t to) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(to) -
                                   static_cast<std::uint32_t>(from));
}

// The speed out of contact in modes -1, -6, -7 and -8, from touch_velocity_max, position_gain, the
// encoder and the codes. As the guide and touch.h have it, the mean speed is held: for each count
// that the axis is ahead of it, the largest code that presses falls by a quarter of position_gain.
// So codes that press never drive the axis further ahead, from any tick on, than it takes until the
// code of that tick has fallen to 0. The code from which an approach begins is 0; after a lost
// contact it is that of the contact.
class SpeedOracle {
 public:
  struct Bounds {
    std::int32_t speed, gain_q8;  // touch_velocity_max, position_gain
    bool operator==(const Bounds &) const = default;
  };

  // How many counts the axis is too far ahead after a tick, or 0. `law`: the force law is on.
  // `acts`: so it was before the tick, in one of these modes. Presses toward larger counts.
  int Judge(const Bounds &bounds, std::int32_t encoder, std::int32_t code, bool law, bool acts,
            bool touches) {
    const std::int32_t moved = WayFrom(std::exchange(encoder_, encoder), encoder);
    const bool same = std::exchange(bounds_, bounds) == bounds;
    const std::int32_t before = *std::ranges::max_element(codes_);
    const bool judged = std::exchange(free_, acts && !touches) && free_ && same && codes_[0] > 0 &&
                        bounds.speed != 0 && bounds.gain_q8 != 0;
    std::ranges::rotate(codes_, codes_.end() - 1);
    codes_[0] = code;
    if (!law) codes_.fill(0);
    if (!judged) {
      ahead_ = 0.0;
      least_ = Allowance(before);
      return 0;
    }
    ++judged_;
    ahead_ += moved - bounds.speed / 1500.0;
    // The code falls in every second tick, and the encoder has whole counts.
    const double beyond = ahead_ - least_ - 3.0 * std::abs(moved) - 3.0;
    least_ = std::min(least_, ahead_ + Allowance(*std::ranges::max_element(codes_)));
    return beyond > 0.0 ? 1 + static_cast<int>(beyond) : 0;
  }

  long judged() const { return judged_; }

 private:
  // Counts until a code of this size, or little more, has fallen to 0.
  double Allowance(std::int32_t code) const {
    return bounds_.gain_q8 == 0 ? 0.0 : 4.0 * 256.0 / bounds_.gain_q8 * (std::max(0, code) + 2);
  }

  Bounds bounds_{};
  std::int32_t encoder_ = 0;
  std::array<std::int32_t, 4> codes_{};  // the latest ones of the law, the last one first
  bool free_ = false;                    // out of contact
  double ahead_ = 0.0, least_ = 0.0;     // of the speed's way, and what is allowed of it
  long judged_ = 0;
};

// What no master may bring an axis to that presses, bounces and is struck, in each tick: codes
// (code_oracle.hpp), demanded forces, speeds before and after a contact, faults, and an amplifier
// that is on in a state without power. Written from docs/ and the meanings in
// axis_objects.toml; of what the firmware computes it takes only what it shows: mode, state, demand
// and fault.
class PressOracle {
 public:
  // Before the tick, with what was written since the last one.
  void Before(const fw_t &fw) {
    now_ = State(fw);
    if (now_.code != last_.code || now_.mode != last_.mode) codes_.Leave();
    last_ = now_;
  }

  // What is wrong after it, or "". A loss of the sensors or of the enabling chain is in `in`.
  std::string After(const fw_t &fw, const axis_inputs_t &in, const axis_outputs_t &out) {
    const State &then = last_;
    now_ = State(fw);
    const bool presses = then.goes && (then.mode == 4 || then.mode == 10);
    const bool native = then.goes && (then.mode == -1 || (then.mode <= -6 && then.mode >= -8));
    const bool touches = std::abs(CodeOracle::Reading(then.code, in)) > then.code.contact_q8;
    Count(then, out);
    const int uncertified = then.parameters.uncertified;
    std::string wrong = codes_.Judge(then.code, in, out, presses, presses ? uncertified : -1);
    if (!wrong.empty()) return wrong;
    if (native && then.law && now_.law && uncertified >= 0 &&
        std::abs(CodeOracle::Net(then.code, in, out)) > uncertified) {
      return Said("the code of a law without a certificate", out.dac_code, uncertified);
    }
    wrong = Faults(then, in, out);
    if (wrong.empty() && presses) wrong = Demand(then);
    if (!wrong.empty()) return wrong;
    // At an end of the travel, the code is 0 if the weight alone moves the axis back.
    const bool released = CodeOracle::Released(then.code, in, out);
    const int ahead = speeds_.Judge({then.parameters.touch_speed, then.parameters.gain_q8},
                                    in.encoder_cnt, CodeOracle::Net(then.code, in, out), now_.law,
                                    native && then.law && now_.law && !released, touches);
    return ahead == 0 ? "" : Said("the way beyond touch_velocity_max", ahead, 0);
  }

  // The law was left between two ticks.
  void Leave() { codes_.Leave(); }

  struct Counts {
    long ticks, on, law, coded, lost, after_loss, touch, approach, force_max;

    std::string text() const {
      const auto count = [](long n, const char *of) { return std::to_string(n) + of; };
      return count(ticks, " ticks, ") + count(on, " of them on, ") +
             count(law, " with the force law, ") + count(coded, " with a code; ") +
             count(lost, " contacts lost, ") + count(after_loss, " ticks judged after a loss, ") +
             count(touch, " by touch_velocity_max, ") + count(approach, " in an approach; ") +
             count(force_max, " faults by force_max");
    }
  };
  Counts counts() const {
    Counts all = counts_;
    all.after_loss = codes_.judged_after_loss();
    all.touch = speeds_.judged();
    return all;
  }

 private:
  struct Parameters {
    std::int32_t uncertified, uncertified_force, force_limit, force_limit_positive,
        force_limit_negative, approach_speed, touch_speed, gain_q8, feed;
  };

  struct State {
    State() = default;
    explicit State(const fw_t &fw) : code(fw) {
      const auto read = [&fw](std::uint16_t object) {
        std::int32_t value = 0;
        (void)fw_object_read(&fw, object, &value);
        return value;
      };
      parameters = {
          read(AXIS_OBJ_CERTIFICATE_REQUIRED) != 0 ? read(AXIS_OBJ_UNCERTIFIED_OUTPUT) : -1,
          read(AXIS_OBJ_UNCERTIFIED_FORCE),
          read(AXIS_OBJ_FORCE_LIMIT),
          read(AXIS_OBJ_FORCE_LIMIT_POSITIVE),
          read(AXIS_OBJ_FORCE_LIMIT_NEGATIVE),
          read(AXIS_OBJ_APPROACH_VELOCITY_MAX),
          read(AXIS_OBJ_TOUCH_VELOCITY_MAX),
          read(AXIS_OBJ_POSITION_GAIN),
          read(AXIS_OBJ_FEED)};
      mode = read(AXIS_OBJ_MODES_OF_OPERATION_DISPLAY);
      state = read(AXIS_OBJ_DRIVE_STATE);
      goes = state == AXIS_DRIVE_STATE_OPERATION_ENABLED &&
             read(AXIS_OBJ_MODES_OF_OPERATION) == mode && fw.drive.leaving == 0;
      law = read(AXIS_OBJ_ACTIVE_MODE) == AXIS_MODE_FORCE;
      approaches = read(AXIS_OBJ_ACTIVE_MODE) == AXIS_MODE_POSITION;
      touched = read(AXIS_OBJ_CONTACT) != 0;
      fault = read(AXIS_OBJ_FAULT);
      force_max = read(AXIS_OBJ_FORCE_MAX);
      force_demand = read(AXIS_OBJ_FORCE_DEMAND);
      velocity_demand = read(AXIS_OBJ_VELOCITY_DEMAND);
      position_demand = read(AXIS_OBJ_POSITION_DEMAND);
    }

    CodeOracle::Bounds code;
    Parameters parameters{};
    std::int32_t mode = 0, state = 0, fault = 0, force_max = 0;
    std::int32_t force_demand = 0, velocity_demand = 0, position_demand = 0;
    bool goes = false;  // enabled, and neither stopped with a ramp nor on the way to another mode
    bool law = false, approaches = false, touched = false;
  };

  void Count(const State &then, const axis_outputs_t &out) {
    ++counts_.ticks;
    counts_.on += out.amp_enable != 0;
    counts_.law += now_.law;
    counts_.coded += out.dac_code != 0;
    counts_.lost += then.law && then.touched && !now_.touched;
    counts_.force_max += then.fault == 0 && now_.fault == AXIS_FAULT_FORCE_MAX;
  }

  std::string Faults(const State &then, const axis_inputs_t &in, const axis_outputs_t &out) const {
    const bool off = out.amp_enable == 0 && out.dac_code == 0;
    // Where an option asks for it, the axis slows down before it is off. What the buses time, they
    // time after the outputs.
    const bool slows = now_.state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE;
    const bool late = then.fault == 0 && OfABus(now_.fault);
    if (now_.fault != 0 && !slows && !late && !off) return Said("the amplifier with a fault", 1, 0);
    const int force = std::abs(CodeOracle::Reading(then.code, in));
    const bool too_large = then.force_max != 0 && force > then.force_max;
    const bool no_chain = (in.din & AXIS_DIGITAL_INPUTS_ENABLE) == 0;
    if ((in.sensor_valid == 0 || no_chain || too_large) && !off) {
      return Said("the amplifier in the tick of a fault", 1, 0);
    }
    if (in.sensor_valid == 0 && now_.fault == 0) return Said("the fault", 0, 1);
    if (now_.fault == AXIS_FAULT_FORCE_MAX && then.fault == 0 && !too_large) {
      return Said("a fault by force_max at", force, then.force_max);
    }
    const bool powered =
        then.state >= AXIS_DRIVE_STATE_OPERATION_ENABLED && then.state != AXIS_DRIVE_STATE_FAULT;
    const bool behind_brake = out.brake_release == 0;  // judged by CodeOracle
    return powered || off || behind_brake
               ? ""
               : "the amplifier is on in drive_state " + std::to_string(then.state);
  }

  static bool OfABus(std::int32_t fault) {
    return fault == AXIS_FAULT_HEARTBEAT_LOST || fault == AXIS_FAULT_SOURCE_LOST ||
           fault == AXIS_FAULT_CAN_OFF || fault == AXIS_FAULT_PDO_TIMEOUT;
  }

  // Modes 4 and 10 bound the demanded force and the speed of an approach. A value may exceed its
  // bound if the bound was lowered or the mode began in motion; then it never grows further.
  std::string Demand(const State &then) {
    const Parameters &limits = then.parameters;
    const int part = limits.force_limit * limits.uncertified_force / 1000;
    const int whole =
        limits.uncertified >= 0 ? std::min(limits.force_limit, part) : limits.force_limit;
    const int most = std::max(then.force_demand, std::min(whole, limits.force_limit_positive));
    const int least = std::min(then.force_demand, -std::min(whole, limits.force_limit_negative));
    if (now_.force_demand > most || now_.force_demand < least) {
      return Said("the demanded force", now_.force_demand, now_.force_demand > 0 ? most : least);
    }
    if (!then.approaches || !now_.approaches || limits.feed != 0) return "";
    ++counts_.approach;
    const int speed = std::max(limits.approach_speed, std::abs(then.velocity_demand));
    const int way = std::abs(WayFrom(then.position_demand, now_.position_demand));
    if (std::abs(now_.velocity_demand) > speed) {
      return Said("the speed of an approach", now_.velocity_demand, speed);
    }
    return way <= speed / 1500 + 1 ? ""
                                   : Said("the way of an approach in a tick", way, speed / 1500);
  }

  static std::string Said(const char *what, long long got, long long expected) {
    return std::string(what) + " is " + std::to_string(got) + ", expected " +
           std::to_string(expected);
  }

  CodeOracle codes_;
  SpeedOracle speeds_;
  State last_, now_;  // before the tick, and now
  Counts counts_{};
};

#endif
