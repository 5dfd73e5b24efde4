#pragma once
// The parts of a network: states, wires and switches, and functions that add them for an element.
#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "sim/hybrid/curve.hpp"
#include "sim/model/model.hpp"

namespace forceaxis::sim {

/// Key of one mode of the plant: bit 0 is set if the drive is enabled, and each switch has a bit
/// field with its state.
using ModeKey = std::uint64_t;

/// States, wires and switches of a plant, built by assemble() and read by Network. A wire is a sum
/// of terms, or the one of several sums that the state of a switch selects. A wire uses only wires
/// with a lower index.
struct Wiring {
  using Wire = int;

  /// A factor times a state, the constant 1, the command voltage, another wire or the force of a
  /// sticking friction.
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
  using Terms = std::vector<Term>;

  static constexpr int kAlways = -1;  ///< value of a selector for a wire with only one sum
  static constexpr int kEnable = -2;  ///< value of a selector between drive disabled and enabled
  struct WireNode {
    int selector;  ///< index of the switch that selects a sum, or kAlways or kEnable
    std::vector<Terms> cases;
  };
  struct Switch {
    std::string element;
    std::vector<std::string> state_names;
    int shift = 0;
    ModeKey mask = 0;       ///< mask for the bit field of the switch, not shifted
    bool of_drive = false;  ///< While the drive is disabled, the switch has the state 0.
    int home = 0;
    int stuck = -1;  ///< of a friction: state in which its ends have the same velocity
    /// State of the switch at the start of a linear analysis; -1 for the state `home`.
    int analysed = -1;
  };
  /// The bounds of one signal in one state of a switch; see Channel.
  struct Bounds {
    Wire wire;
    double low, high;
    int state_below, state_above;
  };
  struct BodyState {
    int position;
    int velocity;
    double mass;
  };
  /// kReleased exists for brakes only
  enum FrictionState { kBackward = 0, kStuck = 1, kForward = 2, kReleased = 3 };
  struct FrictionEnds {
    int switch_index;
    int velocity_a;  ///< index of a velocity in the state vector; -1: ground
    int velocity_b;
    /// Of a friction: index in `frictions` of the brake between the same two ends, or -1. While
    /// both stick, the brake transmits all of the force.
    int beside = -1;
  };
  /// A brake, with its delays in s after a change of its command.
  struct BrakeTimes {
    int friction;
    double release_s;
    double engage_s;
  };
  /// A power in W, which is the product of two wires, or an energy in J, which is half of that
  /// product plus a constant wire.
  struct Product {
    std::string element;
    Wire first;
    Wire second;
    Wire constant = -1;
  };
  struct LinkWires {
    Wire force;
    Wire spring_force;
    Wire spring_force_rate;
    Wire deflection;
  };

  int add_state(std::string name, double start);
  Wire add_sum(Terms terms) { return add_select(kAlways, {std::move(terms)}); }
  Wire add_select(int selector, std::vector<Terms> cases);
  int add_switch(std::string element, std::vector<std::string> names, bool of_drive, int home);
  /// Adds a switch with one state for each segment of the curve. Returns kAlways if the curve is a
  /// straight line.
  int add_segments(const std::string &element, Wire input, const Curve &curve, bool of_drive);
  Wire add_curve(int segments, Wire input, const Curve &curve);
  Wire add_clamp(const std::string &element, Wire input, double limit, bool of_drive);
  /// deflection_of() adds the wire x_a - x_b - offset in m, rate_of() its rate of change in m/s.
  Wire deflection_of(Ends ends, double offset = 0.0);
  Wire rate_of(Ends ends);
  /// Adds a force in N between two ends. A positive force accelerates end a backwards and end b
  /// forwards.
  void push(Ends ends, Wire force);
  /// Assigns the name of a signal of Model::signal_list() to a wire.
  void name_signal(const std::string &name, Wire wire_index);
  void name_link(const std::string &name, const LinkWires &link);
  Wire named(const std::string &name) const;

  std::string file;
  std::vector<std::string> state_names;  ///< names of the bodies, for their positions and
                                         ///< velocities
  std::vector<double> initial;
  std::vector<Terms> derivatives;  ///< terms of the derivative of each state
  std::vector<int> drive_states;   ///< indices of the states that are 0 while the drive is disabled
  std::vector<WireNode> wires;
  std::vector<Switch> switches;
  std::vector<std::vector<std::vector<Bounds>>> bounds;  ///< index [switch][state]
  int next_bit = 1;
  std::vector<BodyState> bodies;
  std::vector<FrictionEnds> frictions;  ///< all frictions of the model, followed by the brakes
  std::vector<BrakeTimes> brakes;
  std::vector<Product> supplies;
  std::vector<Product> dampers;
  std::vector<Product> storages;
  std::vector<std::pair<std::string, Wire>> named_wires;
  std::vector<Wire> signal_wires;
  std::array<Wire, 2> adc_wires = {-1, -1};

 private:
  Term position(int body, Extended factor) const;
  Term velocity(int body, Extended factor) const;
};

}  // namespace forceaxis::sim
