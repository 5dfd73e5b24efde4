#pragma once
// The simulated axis at the firmware's interface: DAC code in, encoder and ADC codes out; the true
// signals are read separately.
//
//   auto model = std::make_shared<const Model>(load_model("sim/models/axis_contact.toml"));
//   Plant plant(model);
//   for (int k = 0; k < 3000; ++k) {
//     SensorCodes codes = plant.codes();                        // at t = k / 1500 s
//     plant.step(controller(codes), true);                      // to t = (k + 1) / 1500 s
//   }
//
// Sweeps: build one ModeCache per Model and pass it to every Plant of that model; most of a new
// plant's cost is building its modes (some 0.1 ms each for six states). The cache may be shared by
// any number of plants in any number of threads. A Plant itself belongs to one thread at a time;
// copies are independent (and continue with the same doubles).
//
// Between two ticks the plant is exact to rounding: piecewise linear, matrix exponentials,
// switching instants located to rounding (dips of 1e-12 m are found). The same codes give the same
// doubles in every build of one compiler with -ffp-contract=off.
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sim/hybrid/stepper.hpp"
#include "sim/hybrid/switches.hpp"

namespace forceaxis::sim {

struct PlantOptions {
  bool audit = false;                ///< keep the energy balance (about doubles the cost of a tick)
  std::size_t listed_events = 4096;  ///< events kept for events(); further ones are only counted
  std::uint64_t seed = 0;            ///< of the noise of ADCs and DAC
};

/// The raw codes that the axis controller reads. A missing encoder or ADC reads 0.
struct SensorCodes {
  std::int32_t encoder = 0;  ///< floor(x scale + 1/2), wraps
  /// clamp(floor(reading * (1 / per_count) + 1/2) + zero_code, 0, 2^bits - 1), with the reading of
  /// Adc. Noise is a function of seed, channel and tick alone: converting twice yields the same
  /// code.
  std::uint16_t adc[2] = {0, 0};
  std::uint8_t switches = 0;  ///< SwitchBit; those of the model's [switches]
};

/// One change of one element's discrete state.
struct Event {
  double time_s = 0.0;
  /// The name of a contact, friction, brake, spring, damper or gravity; NAME.low, NAME.high of a
  /// stop; drive.preamp, .current_feedback, .amplifier, .force; adc0.sensor
  std::string element;
  /// apart, pressed, overlap | backward, stuck, forward, released | low limit, low outer, inner,
  /// linear, ... | segment 0, segment 1, ...
  std::string from;
  std::string to;
  bool jump = false;  ///< the direct consequence of a new DAC code or of an impulse, at a tick
};

/// Mechanical energy since tick 0, J. initial + supplied = kinetic + stored + dissipated +
/// discarded + residual; the residual is rounding.
struct EnergyAudit {
  double initial = 0.0;
  double supplied = 0.0;  ///< work of the drive on body and reaction, of gravity and impulses
  double impulses = 0.0;  ///< the impulses' part of it
  double kinetic = 0.0;
  double stored = 0.0;     ///< in springs and pressed contacts
  double discarded = 0.0;  ///< in a contact's spring when it separates while still overlapping
  struct Damper {
    std::string element;  ///< spring, damper, contact, friction, brake, or "drive" for b_m
    double energy = 0.0;
  };
  std::vector<Damper> dissipated;
  double residual = 0.0;
};

class Plant {
 public:
  explicit Plant(std::shared_ptr<const Model> model, PlantOptions options = {});
  explicit Plant(std::shared_ptr<ModeCache> cache, PlantOptions options = {});

