#pragma once
#include <optional>
#include <variant>

#include "sim/model/elements/bus_cycle.hpp"
#include "sim/model/elements/ends.hpp"

namespace forceaxis::sim {

inline constexpr KeyFormat kForceLimitKey =
    format::optional("force_limit", Dimension::force, Sign::positive, "not limited",
                     "Largest force of the drive in either direction.");

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
  static constexpr std::string_view kMeaning =
      "A DC motor with a current amplifier, after a preamplifier with tachometer feedback. "
      "DcMotor in sim/model/elements/drive.hpp has the equations.";
  static constexpr std::string_view kWhen = "type = \"dc_motor\"";
  /// Use of the DAC voltage: as velocity command, or added to the tachometer voltage.
  enum class Input { command, tach } input = Input::command;
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

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(&DcMotor::input,
              choice("input", "command, tach", "command", "choose the use of the DAC voltage",
                     "Use of the DAC voltage: as velocity command u, or added to the tachometer "
                     "voltage as t.")),
        field(&DcMotor::k_preamp_cmd, needed("k_preamp_cmd", D::ratio, not_zero,
                                             "Gain of the preamplifier for the command.")),
        field(&DcMotor::k_preamp_fdbk, needed("k_preamp_fdbk", D::ratio, not_negative,
                                              "Gain of the preamplifier for the tachometer.")),
        field(&DcMotor::a_preamp_fdbk, needed("a_preamp_fdbk", D::rate, positive,
                                              "Corner frequency of the tachometer filter.")),
        field(&DcMotor::k_tach, needed("k_tach", D::speed_constant, not_negative,
                                       "Tachometer voltage at a motor speed of 1 rad/s.")),
        field(&DcMotor::k_torque,
              needed("k_torque", D::torque_constant, positive, "Torque constant.")),
        field(&DcMotor::k_back_emf,
              needed("k_back_emf", D::speed_constant, not_negative, "Constant of the back EMF.")),
        field(&DcMotor::inductance,
              needed("L", D::inductance, positive, "Inductance of the winding.")),
        field(&DcMotor::resistance,
              needed("R", D::resistance, not_negative, "Resistance of the winding.")),
        field(&DcMotor::r_trans, needed("r_trans", D::transmission, positive,
                                        "Travel of the body for one radian of the motor.")),
        field(&DcMotor::b_m, number("b_m", D::rotary_damping, not_negative, 0.0,
                                    "Viscous friction of the motor.")),
        field(&DcMotor::k_current, needed("k_current", D::volt_per_amp, not_negative,
                                          "Gain of the current measurement.")),
        field(&DcMotor::current_feedback_limit,
              optional("current_feedback_limit", D::voltage, positive, "not limited",
                       "Voltage at which the current measurement saturates.")),
        field(&DcMotor::preamp_limit, optional("preamp_limit", D::voltage, positive, "not limited",
                                               "Voltage at which the current command saturates.")),
        field(&DcMotor::k_amp, needed("k_amp", D::ratio, positive,
                                      "Gain of the power stage for the current error.")),
        field(&DcMotor::amp_break, optional("amp_break", D::voltage, positive, "one slope",
                                            "Current error, as a voltage, above which the power "
                                            "stage has the gain k_amp_outer.")),
        field(&DcMotor::k_amp_outer,
              optional("k_amp_outer", D::ratio, not_negative, "k_amp",
                       "Gain of the power stage above amp_break; required if amp_break is given.")),
        field(&DcMotor::supply_limit, optional("supply_limit", D::voltage, positive, "not limited",
                                               "Largest voltage at the motor.")));
  }
  void complete(Section &section, Names &names);
};

/// The simple actuator of section 2.3: F' = a_act (k_act (velocity_per_volt u - v) - F). The force
/// on the body is F, limited to +-force_limit. While the drive is disabled, F = 0.
struct FirstOrderDrive {
  static constexpr std::string_view kMeaning =
      "A velocity-controlled actuator: F' = a_act (k_act (velocity_per_volt u - v) - F).";
  static constexpr std::string_view kWhen = "type = \"first_order\"";
  double k_act = 0.0;                 ///< steady-state force per velocity error in N s/m, > 0
  double a_act = 0.0;                 ///< corner frequency of the drive force in rad/s, > 0
  double velocity_per_volt = 0.0;     ///< velocity per command voltage in m/s per V, not 0
  std::optional<double> force_limit;  ///< largest drive force in N, > 0; empty: not limited

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(&FirstOrderDrive::k_act, needed("k_act", D::damping, positive,
                                              "Steady-state force divided by the velocity error.")),
        field(&FirstOrderDrive::a_act,
              needed("a_act", D::rate, positive,
                     "Corner frequency of the first-order lag of the force.")),
        field(&FirstOrderDrive::velocity_per_volt,
              needed("velocity_per_volt", D::velocity_per_volt, not_zero,
                     "Commanded velocity at a DAC voltage of 1 V.")),
        field(&FirstOrderDrive::force_limit, kForceLimitKey));
  }
};

