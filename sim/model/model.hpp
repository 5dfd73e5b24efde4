#pragma once
// A plant as its file describes it: checked, immutable, without any dynamics.
//
// load_model() reads a TOML file and either returns a Model in which every rule below holds or
// throws InputError with one line that names file, key, what was expected and what to do. It throws
// nothing else but std::bad_alloc. Positive motion is toward the workpiece; SI units
// throughout.
//
// Tables and keys are declared in model_format.cpp; docs/guide/reference/model.md is written from
// there.
//
// A value is a number (SI), a quantity such as "400 kN/m" (units.hpp), the name of a parameter, or
// "-name"; a parameter's own value is a number in its unit, a quantity, or a product or quotient of
// other parameters and numbers, "m / tau" (expression.hpp). One end of `between` may be "ground".
// Deflection is d = x_a - x_b (less `gap` for a contact); a positive force pushes a back and b
// forward.
// * Piecewise linear: breaks rise; slope k holds between breaks[k-1] and breaks[k]; the curve is
//   continuous and 0 at 0. Breaks may be given as `loads`: compliance that depends on the load.
// * A contact exerts k d + b d' while d > 0 and that sum is > 0, else 0. A stop is such a contact
// on
//   either side, free while low < d < high; a backlash a stop at -width/2 and +width/2.
// * Friction opposes sliding with `coulomb`; it sticks at d' = 0 while no more than `stiction` is
//   needed for that. Frictions must not form a loop: their forces would be undetermined.
// * A brake is such a friction, of `holding` both stuck and sliding, while it is engaged, and
// nothing
//   while it is released: it lets go `release` after the firmware's output brake_release rises, and
//   holds again `engage` after that falls. A friction between the same ends adds to it: while both
//   stick, the brake bears all.
// * Gravity pulls its body with mass * acceleration, toward +x where positive; between positions it
//   is interpolated, beyond the outer ones it is constant.
// Every body must be tied to ground through these or the drive; a brake alone does not tie it. A
// parameter that this file defines must be used by it, if only through another one, unless it is
// marked as documentation; parameters_file may hold more than one model needs.
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

/// Format of models, experiments and measurements; incremented when the meaning of a valid file
/// changes.
inline constexpr int kFileFormat = 1;

/// A refused input. what() is one line: "FILE: KEY: expected ..., got ...; what to do".
struct InputError : std::runtime_error {
  InputError(std::string file_name, std::string key_name, std::string text);
  std::string file;     ///< the file that holds the fault
  std::string key;      ///< as in the file: body[1].mass (counted from 0), parameters.m_r.value
  std::string message;  ///< the rest of the line
};

struct Parameter {
  std::string name;
  double value = 0.0;
  std::string unit;
  std::string source;
  std::string file;                 ///< where it was defined last
  bool used = false;                ///< some element of the model refers to it
  bool overridden = false;          ///< its value comes from an Override
  bool documentation = false;       ///< kept to be read: nothing needs to refer to it
  std::string expression;           ///< what its value is computed by, "m / tau"; empty: by nothing
  std::vector<std::string> refers;  ///< the parameters in its expressions, overridden or not
};

inline constexpr int kGround = -1;  ///< body index of "ground"

struct Body {
  std::string name;
  double mass = 0.0;      ///< kg, > 0
  double position = 0.0;  ///< m, at tick 0
  double velocity = 0.0;  ///< m/s, at tick 0
};

/// Index of a body, or kGround, for each end.
struct Ends {
  int a = kGround;
  int b = kGround;
};

/// A continuous piecewise-linear curve through the origin: slopes[k] between breaks[k-1] and
/// breaks[k]. One slope and no break is a straight line.
struct Slopes {
  std::vector<double> slopes;
  std::vector<double> breaks;  ///< rising
};

struct Spring {
  std::string name;
  Ends ends;
  Slopes stiffness;      ///< N/m, >= 0, over m
  double damping = 0.0;  ///< N s/m, >= 0
};

struct Damper {
  std::string name;
  Ends ends;
  Slopes damping;  ///< N s/m, >= 0, over m/s
};

