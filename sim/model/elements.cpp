#include "sim/model/elements.hpp"

#include <string>
#include <utility>

#include "sim/model/elements/all.hpp"
#include "sim/model/read.hpp"

namespace forceaxis::sim {
namespace {

// Reads every table [[key]] into a list of the model.
template <class T>
void list(Section &root, Names &names, const char *key, std::vector<T> &elements) {
  root.each(key, [&](Section &section) { elements.push_back(read_table<T>(section, names)); });
}

// Reads the table [key], if the file has it.
template <class T>
void one(Section &root, Names &names, const char *key, Boxed<T> &element) {
  root.one(key, [&](Section &section) { element = read_table<T>(section, names); });
}

void read_bodies(Section &root, Names &names, Model &model) {
  constexpr std::size_t kMostBodies = 32, kMostModes = 32;
  list(root, names, "body", model.bodies);
  if ((model.bodies.empty() && !root.has("structure")) || model.bodies.size() > kMostBodies)
    root.fail("body", "expected 1.." + std::to_string(kMostBodies) + " bodies, got " +
                          std::to_string(model.bodies.size()) + "; add or remove [[body]] tables");
  list(root, names, "structure", model.structures);
  std::size_t modes = 0;
  for (const Structure &structure : model.structures) modes += structure.modes.size();
  if (modes > kMostModes)
    root.fail("structure", "expected at most " + std::to_string(kMostModes) +
                               " modes of all structures together, got " + std::to_string(modes) +
                               "; remove the modes with the highest frequencies");
  names.points = model.point_names();
  names.bodies = model.bodies.size();
}

void read_adc(Section &root, Names &names, Model &model) {
  root.each("adc", [&](Section &section) {
    const auto channel = static_cast<std::size_t>(section.integer("channel"));
    if (model.adc[channel])
      section.fail("channel", "expected a channel not used before, got " + std::to_string(channel) +
                                  " again; there are channels 0 and 1");
    model.adc[channel] = read_table<Adc>(section, names);
  });
}

// Returns the voltage of the drive for a command of 1 m/s, or of 1 N for a `force`. The drive must
// follow such commands.
double volts_per_command(Section &section, const Drive &drive, bool force) {
  if (const auto *first = std::get_if<FirstOrderDrive>(&drive.type); first && !force)
    return 1.0 / first->velocity_per_volt;
  if (const auto *velocity = std::get_if<VelocityDrive>(&drive.type); velocity && !force)
    return 1.0 / velocity->velocity_per_volt;
  if (const auto *stepper = std::get_if<StepperDrive>(&drive.type); stepper && !force)
    return 1.0 / stepper->velocity_per_volt;
  if (const auto *perfect = std::get_if<PerfectDrive>(&drive.type); perfect && force)
    return 1.0 / perfect->force_per_volt;
  if (const auto *torque = std::get_if<TorqueDrive>(&drive.type); torque && force)
    return 1.0 / (torque->current_per_volt * torque->motor.force_per_amp);
  section.fail("law", std::string("expected a drive that follows ") +
                          (force ? "a force (perfect, torque)"
                                 : "a velocity (first_order, velocity, stepper)") +
                          ", got another type; change drive.type");
}

void read_machine_controller(Section &root, Names &names, Model &model) {
  root.one("machine_controller", [&](Section &section) {
    if (!model.drive) section.fail("law", "expected a model with a drive, got none; add [drive]");
    if (model.drive->enable_ticks || !model.drive->bus.immediate())
      section.fail("law",
                   "expected a drive without bus and enable_ticks, which are those of the "
                   "firmware; remove these keys of [drive]");
    auto controller = read_table<MachineController>(section, names);
    const auto *table = std::get_if<MachineTable>(&controller.law);
    controller.volts_per_command =
        volts_per_command(section, *model.drive, table != nullptr && !table->forces.empty());
    model.machine_controller = std::move(controller);
  });
}

}  // namespace

void read_elements(Section &root, Model &model) {
  Names names;
  read_bodies(root, names, model);
  list(root, names, "spring", model.springs);
  list(root, names, "damper", model.dampers);
  list(root, names, "contact", model.contacts);
  list(root, names, "backlash", model.backlashes);
  list(root, names, "stop", model.stops);
  list(root, names, "friction", model.frictions);
  list(root, names, "cogging", model.coggings);
  list(root, names, "brake", model.brakes);
  list(root, names, "gravity", model.gravities);
  list(root, names, "external", model.externals);
  one(root, names, "drive", model.drive);
  one(root, names, "encoder", model.encoder);
  one(root, names, "switches", model.switches);
  if (root.has("switches") && !model.encoder)
    root.fail("switches",
              "expected an encoder, whose position activates the switches, got none; add "
              "[encoder]");
  names.signals = model.signal_list();
  read_adc(root, names, model);
  one(root, names, "dac", model.dac);
  read_machine_controller(root, names, model);
}

}  // namespace forceaxis::sim
