// MuJoCo on the benchmark, through its C API: bodies on slide joints, RK4, what its own elements
// cannot say (piecewise-linear motor, contact that is a spring and damper) in its callbacks. Motor
// current and filtered tachometer are activations, so RK4 integrates them with the rest. Nothing
// that costs time and is not needed is on.
#include <mujoco/mujoco.h>

#include <memory>
#include <stdexcept>
#include <string>

#include "tests/bench/peers.hpp"
#include "tests/bench/plants.hpp"

namespace forceaxis::bench {
namespace {

const char *const kOptions =
    "<option integrator='RK4' timestep='1'>"
    "<flag constraint='disable' contact='disable' gravity='disable' clampctrl='disable' "
    "warmstart='disable' sensor='disable' island='disable' energy='disable'/></option>";

std::string body(const char *name, double mass, double stiffness, double damping) {
  return std::string("<body name='") + name + "'><inertial pos='0 0 0' mass='" +
         std::to_string(mass) + "' diaginertia='1 1 1'/><joint name='" + name +
         "' type='slide' axis='1 0 0' stiffness='" + std::to_string(stiffness) + "' damping='" +
         std::to_string(damping) + "'/></body>";
}

std::string xml(bool full) {
  std::string text = std::string("<mujoco>") + kOptions + "<worldbody>";
  if (full) {
    text += body("rotor", 79.5, 0, 0) + body("arm", 35, 0, 0) + body("tip", 17.9, 0, 0) +
            body("sensor", 0.14, 0, 0) + body("workpiece", 6.6, 0, 0) +
            body("base", 500, 3600000, 9500);
  } else {
    text += body("robot", 132.4, 0, 500) + body("workpiece", 6.6, 412700, 8.25);
  }
  const std::string joint = full ? "rotor" : "robot";
  const std::string motor =
      "' dyntype='user' actdim='1' gaintype='fixed' biastype='none' gainprm='0'/>";
  return text + "</worldbody><actuator><general name='current' joint='" + joint + motor +
         "<general name='tachometer' joint='" + joint + motor + "</actuator></mujoco>";
}

// One model at a time: MuJoCo's callbacks are global.
AxisContact<double> axis;
FullAxis<double> full_axis;

// d->act: current, filtered tachometer; thrust goes in here, so that the base feels the reaction.
void axis_forces(const mjModel *, mjData *d) {
  const double f = axis.touch.free_force(d->qpos[0] - d->qpos[1], d->qvel[0] - d->qvel[1]);
  d->qfrc_passive[0] += axis.motor.k_force * d->act[0] - f;
  d->qfrc_passive[1] += f;
}
mjtNum axis_motor(const mjModel *, const mjData *d, int id) {
  return id == 0 ? axis.motor.free_current_rate(d->ctrl[0], d->act[0], d->act[1], d->qvel[0])
                 : axis.motor.filter_rate(d->act[1], d->qvel[0]);
}

void full_forces(const mjModel *, mjData *d) {
  const double *p = d->qpos;
  const double *v = d->qvel;
  const auto link = [&](int a, int b, double k, double c) {
    return k * (p[a] - p[b]) + c * (v[a] - v[b]);
  };
  const double thrust = full_axis.motor.k_force * d->act[0];
  const double screw = link(0, 1, 10000000, 1500);
  const double arm = link(1, 2, 665000, 640);
  const double cell = link(2, 3, 110100, 16.5);
  const double pad = full_axis.touch.free_force(p[3] - p[4], v[3] - v[4]);
  const double fixture = link(4, 5, 412700, 8.25);
  const double slide = 500 * (v[1] - v[5]);
  d->qfrc_passive[0] += thrust - screw;
  d->qfrc_passive[1] += screw - arm - slide;
  d->qfrc_passive[2] += arm - cell;
  d->qfrc_passive[3] += cell - pad;
  d->qfrc_passive[4] += pad - fixture;
  d->qfrc_passive[5] += fixture + slide - thrust;
}
mjtNum full_motor(const mjModel *, const mjData *d, int id) {
  const double speed = d->qvel[0] - d->qvel[5];
  return id == 0 ? full_axis.motor.free_current_rate(d->ctrl[0], d->act[0], d->act[1], speed)
                 : full_axis.motor.filter_rate(d->act[1], speed);
}

struct Simulation {
  mjModel *model = nullptr;
  mjData *data = nullptr;
  explicit Simulation(bool full) {
    char error[500] = "";
    mjSpec *spec = mj_parseXMLString(xml(full).c_str(), nullptr, error, sizeof error);
    if (spec != nullptr) model = mj_compile(spec, nullptr);
    if (model == nullptr)
      throw std::runtime_error(std::string("MuJoCo refuses the model: ") +
                               (spec == nullptr ? error : mjs_getError(spec)));
    mj_deleteSpec(spec);
    data = mj_makeData(model);
  }
};

long run(Simulation &simulation, bool full, int gain, int setpoint_N, int ticks,
         const Record &record) {
  const mjModel *m = simulation.model;
  mjData *d = simulation.data;
  mjcb_passive = full ? full_forces : axis_forces;
  mjcb_act_dyn = full ? full_motor : axis_motor;
  simulation.model->opt.timestep = 1 / kRate;
  mj_resetData(m, d);
  const int behind = full ? 4 : 1;  // bodies on the robot's side
  for (int i = 0; i < behind; ++i) d->qpos[i] = -0.005;
  const int tip = behind - 1;
  for (int k = 0;; ++k) {
    const double overlap = d->qpos[tip] - d->qpos[tip + 1];
    const double speed = d->qvel[tip] - d->qvel[tip + 1];
    const double f =
        full ? full_axis.touch.free_force(overlap, speed) : axis.touch.free_force(overlap, speed);
    const int n = convert(full ? 110100 * (d->qpos[2] - d->qpos[3]) : f);
    const auto at = static_cast<std::size_t>(k);
    record.force_N[at] = f;
    record.robot_m[at] = d->qpos[0];
    record.workpiece_m[at] = d->qpos[tip + 1];
    record.current_A[at] = d->act[0];
    record.count[at] = n;
    if (k == ticks) return -1;
    d->ctrl[0] = volts<double>(law(n, gain, setpoint_N));
    mj_step(m, d);
  }
}

}  // namespace

long run_mujoco(bool full, int gain, int setpoint_N, int ticks, const Record &record) {
  static Simulation simulations[] = {Simulation(false), Simulation(true)};
  return run(simulations[full ? 1 : 0], full, gain, setpoint_N, ticks, record);
}

}  // namespace forceaxis::bench
