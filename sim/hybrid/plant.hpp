#pragma once
// The simulated axis as the firmware accesses it: the input is a DAC code, the outputs are the
// codes of encoder and ADCs. Separate functions return the true signals.
//
//   auto model = std::make_shared<const Model>(load_model("sim/models/axis_contact.toml"));
//   Plant plant(model);
//   for (int k = 0; k < 3000; ++k) {
//     SensorCodes codes = plant.codes();                        // at t = k / 1500 s
//     plant.step(controller(codes), true);                      // to t = (k + 1) / 1500 s
//   }
//
// For a sweep, build one ModeCache for each Model and pass this cache to every Plant of the model.
// A new plant needs most of its time to build its modes, about 0.1 ms for each mode of six states.
// Any number of plants in any number of threads may share the cache. Only one thread at a time may
// use a Plant. Copies of a plant are independent and continue with the same doubles.
//
// The solution between two ticks is exact to the rounding error: the plant is piecewise linear and
// uses matrix exponentials. The instants of switching are also exact to the rounding error; even an
// overlap of 1e-12 m is found. The same codes give the same doubles in every build of one compiler
// with -ffp-contract=off.
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "sim/hybrid/drive_bus.hpp"
#include "sim/hybrid/machine_law.hpp"
#include "sim/hybrid/sampled_sensor.hpp"
#include "sim/hybrid/sinc_filter.hpp"
#include "sim/hybrid/stepper.hpp"
#include "sim/hybrid/switches.hpp"

namespace forceaxis::sim {

/// Position and velocity of a body at tick 0.
struct BodyStart {
  double position = 0.0;  ///< position in m
  double velocity = 0.0;  ///< velocity in m/s
};

struct PlantOptions {
  /// true: the plant computes its energy balance, which about doubles the computing time of a tick.
  bool audit = false;
  /// Number of events that events() lists. Further events are counted but not listed.
  std::size_t listed_events = 4096;
  /// Seed of the random noise of ADCs and DAC.
  std::uint64_t seed = 0;
  /// Start position and velocity of each body, in the order of Model::bodies. If this list is
  /// empty, the bodies start as the model says. Plants with different starts may share a ModeCache.
  std::vector<BodyStart> starts = {};
};

/// The codes of encoder and ADCs that the firmware reads. The code is 0 if the model does not have
/// the encoder or ADC.
struct SensorCodes {
  /// Encoder count floor(x scale + 1/2), which wraps at 32 bits. With a bus, the count may be from
  /// an earlier tick.
  std::int32_t encoder = 0;
  /// Number of ticks since the encoder count was measured; 255 is 255 ticks or more.
  std::uint8_t encoder_age = 0;
  /// Code of each ADC: clamp(floor(value * (1 / per_count) + 1/2) + zero_code, 0, 2^bits - 1),
  /// where Adc describes the value. The noise depends only on seed, channel and tick (or sample),
  /// so all conversions in one tick give the same code. A sensor with a sample rate or a latency
  /// (SampledSensor) gives the newest sample that has arrived.
  std::uint16_t adc[2] = {0, 0};
  /// Number of ticks, rounded up, since the code of ADC 0 was sampled; 255 is 255 ticks or more.
  std::uint8_t force_age = 0;
  /// States of limit switches, home switch and index pulse, as bits SwitchBit.
  std::uint8_t switches = 0;
  /// Report of a drive with `enable_ticks`, as bits DriveBit; 0 for any other drive.
  std::uint8_t drive = 0;
};

/// A change of one element from one discrete state to another.
struct Event {
  double time_s = 0.0;
  /// Name of the element: a contact, friction, brake, spring, damper or gravity; NAME.hysteresis
  /// for the slider of a contact; NAME.low or NAME.high for a stop; drive.preamp,
  /// drive.current_feedback, drive.amplifier or drive.force; adc0.sensor.
  std::string element;
  /// Names of the states before and after the change. The states of a contact are apart, pressed
  /// and overlap. The states of a friction, a brake or the slider of a contact are backward, stuck,
  /// forward and released. The
  /// states of a curve are low limit, low outer, inner, linear and so on; those of a table are
  /// segment 0, segment 1 and so on.
  std::string from;
  std::string to;
  bool jump = false;  ///< true: a new DAC code or an impulse has changed the state of the switch
};

/// Mechanical energy since tick 0, in J: initial + supplied = kinetic + stored + dissipated +
/// discarded + residual. The residual is the rounding error.
struct EnergyAudit {
  double initial = 0.0;
  double supplied = 0.0;  ///< work in J of drive, gravity and impulses on the bodies
  double impulses = 0.0;  ///< work in J of the impulses on the bodies, included in `supplied`
  double kinetic = 0.0;
  double stored = 0.0;     ///< energy in J that springs and closed contacts store
  double discarded = 0.0;  ///< spring energy in J that was lost when contacts opened and steppers
                           ///< were disabled
  struct Damper {
    /// Name of a spring, damper, contact, friction, brake or structure. "drive" is the friction b_m
    /// of a motor.
    std::string element;
    double energy = 0.0;
  };
  std::vector<Damper> dissipated;  ///< dissipated energies, one entry for each element
  double residual = 0.0;
};

class Plant {
 public:
  explicit Plant(std::shared_ptr<const Model> model, PlantOptions options = {});
  explicit Plant(std::shared_ptr<ModeCache> cache, PlantOptions options = {});

