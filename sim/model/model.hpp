#pragma once
// A plant as its file describes it: checked, immutable, without any dynamics.
//
// load_model() reads a TOML file and either returns a Model in which every rule below holds or
// throws InputError with one line that names file, key, what was expected and what to do. Nothing
// else leaves it (but std::bad_alloc). Positive motion is toward the workpiece; SI units
// throughout.
//
//   title = "..."   shows = "..."               optional texts
//   parameters_file = "thesis.toml"             optional, relative to this file; holds [parameters]
//   [parameters]                                own entries win over those of parameters_file
//   m_r = { value = 132.4, unit = "kg", source = "Fig 4.26" }            source is optional
//   [[body]]    name, mass > 0, position = 0, velocity = 0
//   [[spring]]  name, between = ["a", "b"], stiffness >= 0, damping = 0
//   [[damper]]  name, between, damping >= 0
//   [[contact]] name, between, stiffness > 0, damping = 0, gap = 0
//   [drive]     type = "dc_motor" | "first_order" | "perfect", body, reaction = "ground", ...
//   [encoder]   body, scale (count/m)
//   [[adc]]     channel 0 | 1, signal, per_count (unit of the signal per count, sign allowed),
//               zero_code = 0 (a whole number), bits = 8 (8..16)
//   [dac]       bits = 12 (8..16), range = 10 V, offset = 0 V:
//               volts = code * 2 range / 2^bits + offset
//
// A value is a number (SI), the name of a parameter, or "-name". One end of `between` may be
// "ground". Deflection is d = x_a - x_b (less `gap` for a contact); a positive force pushes a back
// and b forward. A contact gives k d + b d' while d > 0 and that sum is > 0, else 0. Every body
// must be tied to ground through springs, dampers, contacts or the drive. A parameter that this
// file defines must be used by it; parameters_file may hold more than one model needs.
//
// clang-format off
// Accepted units of parameters, by what they measure (each line: spellings of one dimension):
//   1, V/V                          ratio                count                       codes
//   kg                              mass                 m                           length
//   s                               time                 m/s                         velocity
//   N                               force                N s, N*s, kg m/s            impulse
//   N/m                             stiffness            N s/m, N*s/m, kg/s          damping
//   V                               voltage              A                           current
//   ohm                             resistance           H                           inductance
//   V/A                             current sensing      N m/A, N*m/A                torque constant
//   V s/rad, V*s/rad                speed constant       m/rad                       transmission
//   rad/s, 1/s                      rate                 N m s/rad, N*m*s/rad        rotary damping
//   kg m^2, kg*m^2                  inertia              N/V                         drive gain
//   m/s/V, m/(s V)                  speed per volt       count/m                     encoder scale
//   N/count  A/count  V/count  m/count  m/s/count        ADC scale of such a signal
// clang-format on
#include <array>
#include <filesystem>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace forceaxis::sim {

/// A refused input. what() is one line: "FILE: KEY: expected ..., got ...; what to do".
struct InputError : std::runtime_error {
  InputError(std::string file_name, std::string key_name, std::string text);
  std::string file;     ///< the file that holds the fault
  std::string key;      ///< as in the file: body[1].mass (counted from 0), parameters.m_r.value
  std::string message;  ///< the rest of the line
};

/// What a value measures. The accepted spellings are listed at the top of this header.
enum class Dimension {
  ratio,
  count,
  mass,
  length,
  time,
  velocity,
  force,
  impulse,
  stiffness,
  damping,
  voltage,
  current,
  resistance,
  inductance,
  volt_per_amp,
  torque_constant,
  speed_constant,
  transmission,
  rate,
  rotary_damping,
  inertia,
  force_per_volt,
  velocity_per_volt,
  count_per_length,
  force_per_count,
  current_per_count,
  voltage_per_count,
  length_per_count,
  velocity_per_count,
};

/// The first of the accepted spellings, e.g. "N s/m".
std::string_view unit_of(Dimension dimension);
/// The dimension of a spelling, or nothing if it is not in the list.
std::optional<Dimension> dimension_of(std::string_view unit);

