#pragma once
// A plant described as a network of wires, which are affine functions of the state, and discrete
// switches.
//
// The vector z = (x, 1, u) has the states x, the constant 1 and the command voltage u, which is
// constant during a tick. A wire is a quantity that is a linear function of z when the state of
// every switch is given. Wires are listed in the order of their dependence, so a switch may depend
// on the output of another switch. A switch has a few discrete states: segments of a curve, phases
// of a contact, sliding and sticking. Each state of a switch defines its output wires, and the
// bounds within which signals must stay in this state (channels). A friction that sticks exerts the
// force that keeps the velocities of its ends equal; this force is an unknown that is solved when
// the mode is built. Nothing in this class depends on time.
#include <Eigen/Core>
#include <array>
#include <limits>
#include <string>
#include <vector>

#include "sim/hybrid/wiring.hpp"
#include "sim/matrix/extended.hpp"
#include "sim/model/model.hpp"

namespace forceaxis::sim {

/// A signal that must stay within [low, high] while a switch has a certain state. If the signal
/// leaves this range, the switch changes to another state.
struct Channel {
  int wire = 0;
  int switch_index = 0;
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
  int state_below = 0;  ///< state to which the switch changes when its signal falls below `low`
  int state_above = 0;
};

/// The linear equations of one mode, in SI units.
struct ModeEquations {
  /// Matrix of n x (n + 2) elements that gives the derivatives of the states x from z: x' = flow z.
  ExtendedMatrix flow;
  ExtendedMatrix wires;  ///< matrix that computes the values of all wires from the state z
  std::vector<Channel> channels;
  /// Matrix of n x n elements for the correction x - slip x of the states x. After this correction,
  /// the relative velocity of the ends of each sticking friction is 0. Empty if no friction sticks.
  ExtendedMatrix slip;
};

class Network {
 public:
  using Wire = Wiring::Wire;
  using Switch = Wiring::Switch;

  explicit Network(const Model &model);

  int states() const { return static_cast<int>(wiring_.initial.size()); }
  int columns() const { return states() + 2; }
  int wire_count() const { return static_cast<int>(wiring_.wires.size()); }
  /// For each state, the name of a body or of a mode (STRUCTURE.NUMBER), or the complete name of a
  /// state of an element, of the drive or of a filter.
  const std::vector<std::string> &state_names() const { return wiring_.state_names; }
  /// Indices, in ascending order, of the states that do not belong to the response to an input: the
  /// time, the drift of a sensor, and the integrals of a converter's filter.
  const std::vector<int> &apart() const { return wiring_.apart; }
  const std::vector<double> &initial() const { return wiring_.initial; }
  /// Indices of the states that are set to 0 when the drive is disabled: motor current or actuator
  /// force.
  const std::vector<int> &drive_states() const { return wiring_.drive_states; }

  const std::vector<Switch> &switches() const { return wiring_.switches; }
  static bool enabled(ModeKey key) { return (key & 1U) != 0; }
  int state_of(ModeKey key, int switch_index) const {
    const Switch &s = switches()[static_cast<std::size_t>(switch_index)];
    return static_cast<int>((key >> s.shift) & s.mask);
  }
  ModeKey with_state(ModeKey key, int switch_index, int state) const {
    const Switch &s = switches()[static_cast<std::size_t>(switch_index)];
    return (key & ~(s.mask << s.shift)) | (static_cast<ModeKey>(state) << s.shift);
  }
  /// Returns the key of the mode in which every switch has its initial state.
  ModeKey home_key(bool enable) const;
  /// Returns the key of the first mode of a linear analysis: the drive is enabled and all brakes
  /// are released.
  ModeKey analysed_key() const;
  /// Returns the key for the drive enabled or disabled. The switches of the drive have their
  /// initial state; all other switches have the same state as in `key`.
  ModeKey with_enable(ModeKey key, bool enable) const;

  ModeEquations equations(ModeKey key) const;

  /// The state of the plant that has the shortest time constant in a mode.
  struct Fastest {
    std::string state;    ///< name of the body, drive or filter to which the state belongs
    std::string element;  ///< name of the element of the model that affects this state most
    double rate;          ///< inverse of the time constant with which the state changes, in 1/s
  };
  Fastest fastest(const ModeEquations &equations) const;

  /// Index of the wire of each signal, in the order of Model::signal_list().
  const std::vector<Wire> &signal_wires() const { return wiring_.signal_wires; }
  /// Index of the wire that each ADC converts; -1 if the model does not have the ADC. The wire is
  /// not yet limited to the range of the conversion.
  const std::array<Wire, 2> &adc_wires() const { return wiring_.adc_wires; }
  /// Index of the first integral of the filter of each ADC (Wiring::filter_states); -1: no filter.
  const std::array<int, 2> &filter_states() const { return wiring_.filter_states; }
  /// The bodies of the model, followed by the modes of its structures.
  const std::vector<Wiring::Coordinate> &coordinates() const { return wiring_.coordinates; }
  /// The points of the model (Model::point_names), followed by the modes of its structures.
  const std::vector<Wiring::Point> &points() const { return wiring_.points; }
  const std::vector<Wiring::Memory> &memories() const { return wiring_.memories; }
  const std::vector<Wiring::FrictionEnds> &frictions() const { return wiring_.frictions; }
  const std::vector<Wiring::BrakeTimes> &brakes() const { return wiring_.brakes; }
  /// Energy sources and dampers. Each product is a power in W.
  const std::vector<Wiring::Product> &supplies() const { return wiring_.supplies; }
  const std::vector<Wiring::Product> &dampers() const { return wiring_.dampers; }
  /// Elements that store energy. Each product is twice an energy in J.
  const std::vector<Wiring::Product> &storages() const { return wiring_.storages; }

 private:
  int effective_state(ModeKey key, int switch_index) const;
  void solve_holds(ModeKey key, ModeEquations &equations) const;
  void keep_memories(const ExtendedMatrix &sticking, ModeEquations &equations) const;
  bool sticks(ModeKey key, const Wiring::FrictionEnds &friction) const {
    return state_of(key, friction.switch_index) == Wiring::kStuck;
  }
  // Returns true if a friction sticks and transmits force. A friction parallel to a sticking brake
  // transmits no force.
  bool holds(ModeKey key, const Wiring::FrictionEnds &friction) const {
    return sticks(key, friction) &&
           (friction.beside < 0 ||
            !sticks(key, wiring_.frictions[static_cast<std::size_t>(friction.beside)]));
  }

  Wiring wiring_;
};

}  // namespace forceaxis::sim
