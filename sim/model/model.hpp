#pragma once
// The description of a plant from a model file. The description is checked and immutable, and
// contains no equations of motion.
//
// load_model() reads a TOML file and returns a Model that satisfies every rule below, or throws
// InputError. The message is one line that names the file, the key, the expected value and the
// remedy. The only other exception is std::bad_alloc. Positive motion is towards the workpiece. All
// quantities are in SI units.
//
// model_format.cpp declares tables and keys; docs/guide/reference/model.md is generated from it.
//
// A value is a number in SI units, a quantity such as "400 kN/m" (units.hpp), the name of a
// parameter, or "-name". The value of a parameter is a number in its unit, a quantity, or a product
// or quotient of other parameters and numbers, "m / tau" (expression.hpp). One end of `between` may
// be "ground". The deflection is d = x_a - x_b, minus `gap` for a contact. A positive force
// accelerates end a backwards and end b forwards.
// * A structure has modes of vibration and ports. Its mode i with the modal mass m has the modal
//   coordinate q_i, and the port p has the position x_p:
//     m q_i'' + 2 damping_ratio w m q_i' + w^2 m q_i = sum over p of shape_ip F_p,  w = 2 pi f
//     x_p = sum over i of shape_ip q_i
//   F_p is the sum of the forces on the port. A port may be an end of every element.
// * A piecewise-linear curve has ascending breaks and slope k between breaks[k-1] and breaks[k].
//   The curve is continuous and passes through the origin. A spring may have `loads` in N in place
//   of breaks.
// * A contact exerts k d + b d' while d > 0 and this sum is > 0; otherwise its force is 0.
// * A contact with hysteresis exerts k d + h e while this is > 0. The deflection e of the spring h
//   follows d until |h e| reaches the slip force, at which it stays while the slider slips.
// * A stop has such a contact at each end of the range low < d < high. A backlash is a stop at
//   -width/2 and +width/2.
// * A friction opposes sliding with the force `coulomb`. The friction sticks at d' = 0 while the
//   force that keeps d' = 0 is at most `stiction`. Frictions must not form a loop, because the
//   forces in the loop would be undetermined.
// * An engaged brake is a friction with the force `holding` while it sticks and while it slides. A
//   released brake has no force. The brake releases a time `release` after the output brake_release
//   of the firmware becomes 1, and engages a time `engage` after this output becomes 0. A friction
//   may have the same ends as a brake. While the friction and the brake stick, the brake transmits
//   all of the force.
// * A cogging force is a function of d that repeats with its period within a travel.
// * An external force is a function of time.
// * A body has the mass mass + sum of inertia / r_trans^2.
// * Gravity acts on its body with mass * acceleration, positive towards +x. The acceleration is
//   interpolated between positions and constant outside their range.
// These elements or the drive must connect every body to ground; a brake alone is not sufficient. A
// structure connects its ports, and without a rigid-body mode it connects them to ground.
// The model must use every parameter that its file defines, directly or through another parameter,
// unless the parameter is marked as documentation. parameters_file may contain parameters that the
// model does not use.
#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "sim/model/units.hpp"

