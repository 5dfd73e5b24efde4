#pragma once
// Steps a network tick by tick: z -> exact flow, with every switch changed at the instant it must.
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "sim/hybrid/detector.hpp"
#include "sim/hybrid/energy.hpp"
#include "sim/hybrid/kernel.hpp"
#include "sim/hybrid/mode.hpp"

namespace forceaxis::sim {

/// A change of a switch's state. `jump`: not a crossing between ticks but the direct consequence of
/// a new command or an impulse at a tick.
struct SwitchEvent {
  double time_s = 0.0;
  int switch_index = 0;
  int from = 0;
  int to = 0;
  bool jump = false;
};

/// Copyable; copies share only the cache (which may be used from several threads), so a copy may
/// move to another thread. step() allocates nothing except when a mode or an event is new.
class Stepper {
 public:
  /// `listed_events`: how many events are kept for events(); all are counted.
  Stepper(std::shared_ptr<ModeCache> cache, bool audit, std::size_t listed_events);

  /// One tick with the command in V held; `release` acts on the model's brakes, after their times.
  /// Throws SimulationError, InputError (as ModeCache).
  void step(double command, bool enable, bool release);
  void step(double command, bool enable) { step(command, enable, enable); }
  /// Applies the command at this instant: switches and z() change at once. The next step() must
  /// have the same arguments.
  void hold(double command, bool enable);
  /// Adds impulse (N s) / mass to the velocity of a body at this instant; switches change at once.
  void kick(std::size_t body, double impulse);

  const ModeCache &cache() const { return *cache_; }
  const Network &network() const { return cache_->network(); }
  const Mode &mode() const { return *mode_; }
  /// z = (x, 1, u) now.
  const std::vector<double> &z() const { return z_; }
  /// The signals that the two ADCs convert now, in SI units; valid until any other call.
  const double *sensors();
  std::int64_t tick() const { return tick_; }

  const std::vector<SwitchEvent> &events() const { return events_; }
  /// Changes located between two ticks (and at the end points of a tick's interval), and jumps.
  std::int64_t crossings() const { return crossings_; }
  std::int64_t jumps() const { return jumps_; }
  /// Changes of one switch from one state to another, jumps included.
  std::int64_t count(int switch_index, int from, int to) const;

  EnergyIntegrals energy() const { return energy_.integrals(); }
  /// J.
  double kinetic() const;
  /// Spring energy in J, one entry per Network::storages().
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
  bool sensors_in_result_ = false;  // of the detector: the last tick was quiet, nothing since
  kernel::Vector chain_;            // Taylor coefficients of x, order + 1 blocks of flow_stride
  kernel::Vector increment_;
  double powers_[64];

  // The command of the model's brakes, and when each acts on it, ticks from now; infinite: it has.
  bool release_ = false;
  std::vector<double> brake_due_;

  std::size_t listed_events_ = 0;
  std::vector<SwitchEvent> events_;
  SwitchEvent last_{-1.0, -1, 0, 0, false};  // counted last
  bool last_listed_ = false;
  std::int64_t crossings_ = 0;
  std::int64_t jumps_ = 0;
  std::vector<std::int64_t> counts_;
  std::size_t count_stride_ = 0;

  // Modes met lately, so that the shared cache is asked (and locked) rarely.
  struct Recent {
    ModeKey key = 0;
    const Mode *mode = nullptr;
    const ModeAudit *audit = nullptr;
  };
  std::vector<Recent> recent_;
};

}  // namespace forceaxis::sim
