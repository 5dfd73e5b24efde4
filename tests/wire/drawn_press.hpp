#ifndef TESTS_WIRE_DRAWN_PRESS_HPP_
#define TESTS_WIRE_DRAWN_PRESS_HPP_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "firmware/port/host/firmware.hpp"
#include "tests/wire/contact_scene.hpp"

// What the masters of the floods press with. `below` draws a number from 0 to its argument less 1.
template <typename Below>
class DrawnPress {
 public:
  explicit DrawnPress(Below below) : below_(below) {}

  // Draws the bias of Law() too, which holds the weight.
  ContactScene::Shape Shape() {
    bias_ = Pick({0, 0, 37, -60});
    return {.speed_of_code = 0.005 + 0.03 * Share(),
            .follows = 0.05 + 0.9 * Share(),
            .stiffness = 0.1 + 2.0 * Share(),
            .yields = 0.05 * Share(),
            .spring = 0.002 + 0.05 * Share(),
            .damping = 0.3 * Share(),
            .weight = 1.0 * bias_};
  }

  struct Value {
    std::uint16_t object;
    std::int32_t value;
  };

  // The law and what bounds it, in an order in which a disabled axis takes them.
  std::vector<Value> Law(std::int32_t encoder) {
    return {
        {AXIS_OBJ_LATENCY_TICKS, Pick({0, 1})},
        {AXIS_OBJ_BUMP_DECAY_SHIFT, Pick({6, 6, 0, 3, 12})},
        {AXIS_OBJ_CONTACT_LOSS_DWELL, Pick({300, 300, 0, 20})},
        {AXIS_OBJ_CONTACT_LOSS_CAP, Pick({0, 0, 40, 300, 2048})},
        {AXIS_OBJ_OUTPUT_LIMIT, Pick({2048, 2048, 700, 90})},
        {AXIS_OBJ_OUTPUT_BIAS, 16 * bias_},
        {AXIS_OBJ_BRAKE_ENGAGE_TICKS, Pick({0, 0, 5, 45})},
        {AXIS_OBJ_APPROACH_VELOCITY_MAX, Pick({3000, 3000, 15000, 60000})},
        {AXIS_OBJ_TOUCH_VELOCITY_MAX, Pick({0, 3000, 600})},
        {AXIS_OBJ_FORCE_GAIN, Pick({256, 5 * 256, 15 * 256})},
        {AXIS_OBJ_FORCE_SLOPE, Pick({10000, 1000000})},
        {AXIS_OBJ_FORCE_LIMIT, Pick({1000, 1000, 400})},
        {AXIS_OBJ_FORCE_LIMIT_POSITIVE, Pick({65535, 300})},
        {AXIS_OBJ_FORCE_MAX, Pick({0, 0, 0, 200 * 256})},
        {AXIS_OBJ_CERTIFICATE_REQUIRED, Pick({1, 0, 0, 0})},
        {AXIS_OBJ_UNCERTIFIED_OUTPUT, Pick({512, 60})},
        {AXIS_OBJ_UNCERTIFIED_FORCE, Pick({500, 1000})},
        {AXIS_OBJ_POSITION_MIN, INT32_MIN},
        {AXIS_OBJ_POSITION_MAX, Pick({encoder + 150, INT32_MAX, INT32_MAX})},
        {AXIS_OBJ_POSITION_MIN, Pick({encoder - 150, INT32_MIN, INT32_MIN})},
        {AXIS_OBJ_STIFFNESS, Pick({64, 512})},
        {AXIS_OBJ_DAMPING, Pick({64, 512})},
    };
  }

  int Mode() { return Pick({4, 4, 10, 10, -1, -6, -7, -8}); }
  // Of the target, per mille.
  int Force() { return below_(20) == 0 ? Pick({600, 600, 600, 200, 1500, 0, -100}) : 600; }

 private:
  template <std::size_t N>
  int Pick(const int (&of)[N]) {
    return of[below_(N)];
  }
  double Share() { return below_(1001) / 1000.0; }

  Below below_;
  int bias_ = 0;
};

#endif
