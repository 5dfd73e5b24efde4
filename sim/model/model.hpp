#pragma once
// The description of a plant from its model file: checked, immutable and without equations of
// motion.
//
// load_model() reads a TOML file. It returns a Model that satisfies every rule below, or throws
// InputError with one line that names the file, the key, the expected value and the remedy. The
// only other exception is std::bad_alloc. Positive motion is towards the workpiece. All quantities
// are in SI units.
//
// model_format.cpp declares tables and keys; docs/guide/reference/model.md is generated from it.
//
// A value is a number in SI units, a quantity such as "400 kN/m" (units.hpp), the name of a
// parameter, or "-name". The value of a parameter is a number in its unit, a quantity, or a product
// or quotient of other parameters and numbers, "m / tau" (expression.hpp). One end of `between` may
// be "ground". The deflection is d = x_a - x_b, minus `gap` for a contact. A positive force
// accelerates end a backwards and end b forwards.
// * A piecewise-linear curve has ascending breaks and slope k between breaks[k-1] and breaks[k]. It
//   is continuous and passes through the origin. A spring may have `loads` in N in place of breaks.
// * A contact exerts k d + b d' while d > 0 and this sum is > 0; otherwise its force is 0. A stop
// is
//   such a contact at either end of the range low < d < high. A backlash is a stop at -width/2 and
//   +width/2.
// * A friction opposes sliding with the force `coulomb`. It sticks at d' = 0 while the force that
//   this needs is at most `stiction`. Frictions must not form a loop, because the forces in the
//   loop would be undetermined.
// * An engaged brake is a friction with the force `holding` while it sticks and while it slides. A
//   released brake has no force. It releases `release` after the output brake_release of the
//   firmware becomes 1, and engages `engage` after the output becomes 0. A friction may have the
//   same ends as a brake; while both stick, the brake carries all of the force.
// * Gravity acts on its body with mass * acceleration, positive towards +x. The acceleration is
//   interpolated between positions and constant outside their range.
// These elements or the drive must connect every body to ground; a brake alone is not sufficient.
// The model must use every parameter that its file defines, directly or through another parameter,
// unless the parameter is marked as documentation. parameters_file may contain parameters that the
// model does not use.
#include <array>
#include <filesystem>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "sim/model/units.hpp"

