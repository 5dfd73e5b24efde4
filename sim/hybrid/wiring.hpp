#pragma once
// The parts of a network: states, wires and switches, with functions that add these parts for an
// element.
#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "sim/hybrid/curve.hpp"
#include "sim/model/model.hpp"

namespace forceaxis::sim {

/// Key that identifies one mode of the plant. Bit 0 is set if the drive is enabled. Each switch has
/// a bit field with its state.
using ModeKey = std::uint64_t;

/// States, wires and switches of a plant. assemble() builds a Wiring; Network reads it. A wire is a
/// quantity of the plant: a sum of terms, or one of several sums, which the state of a switch
/// selects. The terms of a wire refer only to wires with a lower index.
struct Wiring {
  using Wire = int;

  /// A term of a sum: a factor times a state, the constant 1, the command voltage, another wire, or
  /// the force of a sticking friction.
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

  /// Selector of a wire that has one sum in all modes.
  static constexpr int kAlways = -1;
  /// Selector of a wire with two sums: the first for a disabled drive, the second for an enabled
  /// drive.
  static constexpr int kEnable = -2;
  struct WireNode {
    int selector;  ///< index of the switch that selects one of several sums as the value of this
                   ///< wire; kAlways, kEnable: no switch selects it
    std::vector<Terms> cases;
  };
  struct Switch {
    std::string element;
    std::vector<std::string> state_names;
    int shift = 0;
    ModeKey mask = 0;  ///< mask of the bits of a mode number that contain the state of this switch,
                       ///< before the shift
    bool of_drive = false;  ///< true: the switch has the state 0 while the drive is disabled
    int home = 0;
    /// State in which the ends of a friction have the same velocity; -1 for other switches.
    int stuck = -1;
    /// State of the switch at the start of a linear analysis; -1 means the state `home`.
    int analysed = -1;
  };
  /// The bounds of one signal while a switch has a certain state. The fields have the same meaning
  /// as in Channel.
  struct Bounds {
    Wire wire;
    double low, high;
    int state_below, state_above;
  };
  /// A body, or a mode of a structure, with its position, velocity and mass.
  struct Coordinate {
    int position;  ///< index of the state that is the position of the body or mode
    int velocity;  ///< index of the state that is the velocity of the body or mode
    double mass;
  };
  /// One term of the motion of a point, which is a sum of coordinates with factors.
  struct Share {
    int coordinate;
    double factor;
  };
  using Point = std::vector<Share>;
  /// One term of the velocity of an end of a friction, which is a sum of states with factors. The
  /// sum is empty for the ground.
  struct StateShare {
    int state;
    Extended factor;
  };
  /// State of a friction, a brake or the slider of a contact. Only brakes have the state kReleased.
  enum FrictionState { kBackward = 0, kStuck = 1, kForward = 2, kReleased = 3 };
  struct FrictionEnds {
    int switch_index;
    std::vector<StateShare> velocity_a;
    std::vector<StateShare> velocity_b;
    /// Index in `frictions` of the brake between the same two ends; -1 if there is no such brake.
    /// While friction and brake stick, the brake transmits all of the force.
    int beside = -1;
  };
  /// Delays of a brake in s from a change of its command to the change of its state.
  struct BrakeTimes {
    int friction;
    double release_s;
    double engage_s;
  };
  /// A power in W or an energy in J. A power is the product first * second of two wires. An energy
  /// is half of this product, plus the wire `constant`.
  struct Product {
    std::string element;
    Wire first;
    Wire second;
    Wire constant = -1;
  };
  /// The deflection of the spring of a hysteresis: a state whose derivative is either 0 or that of
  /// the wire `deflection`.
  struct Memory {
    int state;
    Wire deflection;
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
  /// deflection_of() adds a wire for the deflection x_a - x_b - offset in m. rate_of() adds a wire
  /// for the derivative of the deflection in m/s.
  Wire deflection_of(Ends ends, double offset = 0.0);
  Wire rate_of(Ends ends);
  /// Adds a wire for the position in m or the velocity in m/s of a point.
  Wire position_of(int point) { return add_sum(positions(point, 1)); }
  Wire velocity_of(int point) { return add_sum(velocities(point, 1)); }
  /// Adds a force in N between two ends. A positive force accelerates end a backwards and end b
  /// forwards.
  void push(Ends ends, Wire force);
  /// Assigns the name of a signal in Model::signal_list() to a wire.
  void name_signal(const std::string &name, Wire wire_index);
  void name_link(const std::string &name, const LinkWires &link);
  Wire named(const std::string &name) const;

  std::string file;
  /// For each state, the name of a body, of a drive's state or of a filter.
  std::vector<std::string> state_names;
  std::vector<double> initial;
  std::vector<Terms> derivatives;  ///< for each state of the plant, the terms of the sum that is
                                   ///< the derivative of the state
  std::vector<int> drive_states;   ///< indices of the states that are 0 while the drive is disabled
  std::vector<WireNode> wires;
  std::vector<Switch> switches;
  /// Bounds of each state of each switch: bounds[switch][state].
  std::vector<std::vector<std::vector<Bounds>>> bounds;
  int next_bit = 1;
  /// Index of the state that counts the ticks; -1: no element needs the time.
  int clock = -1;
  /// The bodies of the model, followed by the modes of its structures.
  std::vector<Coordinate> coordinates;
  /// The points of the model (Model::point_names), followed by the modes of its structures.
  std::vector<Point> points;
  std::vector<Memory> memories;
  std::vector<FrictionEnds> frictions;  ///< all friction elements of the model, followed by all
                                        ///< brakes
  std::vector<BrakeTimes> brakes;
  std::vector<Product> supplies;
  std::vector<Product> dampers;
  std::vector<Product> storages;
  std::vector<std::pair<std::string, Wire>> named_wires;
  std::vector<Wire> signal_wires;
  std::array<Wire, 2> adc_wires = {-1, -1};
  /// Index of the state that is the first integral of the filter of each converter; -1: no filter.
  /// The states of the other integrals follow.
  std::array<int, 2> filter_states = {-1, -1};
  /// Indices, in ascending order, of the states that do not belong to the response to an input: the
  /// clock, the drift of a sensor, and the integrals of a converter's filter.
  std::vector<int> apart;

 protected:
  const Coordinate &coordinate_of(const Share &share) const {
    return coordinates[static_cast<std::size_t>(share.coordinate)];
  }
  const Point &point(int index) const { return points[static_cast<std::size_t>(index)]; }
  Terms positions(int point, Extended sign) const;
  Terms velocities(int point, Extended sign) const;
};

}  // namespace forceaxis::sim