struct Contact {
  std::string name;
  Ends ends;
  double stiffness = 0.0;  ///< N/m, > 0
  double damping = 0.0;    ///< N s/m, >= 0
  double gap = 0.0;        ///< m; overlap d = x_a - x_b - gap
};

/// A backlash or limit stops: free while low < d < high, a contact beyond.
struct Stop {
  std::string name;
  Ends ends;
  double stiffness = 0.0;      ///< N/m, > 0
  double damping = 0.0;        ///< N s/m, >= 0
  std::optional<double> low;   ///< m; at least one of the two
  std::optional<double> high;  ///< m, >= low
};

struct Friction {
  std::string name;
  Ends ends;
  double coulomb = 0.0;   ///< N, >= 0, while sliding
  double stiction = 0.0;  ///< N, >= coulomb, at which sliding begins
};

/// Held by `holding` until it is released, and again after it has engaged; engaged at tick 0.
struct Brake {
  std::string name;
  Ends ends;
  double holding = 0.0;    ///< N, > 0, while it sticks and while it slides
  double release_s = 0.0;  ///< s, >= 0, from the output to where it lets go
  double engage_s = 0.0;   ///< s, >= 0, from the output to where it holds
};

struct Gravity {
  std::string name;
  int body = kGround;
  std::vector<double> positions;      ///< m, rising; empty: constant
  std::vector<double> accelerations;  ///< m/s^2, one a position, or one
};

/// Current-fed DC motor behind a preamplifier with tachometer feedback (Figs 4.1-4.4):
///   vf' = a_preamp_fdbk (k_preamp_fdbk (k_tach / r_trans * v + t) - vf) filtered tachometer, V
///   c   = clamp(k_preamp_cmd u - vf, +-preamp_limit)                  current command, V
///   e   = c - clamp(k_current i, +-current_feedback_limit)            current error, V
///   vm  = slope k_amp up to |e| = amp_break, k_amp_outer beyond, clamped to +-supply_limit
///   L i' = vm - R i - k_back_emf / r_trans * v
///   F   = k_torque / r_trans * i - b_m / r_trans^2 * v                on the body, -F on reaction
/// The output of the DAC (or an analyzer) is the velocity command u, with t = 0; with input =
/// "tach" it is added to the tachometer's voltage instead: t, with u = 0 (Fig 3.7). v is the
/// velocity of the body against the reaction body. Disabled: i = 0, F = -b_m/r^2 v.
struct DcMotor {
  bool input_tach = false;                       ///< key input, "command" (default) or "tach"
  double k_preamp_cmd = 0.0;                     ///< V/V
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
  std::optional<double> current_feedback_limit;  ///< V, > 0; none: not limited
  std::optional<double> preamp_limit;            ///< V, > 0; none: not limited
  double k_amp = 0.0;                            ///< V/V, > 0
  std::optional<double> amp_break;               ///< V, > 0; none: one slope
  double k_amp_outer = 0.0;                      ///< V/V, >= 0; k_amp without amp_break
  std::optional<double> supply_limit;            ///< V, > 0; none: not limited
};

/// F' = a_act (k_act (velocity_per_volt u - v) - F), the simple actuator of 2.3; the force on the
/// body is clamp(F, +-force_limit). Disabled: F = 0.
struct FirstOrderDrive {
  double k_act = 0.0;                 ///< N s/m, > 0
  double a_act = 0.0;                 ///< rad/s, > 0
  double velocity_per_volt = 0.0;     ///< m/s per V, not 0
  std::optional<double> force_limit;  ///< N, > 0; none: not limited
};

/// F = clamp(force_per_volt u, +-force_limit). Disabled: F = 0.
struct PerfectDrive {
  double force_per_volt = 0.0;        ///< N/V, not 0
  std::optional<double> force_limit;  ///< N, > 0; none: not limited
};

struct Drive {
  int body = kGround;
  int reaction = kGround;
  std::variant<DcMotor, FirstOrderDrive, PerfectDrive> type;
};

/// Counts the body's position against that of the reference: a motor's encoder on a moving base.
struct Encoder {
  int body = kGround;
  int reference = kGround;
  double scale = 0.0;  ///< count/m, not 0
};