namespace forceaxis::sim {

/// Version of the file format of models, experiments and measurements. This number must be
/// incremented if the meaning of a valid file changes.
inline constexpr int kFileFormat = 1;

/// An error in an input file or an override. what() returns one line "FILE: KEY: expected ..., got
/// ...; what to do".
struct InputError : std::runtime_error {
  InputError(std::string file_name, std::string key_name, std::string text);
  /// Name of the file that contains the error.
  std::string file;
  /// Path of the key with the error, such as parameters.m_r.value or body[1].mass. Entries of a
  /// list are counted from 0.
  std::string key;
  std::string message;  ///< text of the message after the file name and the key
};

struct Parameter {
  std::string name;
  double value = 0.0;
  std::string unit;
  std::string source;
  /// Name of the file with the definition of the parameter that is used.
  std::string file;
  /// true: an element of the model uses the parameter.
  bool used = false;
  /// true: the value of the parameter comes from an override.
  bool overridden = false;
  /// true: the parameter only documents the model and need not be used.
  bool documentation = false;
  /// Expression for the value of the parameter, such as "m / tau". Empty if the value in the file
  /// is a number.
  std::string expression;
  /// Names of the parameters in the expression of this parameter, also in an expression that an
  /// override has replaced.
  std::vector<std::string> refers;
};

inline constexpr int kGround = -1;  ///< index that stands for the ground in place of a point

struct Body {
  std::string name;
  double mass = 0.0;      ///< mass in kg, > 0
  double position = 0.0;  ///< position in m at tick 0
  double velocity = 0.0;  ///< velocity in m/s at tick 0
};

/// A structure that is given by its modes of vibration, which a modal analysis has measured while
/// nothing acted on its ports. At the start it is at rest, with all positions 0.
struct Structure {
  struct Mode {
    double frequency_hz = 0.0;   ///< undamped natural frequency, >= 0; 0: a rigid-body mode
    double damping_ratio = 0.0;  ///< >= 0, and 0 for a rigid-body mode
    double mass = 1.0;  ///< modal mass in kg, > 0; 1 if the shape is mass-normalised, in 1/sqrt(kg)
    std::vector<double> shape;  ///< displacement of each port
  };
  std::string name;
  std::vector<std::string> ports;  ///< names, at least one; at least one mode moves each port
  std::vector<Mode> modes;         ///< at least one
};

/// The two ends of an element. Each end is the index of a point (Model::point_names), or kGround.
struct Ends {
  int a = kGround;
  int b = kGround;
};

/// A continuous piecewise-linear curve through the origin, with slopes[k] between breaks[k-1] and
/// breaks[k]. A curve with one slope and no break is a straight line.
struct Slopes {
  std::vector<double> slopes;
  std::vector<double> breaks;  ///< inputs at which the slope changes, in ascending order
};

/// A spring in series with a dashpot, beside the stiffness k of an element (standard linear solid,
/// Zener). The extension w of the dashpot is a state:
///   w' = (s - w) / time,    force k s + stiffness (s - w) at the deflection s
/// The surface of a contact without force recovers: s = stiffness w / (k + stiffness).
struct Maxwell {
  double stiffness = 0.0;  ///< in N/m, > 0
  double time = 0.0;       ///< damping of the dashpot divided by the stiffness in s, > 0
};

struct Spring {
  std::string name;
  Ends ends;
  /// Stiffness in N/m, >= 0, as a function of the deflection in m.
  Slopes stiffness;
  double damping = 0.0;                           ///< constant damping in N s/m, >= 0
  std::optional<Maxwell> maxwell = std::nullopt;  ///< in parallel with the stiffness
};

struct Damper {
  std::string name;
  Ends ends;
  /// Damping in N s/m, >= 0, as a function of the velocity in m/s.
  Slopes damping;
};

/// A spring in series with a dry slider (Jenkins element), beside the stiffness k of a contact. The
/// deflection e of the spring is a state. While the contact is pressed and |stiffness e| < force,
/// e' = d'; at this bound the slider slips, and e' = 0 until d' changes its sign. While the contact
/// is open, e' = 0, and its surface is where there is no force, k d + stiffness e = 0.
struct Hysteresis {
  double stiffness = 0.0;  ///< in N/m, > 0
  double force = 0.0;      ///< slip force in N, > 0
};

struct Contact {
  std::string name;
  Ends ends;
  /// Contact stiffness in N/m, > 0, as a function of the overlap in m. All breaks are > 0.
  Slopes stiffness;
  double damping = 0.0;  ///< contact damping in N s/m, >= 0
  double gap = 0.0;      ///< gap of the open contact in m; the overlap is d = x_a - x_b - gap
  std::optional<Maxwell> maxwell = std::nullopt;  ///< only with one stiffness and no damping
  /// Only with one stiffness, no damping and no `maxwell`.
  std::optional<Hysteresis> hysteresis = std::nullopt;
};

/// A backlash or a pair of limit stops. There is no force while low < d < high. Outside this range,
/// the stop acts as a contact.
struct Stop {
  std::string name;
  Ends ends;
  /// Contact stiffness in N/m, > 0.
  double stiffness = 0.0;
  /// Contact damping in N s/m, >= 0.
  double damping = 0.0;
  /// Deflection at the lower stop in m; empty: no lower stop; `low` or `high` is given.
  std::optional<double> low;
  std::optional<double> high;  ///< deflection at the upper stop in m, >= low; empty: no upper stop
};

struct Friction {
  std::string name;
  Ends ends;
  double coulomb = 0.0;   ///< friction force in N while the ends slide, >= 0
  double stiction = 0.0;  ///< largest friction force in N while the ends stick, at least `coulomb`
};

/// A brake. The brake is engaged at tick 0. An engaged brake acts as a friction with the force
/// `holding`.
struct Brake {
  std::string name;
  Ends ends;
  double holding = 0.0;    ///< friction force of the engaged brake in N, > 0
  double release_s = 0.0;  ///< time in s that the brake needs to release, >= 0
  double engage_s = 0.0;   ///< time in s that the brake needs to engage, >= 0
};

struct Gravity {
  std::string name;
  int body = kGround;  ///< index of a body; the mass of a port is not known
  /// Positions in m in ascending order; empty if the acceleration is constant.
  std::vector<double> positions;
  /// Acceleration in m/s^2 at each of the positions, or one value for all positions.
  std::vector<double> accelerations;
};

/// A force that repeats over the position. It acts backwards on end a and forwards on end b.
struct Cogging {
  std::string name;
  Ends ends;
  /// Deflections x_a - x_b in m in ascending order, at least two.
  std::vector<double> places;
  /// Force in N at each place. It is interpolated between places and constant outside their range.
  std::vector<double> forces;
};

/// An external force on a point, positive towards +x.
struct External {
  std::string name;
  int body = kGround;         ///< index of a point
  std::vector<double> times;  ///< in s since tick 0 in ascending order, >= 0, at least two
  /// Force in N at each time. It is interpolated between the times, 0 before and after them.
  std::vector<double> forces;
};

/// DC motor with a current amplifier, after a preamplifier with tachometer feedback (Figs 4.1-4.4):
///   vf' = a_preamp_fdbk (k_preamp_fdbk (k_tach / r_trans * v + t) - vf) filtered tachometer, V
///   c   = clamp(k_preamp_cmd u - vf, +-preamp_limit)                  current command, V
///   e   = c - clamp(k_current i, +-current_feedback_limit)            current error, V
///   vm  = slope k_amp up to |e| = amp_break, k_amp_outer beyond, clamped to +-supply_limit
///   L i' = vm - R i - k_back_emf / r_trans * v
///   F   = k_torque / r_trans * i - b_m / r_trans^2 * v                on the body, -F on reaction
/// The output of the DAC (or of an analyzer) is the velocity command u, with t = 0. With input =
/// "tach", this output is t, which is added to the tachometer voltage, and u = 0 (Fig 3.7). v is
/// the velocity of the body relative to the reaction body. While the drive is disabled, i = 0 and F
/// = -b_m / r_trans^2 * v.
struct DcMotor {
  /// true: the DAC voltage is added to the tachometer voltage.
  bool input_tach = false;
  /// Gain of the preamplifier for the velocity command in V/V.
  double k_preamp_cmd = 0.0;
  /// Gain of the preamplifier for the tachometer voltage in V/V, >= 0.
  double k_preamp_fdbk = 0.0;
  /// Corner frequency of the tachometer filter in rad/s, > 0.
  double a_preamp_fdbk = 0.0;
  /// Constant of the tachometer in V s/rad, >= 0.
  double k_tach = 0.0;
  /// Torque constant of the motor in N m/A, > 0.
  double k_torque = 0.0;
  /// Constant of the back EMF in V s/rad, >= 0.
  double k_back_emf = 0.0;
  /// Motor inductance in H, > 0 (key L).
  double inductance = 0.0;
  /// Motor resistance in ohm, >= 0 (key R).
  double resistance = 0.0;
  /// Ratio of the transmission in m/rad, > 0.
  double r_trans = 0.0;
  /// Friction of the motor in N m s/rad, >= 0.
  double b_m = 0.0;
  /// Gain of the current measurement in V/A, >= 0.
  double k_current = 0.0;
  /// Largest voltage of the current measurement in V, > 0; empty: not limited.
  std::optional<double> current_feedback_limit;
  /// Largest current command in V, > 0; empty: not limited.
  std::optional<double> preamp_limit;
  /// Gain of the current amplifier in V/V, > 0.
  double k_amp = 0.0;
  /// Current error in V at which the amplifier gain changes, > 0; empty: constant gain.
  std::optional<double> amp_break;
  /// Amplifier gain above amp_break in V/V, >= 0. Equal to k_amp if amp_break is empty.
  double k_amp_outer = 0.0;
  std::optional<double> supply_limit;  ///< largest motor voltage in V, > 0; empty: not limited
};

/// The simple actuator of section 2.3: F' = a_act (k_act (velocity_per_volt u - v) - F). The force
/// on the body is F, limited to +-force_limit. While the drive is disabled, F = 0.
struct FirstOrderDrive {
  double k_act = 0.0;                 ///< steady-state force per velocity error in N s/m, > 0
  double a_act = 0.0;                 ///< corner frequency of the drive force in rad/s, > 0
  double velocity_per_volt = 0.0;     ///< velocity per command voltage in m/s per V, not 0
  std::optional<double> force_limit;  ///< largest drive force in N, > 0; empty: not limited
};

/// A drive without dynamics. Its force is F = force_per_volt u, limited to +-force_limit, or 0
/// while the drive is disabled.
struct PerfectDrive {
  double force_per_volt = 0.0;        ///< drive force per command voltage in N/V, not 0
  std::optional<double> force_limit;  ///< largest drive force in N, > 0; empty: not limited
};

/// A motor with a current loop, which a torque drive and a velocity drive have in common:
///   i' = rate (c - i)            c is the limited target of the current in A
///   F  = force_per_amp i         on the body, -F on reaction
/// |c| is at most peak_current. With a rated current, |c| is at most rated_current while the mean
/// current h of the drive has reached it:
///   h' = (max(|i|, rated_current / 2) - h) / T,    T = peak_time / ln((Ip - Ir / 2) / (Ip - Ir))
/// h begins at rated_current / 2. It reaches rated_current when peak_current has flowed for
/// peak_time, and the peak is available again when h is below 3/4 of rated_current. While the drive
/// is disabled, i = 0 and h continues.
struct DriveMotor {
  double force_per_amp = 0.0;           ///< k_force, or k_torque / r_trans, in N/A, > 0
  double rate = 0.0;                    ///< bandwidth of the current loop in rad/s, > 0
  std::optional<double> peak_current;   ///< in A, > 0; empty: not limited
  std::optional<double> rated_current;  ///< in A, > 0 and < peak_current; empty: no second limit
  double peak_time = 0.0;               ///< in s, > 0 if rated_current is given
};

/// A current amplifier with its motor. The target of the current is
///   c = current_per_volt u - damping / force_per_amp v
struct TorqueDrive {
  DriveMotor motor;
  double current_per_volt = 0.0;  ///< in A/V, not 0
  double damping = 0.0;           ///< velocity damping in the drive in N s/m, >= 0
};

/// A drive with a velocity loop of its own. The target of the current is
///   c = k_velocity / force_per_amp (velocity_per_volt u - v) + q,    q' = (c - q) / integral_time
/// where c in q' is the limited target. Within the limits this is a PI controller, q' = k_velocity
/// / force_per_amp (velocity_per_volt u - v) / integral_time; at a limit q goes to the limit and no
/// further. While the drive is disabled, q = 0.
struct VelocityDrive {
  DriveMotor motor;
  double velocity_per_volt = 0.0;       ///< in m/s per V, not 0
  double k_velocity = 0.0;              ///< in N s/m, > 0
  std::optional<double> integral_time;  ///< in s, > 0; empty: q = 0
};

/// Gains with which the closed velocity loop of a mass has -3 dB at a frequency. The loop has two
/// poles with the damping ratio and a third one on the real axis. Returns nothing if the current
/// loop is too slow: then no gains give this bandwidth.
struct VelocityGains {
  double k_velocity = 0.0;     ///< in N s/m
  double integral_time = 0.0;  ///< in s
};
std::optional<VelocityGains> velocity_gains(double mass_kg, double bandwidth, double damping_ratio,
                                            double current_bandwidth);

/// A stepper motor whose driver turns its field by steps, as a velocity command. The load angle w
/// is the travel of the field since the drive was enabled, less the travel of the body:
///   w' = velocity_per_volt u - v
///   F  = f(w) + damping w'       on the body, -F on reaction
/// f is linear between points that lie on holding_force sin(2 pi w / (4 full_step)) at equal
/// distances. Beyond kPeriods periods of 4 full steps F is 0: the motor has stalled. While the
/// drive is disabled, w = 0 and F = 0.
struct StepperDrive {
  static constexpr int kPeriods = 8;
  double velocity_per_volt = 0.0;  ///< in m/s per V, not 0
  double holding_force = 0.0;      ///< largest f in N, > 0
  double full_step = 0.0;          ///< travel of the body for a full step in m, > 0
  double damping = 0.0;            ///< in N s/m, >= 0
  int segments = 16;               ///< number of straight segments for one period of the sine: 4,
                                   ///< 8, .. 32
};

/// The bus between firmware and drive, as sim/hybrid/drive_bus.hpp describes it.
struct BusCycle {
  int ticks = 1;            ///< period of the frames in ticks: 1, or a multiple of 3
  int delay_ticks_out = 0;  ///< ticks from an output of the firmware to the drive, 0..30
  int delay_ticks_in = 0;   ///< ticks from a measured position to the firmware, 0..30
  /// Returns true if every tick has its own frame in both directions, which is not late.
  bool immediate() const { return ticks == 1 && delay_ticks_out == 0 && delay_ticks_in == 0; }
};

struct Drive {
  int body = kGround;
  int reaction = kGround;
  BusCycle bus;
  /// Ticks from amp_enable until the drive follows the code; empty: the drive reports nothing.
  std::optional<int> enable_ticks;
  std::variant<DcMotor, FirstOrderDrive, PerfectDrive, TorqueDrive, VelocityDrive, StepperDrive>
      type;