struct Parameter {
  std::string name;
  double value = 0.0;
  std::string unit;
  std::string source;
  std::string file;         ///< where it was defined last
  bool used = false;        ///< some element of the model refers to it
  bool overridden = false;  ///< its value comes from an Override
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

struct Spring {
  std::string name;
  Ends ends;
  double stiffness = 0.0;  ///< N/m, >= 0
  double damping = 0.0;    ///< N s/m, >= 0
};

struct Damper {
  std::string name;
  Ends ends;
  double damping = 0.0;  ///< N s/m, >= 0
};

struct Contact {
  std::string name;
  Ends ends;
  double stiffness = 0.0;  ///< N/m, > 0
  double damping = 0.0;    ///< N s/m, >= 0
  double gap = 0.0;        ///< m; overlap d = x_a - x_b - gap
};

/// Current-fed DC motor behind a preamplifier with tachometer feedback (Figs 4.1-4.4):
///   vf' = a_preamp_fdbk (k_preamp_fdbk k_tach / r_trans * v - vf)     filtered tachometer, V
///   c   = clamp(k_preamp_cmd u - vf, +-preamp_limit)                  current command, V
///   e   = c - clamp(k_current i, +-current_feedback_limit)            current error, V
///   vm  = slope k_amp up to |e| = amp_break, k_amp_outer beyond, clamped to +-supply_limit
///   L i' = vm - R i - k_back_emf / r_trans * v
///   F   = k_torque / r_trans * i - b_m / r_trans^2 * v                on the body, -F on reaction
/// v is the velocity of the body against the reaction body. Disabled: i = 0, F = -b_m/r^2 v.
struct DcMotor {
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

/// F' = a_act (k_act (velocity_per_volt u - v) - F), the simple actuator of 2.3. Disabled: F = 0.
struct FirstOrderDrive {
  double k_act = 0.0;              ///< N s/m, > 0
  double a_act = 0.0;              ///< rad/s, > 0
  double velocity_per_volt = 0.0;  ///< m/s per V, not 0
};

/// F = force_per_volt u. Disabled: F = 0.
struct PerfectDrive {
  double force_per_volt = 0.0;  ///< N/V, not 0
};

struct Drive {
  int body = kGround;
  int reaction = kGround;
  std::variant<DcMotor, FirstOrderDrive, PerfectDrive> type;
};

struct Encoder {
  int body = kGround;
  double scale = 0.0;  ///< count/m, not 0
};

struct Adc {
  std::string signal;
  double per_count = 0.0;  ///< unit of the signal per count, not 0
  int zero_code = 0;       ///< code at signal = 0, 0..2^bits-1
  int bits = 8;            ///< 8..16
};

struct Dac {
  int bits = 12;        ///< 8..16, codes -2^(bits-1)..2^(bits-1)-1
  double range = 10.0;  ///< V at code -2^(bits-1), negated
  double offset = 0.0;  ///< V at code 0
  double volts_per_code() const { return 2.0 * range / static_cast<double>(1 << bits); }
};

/// A named truth signal of a model and what it measures.
///   BODY.position m, .velocity m/s
///   SPRING|DAMPER|CONTACT.force N (what pushes a back), .spring_force N (its stiffness part alone;
///       0 for a damper and out of contact), .deflection m (overlap of a contact, < 0 is a gap)
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
  std::optional<Drive> drive;
  std::optional<Encoder> encoder;
  std::array<std::optional<Adc>, 2> adc;
  Dac dac;

  /// Every signal of the model, in the order of Plant::signals().
  std::vector<SignalInfo> signal_list() const;
  /// Index of a body by name. Throws std::invalid_argument for an unknown name.
  int body_index(std::string_view name) const;
};

/// Replaces the value (in the parameter's own unit) of one parameter.
struct Override {
  std::string parameter;
  double value;
};

/// Reads and checks a model. Overrides must name parameters of the model (or of its
/// parameters_file); Parameter::used tells whether an override had anything to act on.
/// Throws InputError.
Model load_model(const std::filesystem::path &path, std::span<const Override> overrides = {});

}  // namespace forceaxis::sim
