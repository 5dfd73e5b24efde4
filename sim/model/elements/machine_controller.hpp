#pragma once
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "sim/model/elements/ends.hpp"

namespace forceaxis::sim {

/// Settings of a controller that measures a force, in addition to its law.
struct MachineForce {
  std::string signal;            ///< force that the controller measures
  double setpoint = 0.0;         ///< set-point of the force in N
  double speed_max = 0.0;        ///< largest commanded speed in m/s, > 0
  std::optional<double> filter;  ///< corner frequency of the force's low-pass filter in rad/s, > 0
  int delay_ticks = 0;           ///< delay of the measured force in ticks, 0..30

  static constexpr auto demand() {
    using namespace format;
    return rows_of(
        field(&MachineForce::signal,
              other("signal", "signal", "",
                    "Force signal of the model that the controller measures.")),
        field(&MachineForce::setpoint,
              needed("setpoint", Dimension::force, Sign::any, "Set-point of the force.")),
        field(&MachineForce::speed_max, needed("speed_max", Dimension::velocity, Sign::positive,
                                               "Largest velocity that the controller commands; "
                                               "without contact it approaches with it.")));
  }
  static constexpr auto path() {
    using namespace format;
    return rows_of(
        field(&MachineForce::filter,
              optional("filter", Dimension::rate, Sign::positive, "no filter",
                       "Corner frequency of a first-order low pass of the measured force.")),
        field(&MachineForce::delay_ticks,
              integer("delay_ticks", 0, 30, 0.0, "Ticks by which the measured force is late.")));
  }
  void complete(Section &section, Names &names);
};

/// Commands of a controller of the machine as a function of the time.
struct MachineTable {
  static constexpr std::string_view kMeaning =
      "Commands that are given as a table over the time, such as those of a recording.";
  static constexpr std::string_view kWhen = "law = \"table\"";
  std::vector<double> times;   ///< times in s since tick 0 in ascending order, >= 0, at least two
  std::vector<double> values;  ///< command in m/s or N at each time; constant before the first and
                               ///< after the last time
  bool interpolated = false;   ///< false: each command is held until the next time
  std::vector<double> speeds;  ///< commands in m/s in the model file
  std::vector<double> forces;  ///< commands in N; the model file has either `forces` or `speeds`

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        field(&MachineTable::times,
              rising(numbers("times", D::time, not_negative, "",
                             "Times since tick 0, ascending, at least two."))),
        field(&MachineTable::speeds, numbers("speeds", D::velocity, any, "forces must be given",
                                             "Velocity that the controller commands at each time, "
                                             "for a drive that follows a velocity.")),
        field(&MachineTable::forces, numbers("forces", D::force, any, "speeds must be given",
                                             "Force that the controller commands at each time, for "
                                             "a drive that follows a force.")),
        field(&MachineTable::interpolated,
              other("interpolated", "flag", "false",
                    "Whether the command of a tick lies on the line between two times; otherwise a "
                    "value is held until the next time.")));
  }
  void complete(Section &section, Names &names);
};

/// Virtual mass and damping of an admittance.
struct MachineAdmittance : MachineForce {
  static constexpr std::string_view kMeaning =
      "An admittance: the velocity v of a virtual mass, mass v' = f - damping v, where f is the "
      "set-point less the measured force. At speed_max it stops to accelerate.";
  static constexpr std::string_view kWhen = "law = \"admittance\"";
  double mass = 0.0;     ///< virtual mass in kg, > 0
  double damping = 0.0;  ///< virtual damping in N s/m, >= 0

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(
        demand(),
        field(&MachineAdmittance::mass,
              needed("mass", D::mass, positive, "Virtual mass of the admittance.")),
        field(&MachineAdmittance::damping, number("damping", D::damping, not_negative, 0.0,
                                                  "Virtual damping of the admittance.")),
        path());
  }
};

/// A PI controller of the force whose output is a velocity.
struct MachineForcePi : MachineForce {
  static constexpr std::string_view kMeaning =
      "A PI controller of the force whose output is a velocity: v = f / damping + q, q' = f / "
      "(damping integral_time), where f is the set-point less the measured force.";
  static constexpr std::string_view kWhen = "law = \"force_pi\"";
  double damping = 0.0;                 ///< force error per commanded velocity in N s/m, > 0
  std::optional<double> integral_time;  ///< integral time in s, > 0; empty: no integral action

  static constexpr auto rows() {
    using enum Sign;
    using namespace format;
    using D = Dimension;
    return rows_of(demand(),
                   field(&MachineForcePi::damping,
                         needed("damping", D::damping, positive,
                                "Force error for which the proportional part commands 1 m/s.")),
                   field(&MachineForcePi::integral_time,
                         optional("integral_time", D::time, positive, "no integral",
                                  "Time in which the integral grows by the proportional part. At "
                                  "speed_max the integral is held.")),
                   path());
  }
};

/// A model of a controller that belongs to the machine and commands the drive in place of the
/// firmware. Only the law of such a controller is known. In the first tick of each of its cycles,
/// the controller gives the drive a command. The drive holds this command for the cycle. The
/// command is a velocity, or a force for a table of forces. f is the set-point less the measured
/// force, v the command of the controller, and T its cycle:
///   table        v is the value of a table at the time of the tick
///   admittance   mass v' = f - damping v
///   force_pi     v = f / damping + q,    q' = f / (damping integral_time)
/// Each law is exact for a force that is constant in a cycle. |v| is at most speed_max. At this
/// limit, the virtual mass does not accelerate further, and q is held. The measured force is the
/// signal after a first-order low-pass filter and a delay of delay_ticks.
struct MachineController {
  static constexpr std::string_view kMeaning =
      "A controller that belongs to the machine, such as that of a robot or a press: a model of "
      "somebody else's controller, of which no more than this law is known. It commands the drive "
      "in place of the firmware, whose DAC code has no effect; an experiment on the model selects "
      "no mode of operation. Linear analysis leaves it out. MachineController in "
      "sim/model/elements/machine_controller.hpp has the equations.";
  using Type = std::variant<MachineTable, MachineAdmittance, MachineForcePi>;
  Type law;
  double volts_per_command = 0.0;  ///< voltage of the drive for a command of 1 m/s or 1 N
  int cycle_ticks = 1;

  /// Returns the measured force of an admittance or of force_pi, or nullptr for a table.
  const MachineForce *force() const {
    if (const auto *admittance = std::get_if<MachineAdmittance>(&law)) return admittance;
    return std::get_if<MachineForcePi>(&law);
  }

  static constexpr auto rows() {
    using namespace format;
    return rows_of(field(&MachineController::law,
                         choice("law", "table, admittance, force_pi", "", "choose a law",
                                "Law of the controller. It adds the keys below.")),
                   field(&MachineController::cycle_ticks,
                         integer("cycle_ticks", 1, 300, 1.0,
                                 "Cycle of the controller in ticks of 1/1500 s: it gives a new "
                                 "command in the first tick of a cycle.")));
  }
};

}  // namespace forceaxis::sim