  /// Simulates one step with a constant DAC code: one tick of 1/1500 s, or the fraction of a tick
  /// that is the step of the ModeCache. If `amp_enable` is false, the current (or force) of the
  /// drive is 0 from this instant on and the code has no effect. Throws std::invalid_argument if
  /// the code is outside the range of the DAC, SimulationError if the simulation cannot continue,
  /// InputError if a mode is too fast. After SimulationError or InputError the plant must not be
  /// used.
  void step(int dac_code, bool amp_enable) { step(dac_code, amp_enable, amp_enable); }
  /// Simulates one step. The third argument is the output brake_release of the firmware, which
  /// releases and engages the brakes of the model. If the model has a bus (DriveBus), the firmware
  /// sends code and amp_enable over the bus, and the drive applies them later. brake_release and
  /// the switches are not on the bus. If the model has a controller of the machine, that controller
  /// commands the drive, with brakes released, and the arguments have no effect.
  void step(int dac_code, bool amp_enable, bool brake_release);
  /// Inputs of the plant from an instant of a step on, such as those of another simulator.
  struct Inputs {
    double at = 0.0;  ///< time in steps since the start of the step, from 0 to below 1
    int dac_code = 0;
    bool amp_enable = false;
    bool brake_release = false;
  };
  /// Simulates one step whose inputs change at instants within the step. The first inputs are those
  /// of its start, the others have ascending instants. With one entry, the result is the same
  /// double as that of the function above. A bus of the model carries only the first code and
  /// enable.
  void step(std::span<const Inputs> inputs);
  /// Writes all signals of the instant `at` of the step that step(inputs) would simulate, as
  /// signals() does. The plant does not change. `at` is above 0 and below 1, and not before the
  /// last of the inputs.
  void signals_within(std::span<const Inputs> inputs, double at, std::span<double> values) const;
  /// Returns the voltage in V, with offset and noise, that the DAC outputs for a code in this tick.
  double volts(int dac_code) const;
  /// Simulate one step with a voltage in V in place of a DAC code. The voltage does not pass
  /// through a bus. First hold_volts() applies the voltage, then step_volts() simulates the step
  /// and must have the same arguments. Between the two calls, signals() returns the signals at the
  /// start of the step.
  void hold_volts(double volts, bool amp_enable) {
    if (sampled_) take_samples();
    stepper_.hold(volts, amp_enable);
  }
  void step_volts(double volts, bool amp_enable) { step_volts(volts, amp_enable, amp_enable); }
  void step_volts(double volts, bool amp_enable, bool brake_release) {
    if (sampled_)
      step_sampled(volts, amp_enable, brake_release);
    else
      stepper_.step(volts, amp_enable, brake_release);
  }
  /// Applies an impulse to a body or port at this instant. This changes the velocity of a body by
  /// impulse / mass. Throws std::invalid_argument for an unknown name and for an impulse that is
  /// not finite.
  void apply_impulse(std::string_view point, double impulse_N_s);
  /// Lets the drive fail at this instant. With DriveFailure::none, the drive works again. The call
  /// has an effect only if the model's drive has `enable_ticks`.
  void fail_drive(DriveFailure failure) { bus_.fail(failure); }

  /// Returns the codes of encoder and ADCs at this instant, and updates edge_margin(). The
  /// reference is valid until the next call.
  const SensorCodes &codes();
  /// Returns the value that an ADC would convert at this instant, in the unit of its signal. The
  /// value includes filter, creep, drift and limits. It does not include noise, rounding and the
  /// sample instants and the sinc filter of a converter with its own sample rate. The model must
  /// have the ADC.
  double reading(std::size_t channel);
  /// Returns the position in m that the encoder measures, without rounding. The model must have an
  /// encoder.
  double encoder_place() const {
    return reference_state_ ? relative_place() : stepper_.z()[encoder_state_];
  }
  /// Smallest distance so far, in LSB, between a converted value and the nearest value at which the
  /// code changes. The distance is at most 0.5 unless a converter saturates, and infinite before
  /// the first call of codes().
  double edge_margin() const { return edge_margin_; }

