#pragma once
// Simulates a network tick by tick with the exact flow of each mode. Every switch changes at the
// instant at which its signal reaches a bound.
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "sim/hybrid/detector.hpp"
#include "sim/hybrid/energy.hpp"
#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/mode.hpp"

namespace forceaxis::sim {

/// A change of the state of one switch. `jump` marks a change at a tick that a new command or an
/// impulse has caused; other changes are crossings between ticks.
struct SwitchEvent {
  double time_s = 0.0;
  int switch_index = 0;
  int from = 0;
  int to = 0;
  bool jump = false;
};

/// Copies share only the cache, which several threads may use, so a copy may run in another thread.
/// step() allocates memory only for a new mode or a new event.
class Stepper {
 public:
  /// `listed_events` is the number of events that events() lists. All events are counted.
  Stepper(std::shared_ptr<ModeCache> cache, bool audit, std::size_t listed_events);

  /// Simulates one tick with a constant command in V. `release` commands the brakes of the model,
  /// which follow after their release and engage times. Throws SimulationError, and InputError as
  /// ModeCache does.
  void step(double command, bool enable, bool release);
  void step(double command, bool enable) { step(command, enable, enable); }
  /// Applies a command in V at this instant: switches and z() change at once. The next call of
  /// step() must have the same arguments.
  void hold(double command, bool enable);
  /// Adds impulse (N s) / mass to the velocity of a body at this instant. Switches change at once.
  void kick(std::size_t body, double impulse);

  const ModeCache &cache() const { return *cache_; }
  const Network &network() const { return cache_->network(); }
  const Mode &mode() const { return *mode_; }
  /// The vector z = (x, 1, u) at this instant.
  const std::vector<double> &z() const { return z_; }
  /// Returns the signals of the two ADCs at this instant, in SI units. The values are valid until
  /// the next call of any function.
  const double *sensors();
  std::int64_t tick() const { return tick_; }

  const std::vector<SwitchEvent> &events() const { return events_; }
  /// crossings() counts changes between two ticks, both instants included. jumps() counts changes
  /// that a command or an impulse has caused.
  std::int64_t crossings() const { return crossings_; }
  std::int64_t jumps() const { return jumps_; }
  /// Returns how often one switch has changed from state `from` to state `to`, jumps included.
  std::int64_t count(int switch_index, int from, int to) const;

  EnergyIntegrals energy() const { return energy_.integrals(); }
  /// Kinetic energy in J.
  double kinetic() const;
  /// Spring energy in J of each element of Network::storages().
  std::vector<double> stored() const {
    return stored_energies(*mode_, cache_->audit(mode_->key), z_.data());
  }

 private:
  void switch_drive(double command, bool enable);
  void settle(bool count_jumps);
  bool cross(double from, double until);
  void step_with_brakes();
  void move_brake(std::size_t brake, double s);
  int sliding(const Wiring::FrictionEnds &friction) const;
  void expand();
  void evaluate(double s);
  void advance_within_part(double ticks);
  void advance(double ticks);
  void change(std::size_t channel, bool above, double s, bool jump, bool counted);
  void switch_to(int switch_index, int to, double s, bool jump, bool counted);
  void slide(bool counted);
  void set_mode(ModeKey key);
  void check_finite() const;
  void audit_grid(std::size_t parts);
  std::size_t count_place(int switch_index, int from, int to) const;
  [[noreturn]] void fail_switching(int switch_index, double s) const;

  std::shared_ptr<ModeCache> cache_;
  kernel::Multiply multiply_ = kernel::best_multiply();
  const Mode *mode_ = nullptr;
  bool audit_ = false;
  Detector detector_;
  EnergyAccount energy_;
  std::int64_t tick_ = 0;
  std::vector<double> z_;
  double sensors_[kernel::padded(2)] = {};
  // The result of the detector has the ADC signals of this instant.
  bool sensors_in_result_ = false;
  kernel::Vector chain_;  // Taylor coefficients of x: order + 1 blocks of flow_stride values
  kernel::Vector increment_;
  double powers_[64];

  // Command of the model's brakes, and the time in ticks until each brake follows it. The time is
  // infinite after the brake has followed.
  bool release_ = false;
  std::vector<double> brake_due_;

  std::size_t listed_events_ = 0;
  std::vector<SwitchEvent> events_;
  SwitchEvent last_{-1.0, -1, 0, 0, false};  // the last counted event
  bool last_listed_ = false;
  std::int64_t crossings_ = 0;
  std::int64_t jumps_ = 0;
  std::vector<std::int64_t> counts_;
  std::size_t count_stride_ = 0;

  // Modes that this plant has used lately, so that it seldom locks the shared cache.
  struct Recent {
    ModeKey key = 0;
    const Mode *mode = nullptr;
    const ModeAudit *audit = nullptr;
  };
  std::vector<Recent> recent_;
};

}  // namespace forceaxis::sim
