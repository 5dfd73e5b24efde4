#ifndef TESTS_WIRE_CONTACT_SCENE_HPP_
#define TESTS_WIRE_CONTACT_SCENE_HPP_

#include <algorithm>
#include <cmath>
#include <cstdint>

// A contact as cheap as an axis and a part can be, for tests that want millions of ticks: the axis'
// speed follows its code late, the part is a spring on a body that is struck, swings away and comes
// back. Places in encoder counts, speeds in counts a tick, forces in counts of an 8-bit reading.
class ContactScene {
 public:
  struct Shape {
    double speed_of_code = 0.02;  // counts a tick and code
    double follows = 0.3;         // part of the difference to that speed in a tick
    double stiffness = 0.5;       // of the reading, per count
    double yields = 0.02;  // speed that the part takes from the axis, per count of the reading
    double spring = 0.01;  // that brings the part home
    double damping = 0.1;
    double weight = 0.0;  // code with which the axis stands
  };

  void Take(const Shape &shape) { shape_ = shape; }
  // A blow: the part leaves at this speed; a negative one drives it against the axis.
  void Strike(double speed) { part_speed_ += speed; }
  // The part is taken away by this much, or put back.
  void Move(double counts) { home_ += counts; }

  std::int32_t Encoder() const { return static_cast<std::int32_t>(std::floor(place_ + 0.5)); }
  std::uint16_t Reading() const {
    return static_cast<std::uint16_t>(std::min(255.0, std::floor(Force() + 0.5)));
  }

  void Step(int code, bool on) {
    const double force = Force();
    speed_ += on ? shape_.follows * (shape_.speed_of_code * (code - shape_.weight) - speed_)
                 : -0.05 * speed_;
    speed_ -= std::min(force * shape_.yields, std::abs(speed_) + 2.0);
    place_ += speed_;
    part_speed_ += shape_.spring * (home_ - part_) - shape_.damping * part_speed_;
    part_ += part_speed_;
    // Ends of the guide, and a part that is solid behind its spring.
    const double solid = part_ + 300.0 / shape_.stiffness;
    if (place_ < -kEnd || place_ > std::min(solid, kEnd)) {
      place_ = std::clamp(place_, -kEnd, std::min(solid, kEnd));
      speed_ = 0.0;
    }
  }

 private:
  static constexpr double kEnd = 50000.0;
  double Force() const { return std::max(0.0, (place_ - part_) * shape_.stiffness); }

  Shape shape_;
  double place_ = 0.0, speed_ = 0.0;
  double part_ = 100.0, part_speed_ = 0.0, home_ = 100.0;
};

#endif