namespace forceaxis::sim {

/// Version of the format of models, experiments and measurements. It must be incremented if the
/// meaning of a valid file changes.
inline constexpr int kFileFormat = 1;

/// An error in an input file or an override. what() is one line: "FILE: KEY: expected ..., got ...;
/// what to do".
struct InputError : std::runtime_error {
  InputError(std::string file_name, std::string key_name, std::string text);
  std::string file;  ///< file with the error
  /// Path of the key as in the file, such as body[1].mass (counted from 0) or parameters.m_r.value.
  std::string key;
  std::string message;  ///< remainder of the line after file and key
};

struct Parameter {
  std::string name;
  double value = 0.0;
  std::string unit;
  std::string source;
  std::string file;            ///< name of the file with the last definition of the parameter
  bool used = false;           ///< An element of the model refers to the parameter.
  bool overridden = false;     ///< An override has given the value of the parameter.
  bool documentation = false;  ///< The model need not use the parameter.
  /// Expression that gives the value, such as "m / tau"; empty if the file gives a number.
  std::string expression;
  /// Names of the parameters to which its expressions refer, including an expression that an
  /// override has replaced.
  std::vector<std::string> refers;
};

inline constexpr int kGround = -1;  ///< index that means "ground" in place of a body

struct Body {
  std::string name;
  double mass = 0.0;      ///< kg, > 0
  double position = 0.0;  ///< m, at tick 0
  double velocity = 0.0;  ///< m/s, at tick 0
};

/// The two ends of an element: each is the index of a body or kGround.
struct Ends {
  int a = kGround;
  int b = kGround;
};

/// A continuous piecewise-linear curve through the origin, with slopes[k] between breaks[k-1] and
/// breaks[k]. A curve with one slope and no break is a straight line.
struct Slopes {
  std::vector<double> slopes;
  std::vector<double> breaks;  ///< in ascending order
};

struct Spring {
  std::string name;
  Ends ends;
  /// Stiffness in N/m, >= 0, as a function of the deflection in m.
  Slopes stiffness;
  double damping = 0.0;  ///< N s/m, >= 0
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
  double stiffness = 0.0;  ///< N/m, > 0
  double damping = 0.0;    ///< N s/m, >= 0
  double gap = 0.0;        ///< distance in m; the overlap is d = x_a - x_b - gap
};

/// A backlash or a pair of limit stops: no force while low < d < high, and a contact outside this
/// range.
struct Stop {
  std::string name;
  Ends ends;
  double stiffness = 0.0;      ///< N/m, > 0
  double damping = 0.0;        ///< N s/m, >= 0
  std::optional<double> low;   ///< lower end in m; at least one of low and high is given
  std::optional<double> high;  ///< m, >= low
};

struct Friction {
  std::string name;
  Ends ends;
  double coulomb = 0.0;   ///< friction force while sliding, in N, >= 0
  double stiction = 0.0;  ///< breakaway force in N, at least `coulomb`
};

/// A brake. It is engaged at tick 0, and acts as a friction with the force `holding` while it is
/// engaged.
struct Brake {
  std::string name;
  Ends ends;
  double holding = 0.0;    ///< friction force while sticking and while sliding, in N, > 0
  double release_s = 0.0;  ///< delay in s from brake_release to the released brake, >= 0
  double engage_s = 0.0;   ///< delay in s from the end of brake_release to the engaged brake, >= 0
};

struct Gravity {
  std::string name;
  int body = kGround;
  std::vector<double> positions;      ///< positions in m, ascending; empty if the acceleration is
                                      ///< constant
  std::vector<double> accelerations;  ///< accelerations in m/s^2, one for each position, or one for
                                      ///< all
};

/// DC motor with a current amplifier, after a preamplifier with tachometer feedback (Figs 4.1-4.4):
///   vf' = a_preamp_fdbk (k_preamp_fdbk (k_tach / r_trans * v + t) - vf) filtered tachometer, V
///   c   = clamp(k_preamp_cmd u - vf, +-preamp_limit)                  current command, V
///   e   = c - clamp(k_current i, +-current_feedback_limit)            current error, V
///   vm  = slope k_amp up to |e| = amp_break, k_amp_outer beyond, clamped to +-supply_limit
///   L i' = vm - R i - k_back_emf / r_trans * v
///   F   = k_torque / r_trans * i - b_m / r_trans^2 * v                on the body, -F on reaction
/// The output of the DAC (or of an analyzer) is the velocity command u, with t = 0. With input =
/// "tach", this output is added to the voltage of the tachometer instead: it is t, with u = 0
/// (Fig 3.7). v is the velocity of the body relative to the reaction body. While the drive is
/// disabled, i = 0 and F = -b_m / r_trans^2 * v.
struct DcMotor {
  bool input_tach = false;    ///< The DAC voltage is added to the tachometer voltage (key `input`).
  double k_preamp_cmd = 0.0;  ///< V/V
  double k_preamp_fdbk = 0.0;                    ///< V/V, >= 0
  double a_preamp_fdbk = 0.0;                    ///< rad/s, > 0
  double k_tach = 0.0;                           ///< V s/rad, >= 0
  double k_torque = 0.0;                         ///< N m/A, > 0
  double k_back_emf = 0.0;                       ///< V s/rad, >= 0
  double inductance = 0.0;                       ///< key L, H, > 0
  double resistance = 0.0;                       ///< key R, ohm, >= 0
  double r_trans = 0.0;                          ///< m/rad, > 0
  double b_m = 0.0;                              ///< N m s/rad, >= 0
  double k_current = 0.0;                        ///< V/A, >= 0
  std::optional<double> current_feedback_limit;  ///< limit of the current measurement in V, > 0;
                                                 ///< empty: not limited
  std::optional<double> preamp_limit;  ///< limit of the current command in V, > 0; empty: not
                                       ///< limited
  double k_amp = 0.0;                  ///< V/V, > 0
  std::optional<double> amp_break;  ///< current error in V, > 0, at which the slope changes; empty:
                                    ///< one slope
  double k_amp_outer = 0.0;         ///< slope above amp_break in V/V, >= 0; k_amp without amp_break
  std::optional<double> supply_limit;  ///< limit of the motor voltage in V, > 0; empty: not limited
};

/// The simple actuator of section 2.3: F' = a_act (k_act (velocity_per_volt u - v) - F). The force
/// on the body is F, limited to +-force_limit. While the drive is disabled, F = 0.
struct FirstOrderDrive {
  double k_act = 0.0;                 ///< N s/m, > 0
  double a_act = 0.0;                 ///< rad/s, > 0
  double velocity_per_volt = 0.0;     ///< m/s per V, not 0
  std::optional<double> force_limit;  ///< limit of the drive force in N, > 0; empty: not limited
};

/// A drive without dynamics: F = force_per_volt u, limited to +-force_limit. While the drive is
/// disabled, F = 0.
struct PerfectDrive {
  double force_per_volt = 0.0;        ///< N/V, not 0
  std::optional<double> force_limit;  ///< limit of the drive force in N, > 0; empty: not limited
};

struct Drive {
  int body = kGround;
  int reaction = kGround;
  std::variant<DcMotor, FirstOrderDrive, PerfectDrive> type;
};

/// An encoder that measures the position of the body relative to the reference, such as the encoder
/// of a motor on a moving base.
struct Encoder {
  int body = kGround;
  int reference = kGround;
  double scale = 0.0;  ///< count/m, not 0
};

/// Switches along the travel of the encoder's body, at positions relative to the encoder's
/// reference. The model has no switch whose position is omitted. A home switch with one end omitted
/// is active up to the end of the travel.
struct Switches {
  std::optional<double> limit_neg;  ///< position in m, at and below which the limit switch is
                                    ///< active
  std::optional<double> limit_pos;  ///< position in m, at and above which the limit switch is
                                    ///< active
  std::optional<double> home_from;  ///< position in m, at and above which the home switch is active
  std::optional<double> home_to;    ///< position in m, below which the home switch is active
  std::optional<double> index;      ///< position of an index pulse in m
  std::optional<double> index_every;  ///< distance between further index pulses in m, > 0; empty:
                                      ///< one pulse
};

/// Signal path of an ADC: signal, limit +-sensor_limit, first-order low pass `filter`, limit
/// +-conditioning_limit, noise, code. All quantities have the unit of the signal.
struct Adc {
  std::string signal;
  std::optional<double> sensor_limit;  ///< magnitude at which the sensor saturates, > 0
  /// Corner frequency of the low pass in rad/s, > 0, at most 1e6: y' = filter (x - y), with y = 0
  /// at the start.
  std::optional<double> filter;
  std::optional<double> conditioning_limit;  ///< magnitude at which the analog electronics
                                             ///< saturate, > 0
  double noise = 0.0;                        ///< rms, >= 0
  double per_count = 0.0;  ///< change of the signal for one code, in its unit per count, not 0
  int zero_code = 0;       ///< code at the signal 0, from 0 to 2^bits - 1
  int bits = 8;            ///< 8..16
};

struct Dac {
  int bits = 12;        ///< resolution, 8 to 16; codes are -2^(bits-1) to 2^(bits-1)-1
  double range = 10.0;  ///< output voltage range in V, > 0; the lowest code gives -range
  double offset = 0.0;  ///< V at code 0
  double noise = 0.0;   ///< V rms, >= 0
  double volts_per_code() const { return 2.0 * range / static_cast<double>(1 << bits); }
};

/// A named true signal of a model, and the dimension of its value. LINK is an element with two
/// ends.
///   BODY.position m, BODY.velocity m/s
///   BODY.acceleration m/s^2: output of an accelerometer on the body
///   LINK.force N: a positive force accelerates end a backwards
///   LINK.spring_force N: force of the stiffness alone, the output of a strain gauge; 0 for a
///   damper,
///       a friction and an open contact
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
  std::vector<Stop> stops;  ///< backlashes and limit stops of the model
  std::vector<Friction> frictions;
  std::vector<Brake> brakes;
  std::vector<Gravity> gravities;
  std::optional<Drive> drive;
  std::optional<Encoder> encoder;
  Switches switches;
  std::array<std::optional<Adc>, 2> adc;
  Dac dac;

  /// Calls `visit` for each element with two ends except the drive, in the order of the signals.
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
/// or the name of another parameter. An override of that other parameter applies first.
struct Override {
  std::string parameter;
  std::variant<double, std::string> value;
};

/// Reads and checks a model. Each override must name a parameter of the model or of its
/// parameters_file. Parameter::used is false for a parameter that nothing in the model uses. An
/// error in an override is reported as `set.NAME` of the file `overrides_file`, if this name is not
/// empty. Throws InputError.
Model load_model(const std::filesystem::path &path, std::span<const Override> overrides = {},
                 const std::string &overrides_file = "");

}  // namespace forceaxis::sim
