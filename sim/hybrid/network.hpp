#pragma once
// A plant as a network of affine wires and discrete switches.
//
// z = (x, 1, u) holds the states, the constant 1 and the held command voltage. A wire is a quantity
// that is linear in z once every switch has a state; wires are listed in dependency order, so a
// switch may depend on another one's output. A switch owns a few discrete states (segments of a
// curve, phases of a contact, sliding and sticking); each state defines its output wires and the
// bounds within which signals must stay for it to last (channels). A friction that sticks exerts
// whatever force keeps its ends together: an unknown, solved for when the mode is built. Nothing
// here depends on time.
#include <Eigen/Core>
#include <array>
#include <limits>
#include <string>
#include <vector>

#include "sim/hybrid/wiring.hpp"
#include "sim/model/model.hpp"

namespace forceaxis::sim {

using ExtendedMatrix = Eigen::Matrix<Extended, Eigen::Dynamic, Eigen::Dynamic>;

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
  /// n x n: slip x is subtracted from the states so that sticking frictions have no rate; empty if
  /// none sticks.
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
  const std::vector<double> &initial() const { return wiring_.initial; }
  /// States that the drive's disabling sets to 0 (winding current, actuator force).
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
  /// Key with every switch at home.
  ModeKey home_key(bool enable) const;
  /// The same with the drive enabled and brakes released, as an analysis wants it.
  ModeKey analysed_key() const;
  /// The same switches with the drive enabled or disabled; those of the drive go home.
  ModeKey with_enable(ModeKey key, bool enable) const;

  ModeEquations equations(ModeKey key) const;

  /// The state with the shortest time constant in a mode.
  struct Fastest {
    std::string state;    ///< a body, or a state of the drive or a filter
    std::string element;  ///< the one that acts on it most
    double rate;          ///< 1/s
  };
  Fastest fastest(const ModeEquations &equations) const;

  /// Wire of each signal of Model::signal_list(), in its order.
  const std::vector<Wire> &signal_wires() const { return wiring_.signal_wires; }
  /// The signal that each ADC converts, before limits that act at its conversion; -1 without an
  /// ADC.
  const std::array<Wire, 2> &adc_wires() const { return wiring_.adc_wires; }
  const std::vector<Wiring::BodyState> &bodies() const { return wiring_.bodies; }
  const std::vector<Wiring::FrictionEnds> &frictions() const { return wiring_.frictions; }
  const std::vector<Wiring::BrakeTimes> &brakes() const { return wiring_.brakes; }
  const std::vector<Wiring::Product> &supplies() const { return wiring_.supplies; }  ///< W
  const std::vector<Wiring::Product> &dampers() const { return wiring_.dampers; }    ///< W
  const std::vector<Wiring::Product> &storages() const { return wiring_.storages; }  ///< J, twice

 private:
  int effective_state(ModeKey key, int switch_index) const;
  void solve_holds(ModeKey key, ModeEquations &equations) const;
  bool sticks(ModeKey key, const Wiring::FrictionEnds &friction) const {
    return state_of(key, friction.switch_index) == Wiring::kStuck;
  }
  // A stuck friction beside a stuck brake bears nothing.
  bool holds(ModeKey key, const Wiring::FrictionEnds &friction) const {
    return sticks(key, friction) &&
           (friction.beside < 0 ||
            !sticks(key, wiring_.frictions[static_cast<std::size_t>(friction.beside)]));
  }

  Wiring wiring_;
};

}  // namespace forceaxis::sim
