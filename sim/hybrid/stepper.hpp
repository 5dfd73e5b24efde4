#pragma once
// Simulates a network tick by tick with the exact solution of each mode. Every switch changes at
// the instant at which a signal reaches a bound of this switch.
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "sim/hybrid/detector.hpp"
#include "sim/hybrid/energy.hpp"
#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/mode.hpp"

namespace forceaxis::sim {

/// A change of the state of one switch. `jump` is true if a new command or an impulse at a tick has
/// caused the change. All other changes occur between ticks.
struct SwitchEvent {
  double time_s = 0.0;
  int switch_index = 0;
  int from = 0;
  int to = 0;
  bool jump = false;
};

/// Simulates one plant. Copies share only the cache of modes, which is thread-safe, so a copy may
/// run in another thread. step() allocates memory only for a new mode or a new event.
class Stepper {
 public:
  /// `listed_events` is the number of events that events() lists. All events are counted. `start`
  /// has the position in m and the velocity in m/s of each body at tick 0. If `start` is empty, the
  /// bodies start as the model says.
  Stepper(std::shared_ptr<ModeCache> cache, bool audit, std::size_t listed_events,
          const std::vector<double> &start = {});

  /// Simulates one tick with a constant command in V. `release` is the command for the brakes,
  /// which act after their release or engage time. Throws SimulationError, or InputError for a mode
  /// that is too fast for a ModeCache.
  void step(double command, bool enable, bool release);
  void step(double command, bool enable) { step(command, enable, enable); }
  /// Instants within a tick at which the caller needs the state.
  class Pauses {
   public:
    /// Returns the next instant, as the time in ticks since the start of the present tick. The time
    /// is above 0. A time of 1 or more is not in this tick.
    virtual double next() const = 0;
    /// The stepper calls this function at the instant that next() has returned. sensors() and z()
    /// then have the values of this instant. After the call, next() must return a later instant.
    virtual void pause() = 0;

   protected:
    ~Pauses() = default;
  };
  /// Simulates one tick and calls pauses.pause() at each of the instants.
  void step(double command, bool enable, bool release, Pauses &pauses);
  /// Replaces the arguments of the present step() at an instant, in ticks since the start of the
  /// step. Only Pauses::pause() may call this function, with the instant of the pause.
  void replace(double at, double command, bool enable, bool release) {
    command_brakes(release, at);
    hold(command, enable);
  }
  /// Applies a command in V at this instant, so switches and z() change before time advances. The
  /// next call of step() must have the same arguments.
  void hold(double command, bool enable);
  /// Sets some states to 0 at this instant. No signal of a switch or an ADC depends on them.
  void clear(std::size_t first_state, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) z_[first_state + i] = 0.0;
  }
  /// Applies an impulse in N s to a point (Network::points) at this instant. This changes the
  /// velocity of a body by impulse / mass. Switches change before time advances.
  void kick(std::size_t point, double impulse);

  const ModeCache &cache() const { return *cache_; }
  const Network &network() const { return cache_->network(); }
  const Mode &mode() const { return *mode_; }
  /// Returns the vector z = (x, 1, u) at this instant.
  const std::vector<double> &z() const { return z_; }
  /// Returns the signals of the two ADCs at this instant, in SI units. The values are valid until
  /// the next call of any function.
  const double *sensors();
  std::int64_t tick() const { return tick_; }

  const std::vector<SwitchEvent> &events() const { return events_; }
  /// crossings() is the number of switch changes between ticks, including changes exactly at a
  /// tick. jumps() is the number of switch changes that a command or an impulse has caused.
  std::int64_t crossings() const { return crossings_; }
  std::int64_t jumps() const { return jumps_; }
  /// Returns how often one switch has changed from the state `from` to the state `to`, jumps
  /// included.
  std::int64_t count(int switch_index, int from, int to) const;

  EnergyIntegrals energy() const { return energy_.integrals(); }
  /// Returns the kinetic energy in J.
  double kinetic() const;
  /// Returns the spring energy in J of each element of Network::storages().
  std::vector<double> stored() const { return stored_energies(*mode_, z_.data()); }

 private:
  // Result of a search for the next change of a switch.
  struct Progress {
    // time in ticks by which the last step has advanced the state of the plant
    double passed = 0.0;
    bool changed = false;
    Detector::Change next;  // next change of a switch; valid if `changed` is true
  };

  void switch_drive(double command, bool enable);
  void settle(bool count_jumps);
  bool cross(double from, double until);
  bool cross_grid(double rest, bool quiet, bool whole, Progress *progress);
  Progress cross_pieces(double rest);
  Progress advance_pieces(double rest);
  void end_piece(std::size_t k, const double *end);
  void command_brakes(bool release, double at = 0.0);
  std::size_t next_brake() const;
  void step_in_parts(Pauses *pauses);
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
  void audit_whole(std::size_t halvings);
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
  // true: detector_.result() has the ADC signals of this instant.
  bool sensors_in_result_ = false;
  // Taylor coefficients of the states x: order + 1 blocks of flow_stride values.
  kernel::Vector chain_;
  kernel::Vector increment_;
  double powers_[64];

  // Command for all brakes, and the time in ticks until each brake changes its state. The time is
  // infinite if the brake has changed its state since the last command.
  bool release_ = false;
  std::vector<double> brake_due_;

  std::size_t listed_events_ = 0;
  std::vector<SwitchEvent> events_;
  SwitchEvent last_{-1.0, -1, 0, 0, false};  // last event that was counted
  bool last_listed_ = false;
  std::int64_t crossings_ = 0;
  std::int64_t jumps_ = 0;
  std::vector<std::int64_t> counts_;
  std::size_t count_stride_ = 0;

  // Modes that this plant has used most recently. To use them again, the plant need not lock the
  // shared cache.
  struct Recent {
    ModeKey key = 0;
    const Mode *mode = nullptr;
    const EnergyForms *forms = nullptr;  // quadratic forms of the energies; nullptr: not requested
    int parts = 0;  // number of intervals of the time grid whose energies were computed without the
                    // matrices `forms`
  };
  std::vector<Recent> recent_;
  Recent *current_ = nullptr;  // element of `recent_` for the present mode of the plant
};

}  // namespace forceaxis::sim