/// A drive without dynamics. Its force is F = force_per_volt u, limited to +-force_limit, or 0
/// while the drive is disabled.
struct PerfectDrive {
  static constexpr std::string_view kMeaning = "A force source: F = force_per_volt u.";
  static constexpr std::string_view kWhen = "type = \"perfect\"";
  double force_per_volt = 0.0;        ///< drive force per command voltage in N/V, not 0
  std::optional<double> force_limit;  ///< largest drive force in N, > 0; empty: not limited

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(&PerfectDrive::force_per_volt, needed("force_per_volt", D::force_per_volt, not_zero,
                                                    "Force at a DAC voltage of 1 V.")),
        field(&PerfectDrive::force_limit, kForceLimitKey));
  }
};

/// A motor with a current loop. Torque drives and velocity drives have such a motor:
///   i' = rate (c - i)            c is the limited target of the current in A
///   F  = force_per_amp i         on the body, -F on reaction
/// |c| is at most peak_current. With a rated current, |c| is at most rated_current from the instant
/// at which the mean current h of the drive has reached rated_current:
///   h' = (max(|i|, rated_current / 2) - h) / T,    T = peak_time / ln((Ip - Ir / 2) / (Ip - Ir))
/// h begins at rated_current / 2. It reaches rated_current when peak_current has flowed for
/// peak_time, and peak_current is available again when h is below 3/4 of rated_current. While the
/// drive is disabled, i = 0 and h continues.
struct DriveMotor {
  double force_per_amp = 0.0;  ///< force constant in N/A, > 0: k_force, or k_torque / r_trans
  double rate = 0.0;           ///< bandwidth of the current loop in rad/s, > 0
  std::optional<double> peak_current;  ///< largest current in A, > 0; empty: not limited

  /// Rated current in A, > 0 and < peak_current; empty: no second limit.
  std::optional<double> rated_current;
  /// Time in s for which peak_current may flow, > 0 if rated_current is given.
  double peak_time = 0.0;
  // Values that the model file may have in place of k_force:
  std::optional<double> k_torque;  ///< torque constant in N m/A, > 0

  /// Travel per motor angle in m/rad, > 0; also used for an inertia of the tuning.
  std::optional<double> r_trans;

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(&DriveMotor::force_per_amp,
              optional("k_force", D::force_per_current, positive, "k_torque / r_trans",
                       "Force constant of a linear motor, in place of k_torque and r_trans.")),
        field(&DriveMotor::k_torque,
              optional("k_torque", D::torque_constant, positive, "k_force must be given",
                       "Torque constant of a rotary motor.")),
        field(
            &DriveMotor::r_trans,
            optional("r_trans", D::transmission, positive, "k_force must be given",
                     "Travel of the body for one radian of the motor: the lead of a screw such as "
                     "\"10 mm/rev\", or the radius of a pulley divided by the ratio of its gear.")),
        field(&DriveMotor::rate, needed("current_bandwidth", D::rate, positive,
                                        "Frequency at which the current loop, a first-order lag, "
                                        "follows its target with -3 dB.")),
        field(&DriveMotor::peak_current, optional("peak_current", D::current, positive,
                                                  "not limited", "Largest target of the current.")),
        field(&DriveMotor::rated_current,
              beside("peak_current",
                     optional("rated_current", D::current, positive, "peak_current at all times",
                              "Largest target of the current after the drive has given "
                              "peak_current for peak_time; less than peak_current. DriveMotor in "
                              "sim/model/elements/drive.hpp has the equations."))),
        field(&DriveMotor::peak_time,
              needed_beside(
                  "rated_current",
                  optional("peak_time", D::time, positive, "rated_current must be omitted too",
                           "Time for which the drive gives peak_current after a long rest."))));
  }
  /// `turns` is true if another key needs the transmission of the motor in addition to k_force.
  void complete(Section &section, bool turns);
};