  /// Return the names and values of all signals, in the order and the units of
  /// Model::signal_list(). signals() throws std::invalid_argument if `values` does not have one
  /// element for each signal.
  const std::vector<std::string> &signal_names() const { return *signal_names_; }
  void signals(std::span<double> values) const;
  /// Return one signal in the unit of its SignalInfo. signal() finds the signal by name and throws
  /// std::invalid_argument for an unknown name. signal_at() finds the signal by the index in
  /// signal_names().
  double signal(std::string_view name) const;
  double signal_at(std::size_t place) const;

  /// tick() is the number of steps since the start, time_s() the simulated time in s. One step is 1
  /// / (1500 parts()) s.
  std::int64_t tick() const { return stepper_.tick(); }
  double time_s() const {
    return static_cast<double>(stepper_.tick()) / stepper_.cache().rate_hz();
  }
  const Model &model() const { return stepper_.cache().model(); }
  int parts() const { return stepper_.cache().parts(); }

  /// Returns the first events, at most PlantOptions::listed_events.
  std::vector<Event> events() const;
  /// crossings() is the number of state changes between ticks. jumps() is the number of state
  /// changes that a DAC code or an impulse has caused at a tick.
  std::int64_t crossings() const { return stepper_.crossings(); }
  std::int64_t jumps() const { return stepper_.jumps(); }
  struct EventCount {
    std::string element;
    std::string from;
    std::string to;
    std::int64_t count = 0;
  };
  /// Returns how often each element has changed from one state to another since the start. Changes
  /// that never occurred are omitted.
  std::vector<EventCount> event_counts() const;
  /// Returns the text "element: state" for every element with discrete states. Elements of the
  /// drive have the state "off" while the drive is disabled.
  std::vector<std::string> mode() const;

  /// Returns the energy balance since tick 0. Throws std::logic_error if PlantOptions::audit is
  /// false.
  EnergyAudit energy() const;

  /// State vector: position in m and velocity in m/s of each body, then those of each mode of the
  /// structures, then the states of the elements, of the drive (dc_motor: current in A, filtered
  /// tachometer voltage in V; first_order: force in N) and of the sensors.
  std::span<const double> state() const { return {stepper_.z().data(), stepper_.mode().states}; }

 private:
  class SamplePauses;
  class StepPauses;
  // What the drive and the brakes have after the DAC and the bus.
  struct Command {
    double volts = 0.0;
    bool amp_enable = false;
    bool brake_release = false;
  };
  Command begin_step(const Inputs &inputs);
  void begin_sampled_step();
  double total_energy() const;
  void read_encoder(const Encoder &encoder);
  double relative_place() const;
  std::uint16_t convert(std::size_t channel, double reading, std::int64_t sample);
  void begin_samples(std::size_t channel, const Adc &adc);
  void take_samples();
  void take_sample(std::size_t channel);
  void collect(std::size_t channel, double instant);
  void step_sampled(double volts, bool amp_enable, bool brake_release);

  Stepper stepper_;
  std::shared_ptr<const std::vector<std::string>> signal_names_;
  double volts_per_step_ = 0.0;
  double dac_offset_ = 0.0;
  int lowest_code_ = 0;
  int highest_code_ = 0;
  std::size_t encoder_state_ = 0;
  std::optional<std::size_t> reference_state_;
  double encoder_scale_ = 0.0;
  bool has_encoder_ = false;
  SwitchBank switches_;
  DriveBus bus_;
  struct Converter {
    bool present = false;
    int top = 0;
    int zero_code = 0;
    double limit = 0.0;  // largest magnitude that the analog value may have before the conversion
    double noise = 0.0;
    double counts_per_unit = 0.0;
    // Fraction of a code step that is added before rounding down (Adc::rounding).
    double rounding = 0.5;
    // Values of the signal at which the code changes from 0 to 1 (`low`) and from 2^bits - 2 to
    // 2^bits - 1 (`high`), in counts + `rounding`.
    double low = 0.0;
    double high = 0.0;
    SampledSensor samples;
    SincFilter filter;
    // End of the time, in steps, over which the filter has integrated the signal so far.
    double collected = 0.0;
  };
  static Converter converter_of(const Adc &adc);
  Converter converters_[2];
  bool sampled_ = false;  // true if a converter samples at other instants than the ticks
  std::uint64_t seed_ = 0;
  bool audit_ = false;
  double initial_energy_ = 0.0;
  double edge_margin_ = 0.0;
  // The codes are a member, because a result in registers would be loaded in one piece from memory
  // into which its fields have just been stored one by one. The processor has to wait for such
  // stores.
  SensorCodes codes_;
  // Row of factors that gives the position of the encoder from the states, if a port is one of the
  // encoder's ends. The row is behind the other members, so that they keep their places in the
  // lines of the processor's cache.
  std::vector<double> encoder_row_;
  std::optional<MachineLaw> machine_law_;
  // index of the force signal that the machine controller measures
  std::size_t machine_signal_ = 0;
};

}  // namespace forceaxis::sim