  /// Returns the motor of a torque or velocity drive, or nullptr for another type.
  const DriveMotor *motor() const {
    if (const auto *torque = std::get_if<TorqueDrive>(&type)) return &torque->motor;
    if (const auto *velocity = std::get_if<VelocityDrive>(&type)) return &velocity->motor;
    return nullptr;
  }
};

/// Commands of a controller of the machine over the time.
struct MachineTable {
  std::vector<double> times;   ///< in s since tick 0 in ascending order, >= 0, at least two
  std::vector<double> values;  ///< command in m/s or N; constant before and after the times
  bool interpolated = false;   ///< false: a value is held until the next time
};

/// Virtual mass and damping of an admittance.
struct MachineAdmittance {
  double mass = 0.0;     ///< in kg, > 0
  double damping = 0.0;  ///< in N s/m, >= 0
};

/// A PI controller of the force whose output is a velocity.
struct MachineForcePi {
  double damping = 0.0;                 ///< in N s/m, > 0
  std::optional<double> integral_time;  ///< in s, > 0; empty: q = 0
};

/// A controller that belongs to the machine, in place of the firmware: a model of somebody else's
/// controller, of which no more than this law is known. In the first tick of each cycle it gives
/// the drive a command, which the drive holds for the cycle: a velocity, or a force for a table of
/// forces. f is its set-point less the measured force, v its command, T the cycle:
///   table        v is the value of a table at the time of the tick
///   admittance   mass v' = f - damping v
///   force_pi     v = f / damping + q,    q' = f / (damping integral_time)
/// Each law is exact for a force that is constant in a cycle. |v| is at most speed_max, at which
/// the admittance stops and q is held. The measured force is the signal, through a first-order low
/// pass and delay_ticks late.
struct MachineController {
  std::variant<MachineTable, MachineAdmittance, MachineForcePi> law;
  double volts_per_command = 0.0;  ///< voltage of the drive for a command of 1 m/s or 1 N
  int cycle_ticks = 1;
  // Only of an admittance and of force_pi:
  std::string signal;            ///< force that the controller measures
  double setpoint = 0.0;         ///< in N
  double speed_max = 0.0;        ///< in m/s, > 0
  std::optional<double> filter;  ///< corner frequency of the low pass in rad/s, > 0
  int delay_ticks = 0;           ///< 0..30
};

/// An encoder that measures the position of a body relative to a reference, for example relative to
/// a moving base.
struct Encoder {
  int body = kGround;
  int reference = kGround;
  double scale = 0.0;  ///< count/m, not 0
};

/// Switches along the travel of the encoder's body. Positions are relative to the encoder's
/// reference. If a position is empty, the model has no such switch. If only one end of the home
/// switch is given, the switch is active up to the end of the travel.
struct Switches {
  /// The negative limit switch is active at and below this position in m.
  std::optional<double> limit_neg;
  /// The positive limit switch is active at and above this position in m.
  std::optional<double> limit_pos;
  /// The home switch is active at and above this position in m.
  std::optional<double> home_from;
  /// The home switch is active below this position in m.
  std::optional<double> home_to;
  /// Position of the first index pulse in m.
  std::optional<double> index;
  /// Distance between two index pulses in m, > 0; empty: only one pulse.
  std::optional<double> index_every;
};

/// Clock of a converter that samples at a rate of its own. Sample k = 0, 1, 2, ... is taken
/// phase_s + k / rate_hz after tick 0, and the firmware has it latency_s later.
struct Sampling {
  double rate_hz = 1500.0;  ///< 1 to 30000
  double phase_s = 0.0;     ///< 0 to less than 1 / rate_hz
  /// False if the phase of the converter's clock is not known: then only runs use phase_s.
  bool phase_known = true;
  double latency_s = 0.0;  ///< 0 to 0.1
};

/// Creep of a sensor: the signal y becomes y + share z, with z' = (y - z) / time and z = 0 at tick
/// 0. Under a constant load the reading grows by `share` of the load.
struct Creep {
  double share = 0.0;
  double time = 0.0;  ///< time constant in s, > 0
};

/// Warm-up of a sensor: a time t after tick 0 its zero has moved by final (1 - e^(-t / time)).
struct Drift {
  double final = 0.0;  ///< in the unit of the signal
  double time = 0.0;   ///< time constant in s, > 0
};

/// Path of a signal to its ADC code: creep and drift of the sensor are added, the sum is limited to
/// +-sensor_limit, filtered by a first-order low pass, limited to +-conditioning_limit, filtered by
/// the converter, and converted with noise. Limits and noise have the unit of the signal. The
/// firmware has codes of at most 16 bits: a converter of more bits gives it the upper 16 of each
/// code. So per_count, zero_code and bits are those of the code that the firmware has.
struct Adc {
  std::string signal;
  std::optional<Creep> creep;
  std::optional<Drift> drift;
  /// Magnitude of the signal at which the sensor saturates, > 0.
  std::optional<double> sensor_limit;
  /// Corner frequency of the low-pass filter in rad/s, > 0 and at most 1e6. The filter computes y'
  /// = filter (x - y) and starts with y = 0.
  std::optional<double> filter;
  /// Magnitude of the signal at which the analog electronics saturate, > 0.
  std::optional<double> conditioning_limit;
  /// Rms noise in the unit of the signal, >= 0.
  double noise = 0.0;
  /// Change of the signal for one code step, in the unit of the signal, not 0.
  double per_count = 0.0;
  int zero_code = 0;  ///< ADC code at the signal 0, from 0 to 2^bits - 1
  int bits = 8;       ///< 8..16
  /// Fraction of a code step that is added before the code is rounded down: 1/2, and less if the
  /// code is the upper 16 bits of a longer code.
  double rounding = 0.5;
  std::optional<Sampling>
      sampling;  ///< empty: a sample at each tick, which the firmware has at once
  /// Order of the filter of a sigma-delta converter, 3 to 5, or 0 for none (sinc_filter.hpp). A
  /// filter has `sampling`.
  int sinc_order = 0;
};

struct Dac {
  /// Number of bits, 8 to 16; the codes of step() are -2^(bits-1) to 2^(bits-1)-1.
  int bits = 12;
  double range = 10.0;  ///< output voltage range in V, > 0; output for the lowest code: -range
  double offset = 0.0;  ///< output voltage in V at code 0
  double noise = 0.0;   ///< rms noise of the output voltage in V, >= 0
  /// Voltage of one code of this DAC.
  double volts_per_step() const { return 2.0 * range / static_cast<double>(1 << bits); }
  /// Voltage of one DAC code of the firmware, whose gains and limits are in 1/2048 of the range
  /// whatever the number of bits.
  double volts_per_code() const { return range / 2048.0; }
};

/// A named true signal of a model, and the dimension of its value. LINK is an element with two
/// ends.
///   BODY.position m, BODY.velocity m/s
///   BODY.acceleration m/s^2: output of an accelerometer on the body
///   PORT.position m, PORT.velocity m/s, PORT.acceleration m/s^2, as those of a body
///   LINK.force N: a positive force accelerates end a backwards
///   LINK.spring_force N: force of the stiffness alone, as a strain gauge measures; 0 for a
///       damper, a friction and an open contact
///   LINK.spring_force_rate N/s: k d', the output of a velocity-sensing force sensor (6.2.1)
///   LINK.deflection m: overlap of a contact (a negative value is a gap), or x_a - x_b of a stop
///   GRAVITY.force N, EXTERNAL.force N
///   drive.force N, drive.command V: constant output of the DAC during a tick
///   for a dc_motor also drive.current A, drive.tach V (unfiltered), drive.tach_filtered V (vf),
///       drive.current_command V (c), drive.voltage V (vm; the back EMF while disabled)
///   for a torque or velocity drive also drive.current A, drive.target_current A (the limited c);
///       drive.mean_current A (h) with a rated current; drive.integral A (q) of a velocity drive
///       with an integral
///   for a stepper drive also drive.load_angle m (w)
struct SignalInfo {
  std::string name;
  Dimension dimension = Dimension::ratio;
};

struct Model {
  std::string file;
  std::string title;
  std::string shows;
  std::vector<Parameter> parameters;
  std::vector<Body> bodies;
  std::vector<Structure> structures;
  std::vector<Spring> springs;
  std::vector<Damper> dampers;
  std::vector<Contact> contacts;
  std::vector<Stop> stops;  ///< backlashes and limit stops
  std::vector<Friction> frictions;
  std::vector<Brake> brakes;
  std::vector<Gravity> gravities;
  std::vector<Cogging> coggings;
  std::vector<External> externals;
  std::optional<Drive> drive;
  std::optional<MachineController> machine_controller;
  std::optional<Encoder> encoder;
  Switches switches;
  std::array<std::optional<Adc>, 2> adc;
  Dac dac;