/// A current amplifier with its motor. The target of the current is
///   c = current_per_volt u - damping / force_per_amp v
struct TorqueDrive {
  static constexpr std::string_view kMeaning =
      "A current amplifier with its motor, rotary or linear: the current follows current_per_volt "
      "u as a first-order lag, and the force follows the current. TorqueDrive in "
      "sim/model/elements/drive.hpp has the equations.";
  static constexpr std::string_view kWhen = "type = \"torque\"";
  DriveMotor motor;
  double current_per_volt = 0.0;  ///< target current per command voltage in A/V, not 0
  double damping = 0.0;           ///< velocity damping in the drive in N s/m, >= 0

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(&TorqueDrive::current_per_volt,
              needed("current_per_volt", D::current_per_volt, not_zero,
                     "Target of the current at a DAC voltage of 1 V.")),
        part(&TorqueDrive::motor),
        field(&TorqueDrive::damping, number("damping", D::damping, not_negative, 0.0,
                                            "Velocity damping in the drive: its target is lowered "
                                            "by the current whose force is damping * v.")));
  }
  void complete(Section &section, Names &) { motor.complete(section, false); }
};

/// A drive with its own velocity loop. The target of the current is
///   c = k_velocity / force_per_amp (velocity_per_volt u - v) + q,    q' = (c - q) / integral_time
/// In the equation of q', c is the limited target. Within the limits, this is a PI controller with
/// q' = k_velocity / force_per_amp (velocity_per_volt u - v) / integral_time. If the target is at
/// its limit, q goes to this limit and no further. While the drive is disabled, q = 0.
struct VelocityDrive {
  static constexpr std::string_view kMeaning =
      "A drive with a velocity loop of its own: a PI controller of the velocity above a current "
      "loop. The integral follows the limited target of the current, so it does not wind up. The "
      "gains are given, or computed from bandwidth, damping_ratio and the mass for which the loop "
      "was tuned; `linearise_model` prints them. VelocityDrive in "
      "sim/model/elements/drive.hpp has the equations.";
  static constexpr std::string_view kWhen = "type = \"velocity\"";
  DriveMotor motor;
  double velocity_per_volt = 0.0;       ///< velocity per command voltage in m/s per V, not 0
  double k_velocity = 0.0;              ///< proportional gain of the velocity loop in N s/m, > 0
  std::optional<double> integral_time;  ///< integral time in s, > 0; empty: no integral action

  /// Values that the model file may have in place of k_velocity and integral_time.
  struct Tuning {
    std::optional<double> bandwidth;  ///< bandwidth of the velocity loop in rad/s, > 0
    double damping_ratio = 0.7071;
    std::optional<double> mass;  ///< mass in kg, > 0, for which the velocity loop is tuned

    /// Inertia at the motor for which the loop is tuned in kg m^2, > 0.
    std::optional<double> inertia;
  };
  Tuning tuning;

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(&VelocityDrive::velocity_per_volt,
              needed("velocity_per_volt", D::velocity_per_volt, not_zero,
                     "Target of the velocity at a DAC voltage of 1 V.")),
        part(&VelocityDrive::motor),
        field(&VelocityDrive::k_velocity,
              optional("k_velocity", D::damping, positive, "computed from bandwidth",
                       "Proportional gain of the velocity loop: the force for a velocity error.")),
        field(&VelocityDrive::integral_time,
              optional("integral_time", D::time, positive, "no integral",
                       "Integral time of the velocity loop: its integral "
                       "grows in this time by the proportional part.")),
        field(&VelocityDrive::tuning, &Tuning::bandwidth,
              optional("bandwidth", D::rate, positive, "k_velocity must be given",
                       "Frequency at which the closed velocity loop follows its target with -3 dB, "
                       "in place of k_velocity and integral_time.")),
        field(&VelocityDrive::tuning, &Tuning::damping_ratio,
              ranged("damping_ratio", D::ratio, 0.3, 2.0, "0.7071",
                     "Damping ratio of the two slow poles of the closed "
                     "velocity loop, beside bandwidth.")),
        field(&VelocityDrive::tuning, &Tuning::mass,
              optional("tuned_mass", D::mass, positive, "tuned_inertia must be given",
                       "Moving mass for which the velocity loop was tuned, beside bandwidth.")),
        field(&VelocityDrive::tuning, &Tuning::inertia,
              optional("tuned_inertia", D::inertia, positive, "tuned_mass must be given",
                       "Inertia at the motor for which the velocity loop was tuned, in "
                       "place of tuned_mass.")));
  }
  /// Computes k_velocity and integral_time from `tuning`.
  void complete(Section &section, Names &names);
};

/// Gains with which the closed velocity loop of a mass has -3 dB at a frequency. The loop has two
/// poles with the damping ratio and a third one on the real axis. Returns nothing if the current
/// loop is too slow: then no gains give this bandwidth.
struct VelocityGains {
  double k_velocity = 0.0;     ///< proportional gain in N s/m
  double integral_time = 0.0;  ///< integral time in s
};
std::optional<VelocityGains> velocity_gains(double mass_kg, double bandwidth, double damping_ratio,
                                            double current_bandwidth);

