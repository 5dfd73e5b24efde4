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

/// One bit field per switch, bit 0: drive enabled. Names one mode of the plant.
using ModeKey = std::uint64_t;

/// States, wires and switches, built by assemble() and read by Network. A wire is a sum of terms,
/// or one of several sums, chosen by the state of a switch; it uses only wires before it.
struct Wiring {
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
  using Terms = std::vector<Term>;

  static constexpr int kAlways = -1;  ///< selector of a wire with one case
  static constexpr int kEnable = -2;  ///< selector of the cases disabled, enabled
  struct WireNode {
    int selector;  ///< a switch or one of the above
    std::vector<Terms> cases;
  };
  struct Switch {
    std::string element;
    std::vector<std::string> state_names;
    int shift = 0;
    ModeKey mask = 0;       ///< field of the switch, not shifted
    bool of_drive = false;  ///< without meaning (held at state 0) while the drive is disabled
    int home = 0;
    int stuck = -1;     ///< a friction's state in which its ends have one velocity
    int analysed = -1;  ///< the state that an analysis begins with; -1: home
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
  enum FrictionState { kBackward = 0, kStuck = 1, kForward = 2, kReleased = 3 };  ///< of a brake
  struct FrictionEnds {
    int switch_index;
    int velocity_a;  ///< state, -1: ground
    int velocity_b;
    int beside = -1;  ///< of a friction the brake between the same ends, which bears all while both
                      ///< stick: a place in this list
  };
  /// A brake among the frictions; times in s from the change of its command.
  struct BrakeTimes {
    int friction;
    double release_s;
    double engage_s;
  };
  /// Power, W: the product of two wires; or energy, J: half of that product plus a constant wire.
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
  /// The curve's segments as a switch, or kAlways for a straight line.
  int add_segments(const std::string &element, Wire input, const Curve &curve, bool of_drive);
  Wire add_curve(int segments, Wire input, const Curve &curve);
  Wire add_clamp(const std::string &element, Wire input, double limit, bool of_drive);
  /// x_a - x_b - offset, m, and its rate, m/s.
  Wire deflection_of(Ends ends, double offset = 0.0);
  Wire rate_of(Ends ends);
  /// Adds a force in N: positive pushes end a back and end b forward.
  void push(Ends ends, Wire force);
  /// Assigns the name of a signal of Model::signal_list() to a wire.
  void name_signal(const std::string &name, Wire wire_index);
  void name_link(const std::string &name, const LinkWires &link);
  Wire named(const std::string &name) const;

  std::string file;
  std::vector<std::string> state_names;  ///< a body's own name for its position and velocity
  std::vector<double> initial;
  std::vector<Terms> derivatives;  ///< per state
  std::vector<int> drive_states;   ///< set to 0 when the drive is disabled
  std::vector<WireNode> wires;
  std::vector<Switch> switches;
  std::vector<std::vector<std::vector<Bounds>>> bounds;  ///< [switch][state]
  int next_bit = 1;
  std::vector<BodyState> bodies;
  std::vector<FrictionEnds> frictions;  ///< brakes too, after all others
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