/// Switches on the way of the encoder's body, against the encoder's reference. A place that is
/// absent gives no switch; of the home switch one end may be absent: it is on up to the end of the
/// way.
struct Switches {
  std::optional<double> limit_neg;    ///< m: on at and below it
  std::optional<double> limit_pos;    ///< m: on at and beyond it
  std::optional<double> home_from;    ///< m: on at and beyond it,
  std::optional<double> home_to;      ///< m: and below it
  std::optional<double> index;        ///< m: a pulse where the body passes it
  std::optional<double> index_every;  ///< m, > 0: and every such distance; none: one pulse
};

/// signal -> clamp(+-sensor_limit) -> first-order low pass -> clamp(+-conditioning_limit) -> noise
/// -> code. All quantities are in the unit of the signal.
struct Adc {
  std::string signal;
  std::optional<double> sensor_limit;  ///< > 0: where the sensor itself saturates
  std::optional<double> filter;  ///< rad/s, > 0, at most 1e6: y' = filter (x - y), 0 at the start
  std::optional<double> conditioning_limit;  ///< > 0: where the analog electronics saturate
  double noise = 0.0;                        ///< rms, >= 0
  double per_count = 0.0;                    ///< unit of the signal per count, not 0
  int zero_code = 0;                         ///< code at signal = 0, 0..2^bits-1
  int bits = 8;                              ///< 8..16
};

struct Dac {
  int bits = 12;        ///< 8..16, codes -2^(bits-1)..2^(bits-1)-1
  double range = 10.0;  ///< V at code -2^(bits-1), negated
  double offset = 0.0;  ///< V at code 0
  double noise = 0.0;   ///< V rms, >= 0
  double volts_per_code() const { return 2.0 * range / static_cast<double>(1 << bits); }
};

/// A named true signal of a model and what it measures.
///   BODY.position m, .velocity m/s, .acceleration m/s^2 (the output of an accelerometer on it)
///   LINK.force N (positive pushes a back), .spring_force N (its stiffness part alone, the output
///   of
///       a strain gauge; 0 for a damper, a friction and out of contact), .spring_force_rate N/s (k
///       d', the output of a velocity-sensing force sensor, 6.2.1), .deflection m (overlap of a
///       contact, < 0 is a gap; x_a - x_b of a stop); LINK is any element with two ends
///   GRAVITY.force N
///   drive.force N, .command V (held DAC output); dc_motor also .current A, .tach V (unfiltered),
///       .tach_filtered V (vf), .current_command V (c), .voltage V (vm; the back EMF when disabled)
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
  std::vector<Stop> stops;  ///< backlashes too
  std::vector<Friction> frictions;
  std::vector<Brake> brakes;
  std::vector<Gravity> gravities;
  std::optional<Drive> drive;
  std::optional<Encoder> encoder;
  Switches switches;
  std::array<std::optional<Adc>, 2> adc;
  Dac dac;

  /// Visits everything with two ends but the drive, in the order of the signals.
  template <class Visit>
  void each_link(Visit visit) const {
    for (const Spring &spring : springs) visit(spring);
    for (const Damper &damper : dampers) visit(damper);
    for (const Contact &contact : contacts) visit(contact);
    for (const Stop &stop : stops) visit(stop);
    for (const Friction &friction : frictions) visit(friction);
    for (const Brake &brake : brakes) visit(brake);
  }
  /// Every signal of the model, in the order of Plant::signals().
  std::vector<SignalInfo> signal_list() const;
  /// Index of a body by name. Throws std::invalid_argument for an unknown name.
  int body_index(std::string_view name) const;
};

/// Replaces the value of one parameter: by a number in the parameter's own unit, or by a text,
/// which is a quantity or another parameter's name. Other overrides apply to that one first.
struct Override {
  std::string parameter;
  std::variant<double, std::string> value;
};

/// Reads and checks a model. Overrides must name parameters of the model (or of its
/// parameters_file); Parameter::used is false for one that nothing in the model uses. Mistakes in
/// them are reported as `set.NAME` of the file `overrides_file`, if that is not empty. Throws
/// InputError.
Model load_model(const std::filesystem::path &path, std::span<const Override> overrides = {},
                 const std::string &overrides_file = "");

}  // namespace forceaxis::sim