/// A stepper motor. Its driver turns the magnetic field by steps, with the DAC voltage as velocity
/// command. The load angle w is the travel of the field less the travel of the body since the drive
/// was enabled:
///   w' = velocity_per_volt u - v
///   F  = f(w) + damping w'       on the body, -F on reaction
/// f is linear between points that lie on holding_force sin(2 pi w / (4 full_step)) at equal
/// distances. Beyond kPeriods periods of 4 full steps F is 0: the motor has stalled. While the
/// drive is disabled, w = 0 and F = 0.
struct StepperDrive {
  static constexpr std::string_view kMeaning =
      "A stepper motor without an encoder of its own. Its force is a sine of the load angle, the "
      "travel of the field less that of the body, so it resists as a spring and slips by 4 full "
      "steps if the load is more than holding_force. After a slip of 8 such periods the motor has "
      "stalled and has no force until it is disabled and enabled again, which sets the load angle "
      "to 0. StepperDrive in sim/model/elements/drive.hpp has the equations.";
  static constexpr std::string_view kWhen = "type = \"stepper\"";
  static constexpr int kPeriods = 8;
  /// Velocity of the field per command voltage in m/s per V, not 0.
  double velocity_per_volt = 0.0;
  double holding_force = 0.0;  ///< largest f in N, > 0
  double full_step = 0.0;      ///< travel of the body for a full step in m, > 0
  double damping = 0.0;        ///< damping of the load angle in N s/m, >= 0
  int segments = 16;           ///< number of straight segments per period of the sine: 4, 8, ... 32

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(&StepperDrive::velocity_per_volt,
              needed("velocity_per_volt", D::velocity_per_volt, not_zero,
                     "Velocity of the field at a DAC voltage of 1 V, as travel of the body.")),
        field(&StepperDrive::holding_force,
              needed("holding_force", D::force, positive,
                     "Largest force on the body: the holding torque of the motor at the current of "
                     "its driver, divided by the travel for one radian.")),
        field(&StepperDrive::full_step,
              needed("full_step", D::length, positive,
                     "Travel of the body for a full step: the lead of a screw divided by 200 for a "
                     "motor of 1.8 degrees. The force repeats after 4 full steps.")),
        field(
            &StepperDrive::damping,
            number("damping", D::damping, not_negative, 0.0,
                   "Force for a difference between the velocities of the field and of the body.")),
        field(&StepperDrive::segments,
              integer("segments", 4, 32, 16.0,
                      "Straight segments in a period of the sine of the load angle, a multiple of "
                      "4. They meet the sine at their ends; between them they are less, at most by "
                      "1 - cos(pi / segments) of holding_force: 7.6 % with 8, 1.9 % with 16, 0.5 % "
                      "with 32.")));
  }
  void complete(Section &section, Names &names);
};

struct Drive {
  static constexpr std::string_view kMeaning =
      "The motor with its amplifier. The DAC voltage u is its input.";
  int body = kGround;
  int reaction = kGround;
  BusCycle bus;
  /// Number of ticks from amp_enable until the drive follows the DAC code; empty: the drive sends
  /// no report.
  std::optional<int> enable_ticks;
  using Type = std::variant<DcMotor, FirstOrderDrive, PerfectDrive, TorqueDrive, VelocityDrive,
                            StepperDrive>;
  Type type;

  /// Returns the motor of a torque or velocity drive, or nullptr for another type.
  const DriveMotor *motor() const {
    if (const auto *torque = std::get_if<TorqueDrive>(&type)) return &torque->motor;
    if (const auto *velocity = std::get_if<VelocityDrive>(&type)) return &velocity->motor;
    return nullptr;
  }

  static constexpr auto rows() {
    using namespace format;
    return rows_of(
        field(&Drive::type,
              choice("type", "dc_motor, first_order, perfect, torque, velocity, stepper", "",
                     "choose a drive type", "Type of the drive. It adds the keys below.")),
        field(&Drive::body,
              other("body", "body", "", "The body on which the drive exerts its force.")),
        field(&Drive::reaction, other("reaction", "body or ground", "ground",
                                      "The body on which the reaction force acts.")),
        part(&Drive::bus),
        field(&Drive::enable_ticks,
              optional_integer("enable_ticks", 0, 65535, "the drive reports nothing",
                               "Ticks from `amp_enable` until the drive follows the code; until "
                               "then it is disabled. The drive reports to the firmware that it is "
                               "fitted and whether it is on, with the encoder count. Without this "
                               "key the firmware sees an amplifier for +-10 V.")));
  }
  void complete(Section &section, Names &names);
};

}  // namespace forceaxis::sim