  /// One tick (1/1500 s, or the part of it that the ModeCache steps) with the code held.
  /// `amp_enable` false: coasting, the drive's current (or force) is 0 from this instant on and the
  /// code has no effect. Throws std::invalid_argument if the code does not fit the DAC,
  /// SimulationError if it cannot be stepped on, InputError if a mode is too fast; after either the
  /// plant must not be used.
  void step(int dac_code, bool amp_enable) { step(dac_code, amp_enable, amp_enable); }
  /// The same with the firmware's output brake_release, on which the model's brakes act.
  void step(int dac_code, bool amp_enable, bool brake_release);
  /// The DAC's output in V for a code in this tick, offset and noise included.
  double volts(int dac_code) const;
  /// step() with a command in V in place of a code, in two halves, so that signals() can be read
  /// between them: hold_volts() applies the command, step_volts() steps with the same values.
  void hold_volts(double volts, bool amp_enable) { stepper_.hold(volts, amp_enable); }
  void step_volts(double volts, bool amp_enable) { step_volts(volts, amp_enable, amp_enable); }
  void step_volts(double volts, bool amp_enable, bool brake_release) {
    stepper_.step(volts, amp_enable, brake_release);
  }
  /// Adds impulse / mass to the body's velocity, now. Throws std::invalid_argument for an unknown
  /// body or an impulse that is not finite.
  void apply_impulse(std::string_view body, double impulse_N_s);

  /// Converts encoder and ADCs at this instant and updates edge_margin().
  SensorCodes codes();
  /// The closest approach so far, in LSB, of any value converted by codes() to a value at which its
  /// code would change; 0.5 at most as long as nothing saturates. Infinite before the first
  /// codes().
  double edge_margin() const { return edge_margin_; }

  /// Names and values of all signals, in the order and units of Model::signal_list(). `values` must
  /// have as many places (std::invalid_argument otherwise).
  const std::vector<std::string> &signal_names() const { return *signal_names_; }
  void signals(std::span<double> values) const;
  /// One signal, in the unit of its SignalInfo. By name: std::invalid_argument if there is none. By
  /// place in signal_names(): one product, cheap enough for every tick.
  double signal(std::string_view name) const;
  double signal_at(std::size_t place) const;

  /// Steps done so far, and their time; one step is 1 / (1500 parts()) s.
  std::int64_t tick() const { return stepper_.tick(); }
  double time_s() const {
    return static_cast<double>(stepper_.tick()) / stepper_.cache().rate_hz();
  }
  const Model &model() const { return stepper_.cache().model(); }
  int parts() const { return stepper_.cache().parts(); }

  /// The first `listed_events` events.
  std::vector<Event> events() const;
  /// Changes located between ticks, and changes caused at a tick by a code or an impulse.
  std::int64_t crossings() const { return stepper_.crossings(); }
  std::int64_t jumps() const { return stepper_.jumps(); }
  struct EventCount {
    std::string element;
    std::string from;
    std::string to;
    std::int64_t count = 0;
  };
  /// All changes so far, by kind; kinds that did not occur are omitted.
  std::vector<EventCount> event_counts() const;
  /// "element: state" of every switching element; "off" for the drive's while it is disabled.
  std::vector<std::string> mode() const;

  /// Needs PlantOptions::audit, std::logic_error otherwise.
  EnergyAudit energy() const;

  /// State vector: position and velocity of each body, then the drive's states (dc_motor: current
  /// A, filtered tachometer V; first_order: force N).
  std::span<const double> state() const { return {stepper_.z().data(), stepper_.mode().states}; }

 private:
  double total_energy() const;

  Stepper stepper_;
  std::shared_ptr<const std::vector<std::string>> signal_names_;
  double volts_per_code_ = 0.0;
  double dac_offset_ = 0.0;
  int lowest_code_ = 0;
  int highest_code_ = 0;
  std::size_t encoder_state_ = 0;
  std::optional<std::size_t> reference_state_;
  double encoder_scale_ = 0.0;
  bool has_encoder_ = false;
  SwitchBank switches_;
  struct Converter {
    bool present = false;
    int top = 0;
    int zero_code = 0;
    double limit = 0.0;  // of the reading
    double noise = 0.0;
    double counts_per_unit = 0.0;
    double low = 0.0;  // of signal counts + 1/2, where the code leaves 0
    double high = 0.0;
  };
  Converter converters_[2];
  std::uint64_t seed_ = 0;
  bool audit_ = false;
  double initial_energy_ = 0.0;
  double edge_margin_ = 0.0;
};

}  // namespace forceaxis::sim
