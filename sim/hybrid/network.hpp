#pragma once
// A plant as a network of affine wires and discrete switches.
//
// z = (x, 1, u) holds the states, the constant 1 and the held command voltage. A wire is a quantity
// that is linear in z once every switch has a state; wires are listed in dependency order, so a
// switch may feed on what another one gives. A switch owns a few discrete states (segments of a
// curve, phases of a contact, sliding and sticking); each state says what its output wires are and
// which signals must stay within which bounds for it to last (channels). A friction that sticks
// gives whatever force keeps its ends together: an unknown, solved for when the mode is made.
// Nothing here knows about time.
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "sim/model/model.hpp"

namespace forceaxis::sim {

/// Coefficients are built in extended precision and rounded to double once, when a mode is made.
using Extended = long double;
using ExtendedMatrix = Eigen::Matrix<Extended, Eigen::Dynamic, Eigen::Dynamic>;

/// One bit field per switch, bit 0: drive enabled. Names one mode of the plant.
using ModeKey = std::uint64_t;

/// A signal that must stay within [low, high]; at either bound its switch goes to another state.
struct Channel {
  int wire = 0;
  int switch_index = 0;
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
  int state_below = 0;  ///< state of the switch once the signal is below `low`
  int state_above = 0;
};

/// Everything that is linear in one mode, in SI units.
struct ModeEquations {
  ExtendedMatrix flow;   ///< n x (n + 2): x' = flow z
  ExtendedMatrix wires;  ///< one row per wire
  std::vector<Channel> channels;
  /// n x n: what to take from the states so that frictions that stick have no rate; empty if none
  /// does.
  ExtendedMatrix slip;
};

class Network {
 public:
  using Wire = int;

  /// factor * (state, constant 1, command voltage, another wire or the force of a stuck friction)
  struct Term {
    enum class Of { state, constant, command, wire, hold } of;
    int index;
    Extended factor;
  };
  static Term state(int index, Extended factor = 1) { return {Term::Of::state, index, factor}; }
  static Term constant(Extended value) { return {Term::Of::constant, 0, value}; }
  static Term command(Extended factor = 1) { return {Term::Of::command, 0, factor}; }
  static Term wire(Wire index, Extended factor = 1) { return {Term::Of::wire, index, factor}; }
  static Term hold(int friction) { return {Term::Of::hold, friction, 1}; }

  /// Piecewise-linear curve: segment k lies between breaks[k-1] and breaks[k] and gives
  /// slope * input + offset.
  struct Curve {
    struct Segment {
      std::string name;
      Extended slope;
      Extended offset;
    };
    std::vector<Segment> segments;
    std::vector<double> breaks;
    int home = 0;  ///< the segment to start the search from
  };
  /// y = clamp(x, -limit, limit)
  static Curve clamp(double limit);
  /// Odd curve through 0: slope `inner` up to `corner`, `outer` beyond it, clamped to +-limit. An
  /// infinite corner or limit leaves that feature out.
  static Curve amplifier(double inner, double corner, double outer, double limit);
  /// Continuous, 0 at 0; segments named "segment 0", "segment 1", ...
  static Curve through_origin(const Slopes &slopes);
  /// Through (x[k], y[k]), constant beyond the ends.
  static Curve interpolated(const std::vector<double> &x, const std::vector<double> &y);

  explicit Network(const Model &model);

  int states() const { return static_cast<int>(initial_.size()); }
  int columns() const { return states() + 2; }
  int wire_count() const { return static_cast<int>(wires_.size()); }
  const std::vector<double> &initial() const { return initial_; }
  /// States that the drive's disabling sets to 0 (winding current, actuator force).
  const std::vector<int> &drive_states() const { return drive_states_; }

  struct Switch {
    std::string element;
    std::vector<std::string> state_names;
    int shift = 0;
    ModeKey mask = 0;       ///< field of the switch, not shifted
    bool of_drive = false;  ///< without meaning (held at state 0) while the drive is disabled
    int home = 0;
    int stuck = -1;  ///< a friction's state in which its ends have one velocity
  };
  const std::vector<Switch> &switches() const { return switches_; }
  static bool enabled(ModeKey key) { return (key & 1U) != 0; }
  int state_of(ModeKey key, int switch_index) const {
    const Switch &s = switches_[static_cast<std::size_t>(switch_index)];
    return static_cast<int>((key >> s.shift) & s.mask);
  }
  ModeKey with_state(ModeKey key, int switch_index, int state) const {
    const Switch &s = switches_[static_cast<std::size_t>(switch_index)];
    return (key & ~(s.mask << s.shift)) | (static_cast<ModeKey>(state) << s.shift);
  }
  /// Key with every switch at home.
  ModeKey home_key(bool enable) const;
  /// The same switches with the drive enabled or disabled; those of the drive go home.
  ModeKey with_enable(ModeKey key, bool enable) const;

