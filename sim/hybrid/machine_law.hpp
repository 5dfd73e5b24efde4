#pragma once
// The controller of a machine that commands the drive in place of the firmware. The class models a
// controller of another manufacturer; its equations are at MachineController in
// sim/model/elements/machine_controller.hpp. In the first tick of each of its cycles, the
// controller computes a command from the force of that tick. It holds this command until the next
// cycle. So the voltage is constant within a tick, and the plant is simulated exactly.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "sim/model/elements/machine_controller.hpp"

namespace forceaxis::sim {

class MachineLaw {
 public:
  /// `tick_s` is the duration of one step of the plant in s.
  MachineLaw(MachineController controller, double tick_s)
      : controller_(std::move(controller)),
        tick_s_(tick_s),
        forces_(
            static_cast<std::size_t>(controller_.force() ? controller_.force()->delay_ticks : 0) +
            1) {}

  /// Returns the voltage for the drive in this tick. Must be called once in each tick, with the
  /// present force in N.
  double volts(std::int64_t tick, double force) {
    if (const auto *table = std::get_if<MachineTable>(&controller_.law)) {
      if (tick % controller_.cycle_ticks == 0)
        command_ = value(*table, static_cast<double>(tick) * tick_s_);
      return command_ * controller_.volts_per_command;
    }
    const double measured = late(tick, filtered(tick, force));
    if (tick % controller_.cycle_ticks == 0) follow(controller_.force()->setpoint - measured);
    return command_ * controller_.volts_per_command;
  }

 private:
  static double value(const MachineTable &table, double time) {
    constexpr double kRounding_s = 1e-9;  // largest difference of two times that are treated as
                                          // equal
    const auto next = std::upper_bound(table.times.begin(), table.times.end(), time + kRounding_s);
    if (next == table.times.begin()) return table.values.front();
    const auto i = static_cast<std::size_t>(next - table.times.begin());
    if (i == table.times.size() || !table.interpolated) return table.values[i - 1];
    const double share = (time - table.times[i - 1]) / (table.times[i] - table.times[i - 1]);
    return table.values[i - 1] + share * (table.values[i] - table.values[i - 1]);
  }

  // Applies the low-pass filter to the force. The filter is exact for a force that is constant
  // between ticks.
  double filtered(std::int64_t tick, double force) {
    if (!controller_.force()->filter || tick == 0)
      low_ = force;
    else
      low_ += -std::expm1(-*controller_.force()->filter * tick_s_) * (force - low_);
    return low_;
  }

  double late(std::int64_t tick, double force) {
    if (tick == 0) std::fill(forces_.begin(), forces_.end(), force);
    const auto count = static_cast<std::int64_t>(forces_.size());
    forces_[static_cast<std::size_t>(tick % count)] = force;
    return forces_[static_cast<std::size_t>((tick + 1) % count)];
  }

  void follow(double error) {
    const double cycle_s = tick_s_ * controller_.cycle_ticks;
    const double most = controller_.force()->speed_max;
    if (const auto *admittance = std::get_if<MachineAdmittance>(&controller_.law)) {
      if (admittance->damping > 0.0) {
        const double decay = -std::expm1(-admittance->damping / admittance->mass * cycle_s);
        command_ += decay * (error / admittance->damping - command_);
      } else {
        command_ += error / admittance->mass * cycle_s;
      }
      command_ = std::clamp(command_, -most, most);
      return;
    }
    const auto &pi = std::get<MachineForcePi>(controller_.law);
    const double part = error / pi.damping;
    const double grown = pi.integral_time ? integral_ + part * cycle_s / *pi.integral_time : 0.0;
    command_ = std::clamp(part + grown, -most, most);
    // At the limit of the command, the integral changes only if this leads away from the limit.
    if (command_ == part + grown || (part + grown) * (grown - integral_) < 0.0) integral_ = grown;
  }

  MachineController controller_;
  double tick_s_;
  double command_ = 0.0;
  double integral_ = 0.0;
  double low_ = 0.0;
  std::vector<double> forces_;  // forces that were measured in the last ticks
};

}  // namespace forceaxis::sim
