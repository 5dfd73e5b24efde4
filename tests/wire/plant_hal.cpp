// The plant of an experiment as a component of LinuxCNC's HAL, for test_linuxcnc.py. In one thread:
// plant.sense, forceaxis.update, plant.act. Every object that the experiment writes is a pin
// plant.NAME. At load it writes the stored parameters of the experiment as a parameter file.
#include <hal.h>
#include <rtapi.h>
#include <rtapi_app.h>

#include <fstream>
#include <map>
#include <memory>
#include <string>

#include "host/run/objects.hpp"
#include "host/run/plant_side.hpp"

static char *experiment;
static char *parameters;
static char *result;
RTAPI_MP_STRING(experiment, "file of the experiment")
RTAPI_MP_STRING(parameters, "parameter file that is written")
RTAPI_MP_STRING(result, "file of the trace hash, written at the end of the run")

namespace {

using namespace forceaxis::host;

struct Pins {
  hal_s32_t *encoder_count;
  hal_u32_t *force_code;
  hal_u32_t *current_code;
  hal_bit_t *enable, *limit_pos, *limit_neg, *index, *home;
  hal_s32_t *code;
  hal_bit_t *amp_enable, *brake_release;
  hal_u32_t *fault_code, *limit_reason;
  hal_bit_t *done;
};

struct Bench {
  explicit Bench(const char *file)
      : loaded(load_experiment(file)), plant(loaded, {.trace = false, .audit = false}) {}
  Experiment loaded;
  PlantSide plant;
  std::map<std::uint16_t, hal_s32_t **> objects;
  std::size_t action = 0;
};

int component;
Pins *pins;
std::unique_ptr<Bench> bench;

void show(const std::vector<ObjectWrite> &writes) {
  for (const ObjectWrite &w : writes) {
    const auto found = bench->objects.find(w.object);
    if (found != bench->objects.end()) **found->second = w.raw;
  }
}

void sense(void *, long) {
  PlantSide &plant = bench->plant;
  if (!plant.running()) return;
  if (plant.tick() == 0) show(bench->loaded.initial);
  const auto &actions = bench->loaded.actions;
  for (; bench->action < actions.size() && actions[bench->action].tick <= plant.tick();
       ++bench->action)
    show(actions[bench->action].writes);
  const LinkInputs &in = plant.sense();
  *pins->encoder_count = in.encoder_cnt;
  *pins->force_code = in.adc0_code;
  *pins->current_code = in.adc1_code;
  hal_bit_t *const inputs[] = {pins->enable, pins->limit_pos, pins->limit_neg, pins->index,
                               pins->home};
  for (int i = 0; i < 5; ++i) *inputs[i] = (in.din >> i & 1) != 0;
}

void act(void *, long) {
  PlantSide &plant = bench->plant;
  if (!plant.running()) return;
  plant.act(
      {plant.tick(), static_cast<std::int16_t>(*pins->code),
       static_cast<std::uint8_t>((*pins->amp_enable ? 1 : 0) | (*pins->brake_release ? 2 : 0)),
       static_cast<std::uint8_t>(*pins->fault_code), static_cast<std::uint8_t>(*pins->limit_reason),
       1});
  if (plant.running()) return;
  std::ofstream(result) << plant.finish().trace_hash;
  *pins->done = true;
}

bool stored(const ObjectWrite &w) { return object_meta(w.object).stored != 0; }

// Values with all their digits; those of a text or an array keep the form of the parameter file.
void write_parameters() {
  std::ofstream file(parameters);
  file.precision(17);
  file << "[axis]\n";
  for (const ObjectWrite &w : bench->loaded.initial) {
    const axis_object_meta_t &meta = object_meta(w.object);
    if (!stored(w)) continue;
    const double raw = meta.min < 0 ? 1.0 * w.raw : 1.0 * static_cast<std::uint32_t>(w.raw);
    file << meta.name << " = ";
    if (enum_texts(w.object).empty())
      file << raw * meta.scale << '\n';
    else
      file << '"' << enum_text(w.object, w.raw) << "\"\n";
  }
}

void make(const char *name, hal_pin_dir_t direction, hal_s32_t *&pin) {
  if (hal_pin_s32_new(name, direction, &pin, component) != 0) throw std::runtime_error(name);
}
void make(const char *name, hal_pin_dir_t direction, hal_u32_t *&pin) {
  if (hal_pin_u32_new(name, direction, &pin, component) != 0) throw std::runtime_error(name);
}
void make(const char *name, hal_pin_dir_t direction, hal_bit_t *&pin) {
  if (hal_pin_bit_new(name, direction, &pin, component) != 0) throw std::runtime_error(name);
}

void make_object(const ObjectWrite &w) {
  if (bench->objects.contains(w.object)) return;
  const axis_object_meta_t &meta = object_meta(w.object);
  std::string name = std::string("plant.") + meta.name;
  for (char &c : name)
    if (c == '_') c = '-';
  auto **pin = static_cast<hal_s32_t **>(hal_malloc(sizeof(hal_s32_t *)));
  make(name.c_str(), HAL_OUT, *pin);
  **pin = static_cast<std::int32_t>(meta.initial);
  bench->objects[w.object] = pin;
}

void make_pins() {
  pins = static_cast<Pins *>(hal_malloc(sizeof(Pins)));
  make("plant.encoder-count", HAL_OUT, pins->encoder_count);
  make("plant.force-code", HAL_OUT, pins->force_code);
  make("plant.current-code", HAL_OUT, pins->current_code);
  make("plant.enable", HAL_OUT, pins->enable);
  make("plant.limit-pos", HAL_OUT, pins->limit_pos);
  make("plant.limit-neg", HAL_OUT, pins->limit_neg);
  make("plant.index", HAL_OUT, pins->index);
  make("plant.home", HAL_OUT, pins->home);
  make("plant.code", HAL_IN, pins->code);
  make("plant.amp-enable", HAL_IN, pins->amp_enable);
  make("plant.brake-release", HAL_IN, pins->brake_release);
  make("plant.fault-code", HAL_IN, pins->fault_code);
  make("plant.limit-reason", HAL_IN, pins->limit_reason);
  make("plant.done", HAL_OUT, pins->done);
}

void load() {
  bench = std::make_unique<Bench>(experiment);
  make_pins();
  for (const Action &action : bench->loaded.actions)
    for (const ObjectWrite &w : action.writes) make_object(w);
  for (const ObjectWrite &w : bench->loaded.initial)
    if (!stored(w)) make_object(w);
  for (const ObjectWrite &w : bench->loaded.initial)
    if (stored(w)) show({w});
  write_parameters();
  hal_export_funct("plant.sense", sense, nullptr, 1, 0, component);
  hal_export_funct("plant.act", act, nullptr, 1, 0, component);
}

}  // namespace

extern "C" int rtapi_app_main() {
  component = hal_init("plant");
  try {
    load();
  } catch (const std::exception &error) {
    rtapi_print_msg(RTAPI_MSG_ERR, "plant: %s\n", error.what());
    hal_exit(component);
    return -1;
  }
  return hal_ready(component);
}

extern "C" void rtapi_app_exit() { hal_exit(component); }