  /// Calls `visit` for each element with two ends, except the drive. The order is that of the
  /// signals.
  template <class Visit>
  void each_link(Visit visit) const {
    for (const Spring &spring : springs) visit(spring);
    for (const Damper &damper : dampers) visit(damper);
    for (const Contact &contact : contacts) visit(contact);
    for (const Stop &stop : stops) visit(stop);
    for (const Friction &friction : frictions) visit(friction);
    for (const Brake &brake : brakes) visit(brake);
    for (const Cogging &cogging : coggings) visit(cogging);
  }
  /// Returns all signals of the model, in the order of Plant::signals().
  std::vector<SignalInfo> signal_list() const;
  /// Returns the names of all points that elements may connect: the bodies, followed by the ports
  /// of all structures.
  std::vector<std::string> point_names() const;
  /// Returns the index of a point. Throws std::invalid_argument for an unknown name.
  int point_index(std::string_view name) const;
  bool is_body(int point) const { return point >= 0 && point < static_cast<int>(bodies.size()); }
};

/// A new value for one parameter: a number in the unit of the parameter, or a text with a quantity
/// or the name of another parameter. If that other parameter is overridden too, its new value is
/// used.
struct Override {
  std::string parameter;
  std::variant<double, std::string> value;
};

/// A model file that is read once and gives models with different values of its parameters.
class ModelFile {
 public:
  /// Reads the file and its parameters_file. Throws InputError.
  explicit ModelFile(const std::filesystem::path &path);
  ModelFile(ModelFile &&) noexcept;
  ~ModelFile();
  /// Returns the checked model. Each override must name a parameter of the model or of its
  /// parameters_file. Parameter::used is false for a parameter that no element uses. Messages about
  /// an override name the key `set.NAME` of the file `overrides_file`, unless `overrides_file` is
  /// empty. Throws InputError.
  Model model(std::span<const Override> overrides = {},
              const std::string &overrides_file = "") const;

 private:
  struct Content;
  std::unique_ptr<const Content> content_;
};

/// Returns ModelFile(path).model(overrides, overrides_file).
Model load_model(const std::filesystem::path &path, std::span<const Override> overrides = {},
                 const std::string &overrides_file = "");

}  // namespace forceaxis::sim