  ModeEquations equations(ModeKey key) const;

  /// Wire of each signal of Model::signal_list(), in its order.
  const std::vector<Wire> &signal_wires() const { return signal_wires_; }

  /// What each ADC converts, before limits that act at its conversion; -1 without an ADC.
  const std::array<Wire, 2> &adc_wires() const { return adc_wires_; }

  struct BodyState {
    int position;
    int velocity;
    double mass;
  };
  const std::vector<BodyState> &bodies() const { return bodies_; }

  enum FrictionState { kBackward = 0, kStuck = 1, kForward = 2 };
  struct FrictionEnds {
    int switch_index;
    int velocity_a;  ///< state, -1: ground
    int velocity_b;
  };
  const std::vector<FrictionEnds> &frictions() const { return frictions_; }

  /// Power as the product of two wires; or energy, half of that plus a constant one.
  struct Product {
    std::string element;
    Wire first;
    Wire second;
    Wire constant = -1;
  };
  const std::vector<Product> &supplies() const { return supplies_; }  ///< W
  const std::vector<Product> &dampers() const { return dampers_; }    ///< W
  const std::vector<Product> &storages() const { return storages_; }  ///< J, twice

 private:
  using Terms = std::vector<Term>;
  // One case for each state of its selector.
  static constexpr int kAlways = -1;
  static constexpr int kEnable = -2;  // disabled, enabled
  struct WireNode {
    int selector;  // a switch or one of the above
    std::vector<Terms> cases;
  };
  struct Bounds {  // of a channel, in one state of its switch
    Wire wire;
    double low, high;
    int state_below, state_above;
  };
  struct LinkWires {
    Wire force;
    Wire spring_force;
    Wire spring_force_rate;
    Wire deflection;
  };

  int add_state(double initial);
  Wire add_sum(Terms terms) { return add_select(kAlways, {std::move(terms)}); }
  Wire add_select(int selector, std::vector<Terms> cases);
  int add_switch(std::string element, std::vector<std::string> names, bool of_drive, int home);
  // The curve's segments as a switch, or kAlways for a straight line.
  int add_segments(const std::string &element, Wire input, const Curve &curve, bool of_drive);
  Wire add_curve(int segments, Wire input, const Curve &curve);
  Wire add_clamp(const std::string &element, Wire input, double limit, bool of_drive);
  LinkWires add_contact(const std::string &element, Wire deflection, Wire rate, double stiffness,
                        double damping);
  Wire deflection_of(Ends ends, double offset = 0.0);
  Wire rate_of(Ends ends);
  Term position(int body, Extended factor) const;
  Term velocity(int body, Extended factor) const;
  void push(Ends ends, Wire force);
  void add_spring(const Spring &spring);
  void add_damper(const Damper &damper);
  void add_stop(const Stop &stop);
  void add_gravity(const Gravity &gravity);
  void add_friction(const Friction &friction);
  void add_drive(const Model &model);
  void add_motor(const DcMotor &motor, Wire speed, Wire *force);
  void add_adc(std::size_t channel, const Adc &adc);
  void name_signal(const std::string &name, Wire wire);
  void name_link(const std::string &name, const LinkWires &link);
  Wire named(const std::string &name) const;
  int effective_state(ModeKey key, int switch_index) const;
  void solve_holds(ModeKey key, ModeEquations &equations) const;

  std::string file_;
  std::vector<double> initial_;
  std::vector<int> drive_states_;
  std::vector<BodyState> bodies_;
  std::vector<std::vector<Term>> derivatives_;  ///< per state
  std::vector<WireNode> wires_;
  std::vector<Switch> switches_;
  std::vector<std::vector<std::vector<Bounds>>> bounds_;  ///< [switch][state]
  int next_bit_ = 1;
  std::vector<std::pair<std::string, Wire>> named_;
  std::vector<Wire> signal_wires_;
  std::array<Wire, 2> adc_wires_ = {-1, -1};
  std::vector<FrictionEnds> frictions_;
  std::vector<Product> supplies_;
  std::vector<Product> dampers_;
  std::vector<Product> storages_;
};

}  // namespace forceaxis::sim
