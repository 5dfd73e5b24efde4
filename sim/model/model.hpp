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
// * A piecewise-linear curve has ascending breaks and slope k between breaks[k-1] and breaks[k].
//   The curve is continuous and passes through the origin. A spring may have `loads` in N in place
//   of breaks.
// * A contact exerts k d + b d' while d > 0 and this sum is > 0; otherwise its force is 0.
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
// * Gravity acts on its body with mass * acceleration, positive towards +x. The acceleration is
//   interpolated between positions and constant outside their range.
// These elements or the drive must connect every body to ground; a brake alone is not sufficient.
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

inline constexpr int kGround = -1;  ///< index that stands for the ground in place of a body

struct Body {
  std::string name;
  double mass = 0.0;      ///< mass in kg, > 0
  double position = 0.0;  ///< position in m at tick 0
  double velocity = 0.0;  ///< velocity in m/s at tick 0
};

/// The two ends of an element. Each end is the index of a body, or kGround.
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

struct Spring {
  std::string name;
  Ends ends;
  /// Stiffness in N/m, >= 0, as a function of the deflection in m.
  Slopes stiffness;
  double damping = 0.0;  ///< constant damping in N s/m, >= 0
};

struct Damper {
  std::string name;
  Ends ends;
  /// Damping in N s/m, >= 0, as a function of the velocity in m/s.
  Slopes damping;
};

struct Contact {
  std::string name;
  Ends ends;
  double stiffness = 0.0;  ///< contact stiffness in N/m, > 0
  double damping = 0.0;    ///< contact damping in N s/m, >= 0
  double gap = 0.0;        ///< gap of the open contact in m; the overlap is d = x_a - x_b - gap
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
  double release_s = 0.0;  ///< time in s that the brake takes to release, >= 0
  double engage_s = 0.0;   ///< time in s that the brake takes to engage, >= 0
};

struct Gravity {
  std::string name;
  int body = kGround;
  /// Positions in m in ascending order; empty if the acceleration is constant.
  std::vector<double> positions;
  /// Acceleration in m/s^2 at each of the positions, or one value for all positions.
  std::vector<double> accelerations;
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

struct Drive {
  int body = kGround;
  int reaction = kGround;
  std::variant<DcMotor, FirstOrderDrive, PerfectDrive> type;
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

/// Path of a signal to its ADC code: the signal is limited to +-sensor_limit, filtered by a
/// first-order low pass, limited to +-conditioning_limit, and converted with noise. Limits and
/// noise have the unit of the signal.
struct Adc {
  std::string signal;
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
};

struct Dac {
  int bits = 12;        ///< number of bits, 8 to 16; the codes are -2^(bits-1) to 2^(bits-1)-1
  double range = 10.0;  ///< output voltage range in V, > 0; output for the lowest code: -range
  double offset = 0.0;  ///< output voltage in V at code 0
  double noise = 0.0;   ///< rms noise of the output voltage in V, >= 0
  double volts_per_code() const { return 2.0 * range / static_cast<double>(1 << bits); }
};

/// A named true signal of a model, and the dimension of its value. LINK is an element with two
/// ends.
///   BODY.position m, BODY.velocity m/s
///   BODY.acceleration m/s^2: output of an accelerometer on the body
///   LINK.force N: a positive force accelerates end a backwards
///   LINK.spring_force N: force of the stiffness alone, as a strain gauge measures; 0 for a
///       damper, a friction and an open contact
///   LINK.spring_force_rate N/s: k d', the output of a velocity-sensing force sensor (6.2.1)
///   LINK.deflection m: overlap of a contact (a negative value is a gap), or x_a - x_b of a stop
///   GRAVITY.force N
///   drive.force N, drive.command V: constant output of the DAC during a tick
///   for a dc_motor also drive.current A, drive.tach V (unfiltered), drive.tach_filtered V (vf),
///       drive.current_command V (c), drive.voltage V (vm; the back EMF while disabled)
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
  std::vector<Spring> springs;
  std::vector<Damper> dampers;
  std::vector<Contact> contacts;
  std::vector<Stop> stops;  ///< backlashes and limit stops
  std::vector<Friction> frictions;
  std::vector<Brake> brakes;
  std::vector<Gravity> gravities;
  std::optional<Drive> drive;
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
  }
  /// Returns all signals of the model, in the order of Plant::signals().
  std::vector<SignalInfo> signal_list() const;
  /// Returns the index of a body. Throws std::invalid_argument for an unknown name.
  int body_index(std::string_view name) const;
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
