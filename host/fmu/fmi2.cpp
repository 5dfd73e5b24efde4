// The functions of FMI 2.0 for co-simulation.
#include <fmi2Functions.h>

#include <algorithm>
#include <cctype>
#include <exception>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <type_traits>

#include "host/fmu/instance.hpp"

namespace {

using forceaxis::fmu::Instance;
using forceaxis::fmu::Status;
using forceaxis::fmu::Type;

constexpr Instance::Types kReal = of(Type::real);
constexpr Instance::Types kInteger = of(Type::int32) | of(Type::uint32);
constexpr Instance::Types kBoolean = of(Type::boolean);

struct Component {
  std::string name;
  fmi2CallbackFunctions callbacks;
  std::unique_ptr<Instance> instance;
};

Instance &instance_of(fmi2Component component) {
  return *static_cast<Component *>(component)->instance;
}

void log(const Component &to, Status status, const std::string &text) {
  if (to.callbacks.logger == nullptr) return;
  // The text itself is the format string, because some importers show only the format string.
  std::string format;
  for (const char letter : text) format += letter == '%' ? "%%" : std::string(1, letter);
  constexpr const char *kCategories[] = {"logAll", "logStatusWarning", "logStatusDiscard",
                                         "logStatusError"};
  to.callbacks.logger(to.callbacks.componentEnvironment, to.name.c_str(),
                      static_cast<fmi2Status>(status), kCategories[static_cast<int>(status)],
                      format.c_str());
}

fmi2Status answer(Status status) { return static_cast<fmi2Status>(status); }

// Returns the path that a text in UTF-8 is.
std::filesystem::path path_in_utf8(std::string_view text) {
  return std::u8string(text.begin(), text.end());
}

// Converts a URI of a file to a path. A text without scheme is a path already.
std::filesystem::path path_of(std::string_view uri) {
  constexpr std::string_view kScheme = "file:";
  if (!uri.starts_with(kScheme)) return path_in_utf8(uri);
  uri.remove_prefix(kScheme.size());
  if (uri.starts_with("//")) {
    uri.remove_prefix(2);
    uri.remove_prefix(uri.find('/') == std::string_view::npos ? 0 : uri.find('/'));
  }
  std::string path;
  const auto digit = [&](std::size_t i) {
    return i < uri.size() && std::isxdigit(static_cast<unsigned char>(uri[i])) != 0;
  };
  for (std::size_t i = 0; i < uri.size(); ++i) {
    if (uri[i] == '%' && digit(i + 1) && digit(i + 2)) {
      path += static_cast<char>(std::stoi(std::string(uri.substr(i + 1, 2)), nullptr, 16));
      i += 2;
    } else {
      path += uri[i];
    }
  }
  // On Windows, a slash stands before the letter of the drive.
  if (path.size() > 2 && path[0] == '/' && path[2] == ':') path.erase(0, 1);
  return path_in_utf8(path);
}

template <class Value>
fmi2Status get(fmi2Component c, Instance::Types types, const fmi2ValueReference vr[],
               std::size_t count, Value values[]) {
  Status worst = Status::ok;
  for (std::size_t i = 0; i < count; ++i) {
    double value = 0.0;
    worst = std::max(worst, instance_of(c).get(vr[i], types, value));
    if (worst > Status::warning) break;
    // An unsigned integer is passed with the same 32 bits.
    if constexpr (std::is_integral_v<Value>)
      values[i] = static_cast<Value>(static_cast<std::int64_t>(value));
    else
      values[i] = value;
  }
  return answer(worst);
}

template <class Value>
fmi2Status set(fmi2Component c, Instance::Types types, const fmi2ValueReference vr[],
               std::size_t count, const Value values[]) {
  Status worst = Status::ok;
  for (std::size_t i = 0; i < count; ++i) {
    double value = values[i];
    if (instance_of(c).type_of(vr[i]) == Type::uint32)
      value = static_cast<std::uint32_t>(static_cast<std::int64_t>(value));
    worst = std::max(worst, instance_of(c).set(vr[i], types, value));
    if (worst > Status::discard) break;
  }
  return answer(worst);
}

fmi2Status refuse(fmi2Component c, const char *text) { return answer(instance_of(c).refuse(text)); }

}  // namespace

const char *fmi2GetTypesPlatform() { return fmi2TypesPlatform; }
const char *fmi2GetVersion() { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component, fmi2Boolean, size_t, const fmi2String[]) {
  return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token,
                              fmi2String resources, const fmi2CallbackFunctions *callbacks,
                              fmi2Boolean, fmi2Boolean) {
  if (name == nullptr || token == nullptr || callbacks == nullptr) return nullptr;
  auto component = std::make_unique<Component>(Component{name, *callbacks, nullptr});
  Component *const own = component.get();
  try {
    if (type != fmi2CoSimulation) throw std::invalid_argument("expected co-simulation");
    if (resources == nullptr) throw std::invalid_argument("expected the folder of the resources");
    component->instance = std::make_unique<Instance>(
        path_of(resources), token,
        [own](Status status, const std::string &text) { log(*own, status, text); });
  } catch (const std::exception &error) {
    log(*own, Status::error, error.what());
    return nullptr;
  }
  return component.release();
}

void fmi2FreeInstance(fmi2Component c) { delete static_cast<Component *>(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean, fmi2Real, fmi2Real start_s,
                               fmi2Boolean, fmi2Real) {
  return answer(instance_of(c).set_start(start_s));
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  return answer(instance_of(c).enter_initialization());
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  return answer(instance_of(c).exit_initialization());
}
fmi2Status fmi2Terminate(fmi2Component c) { return answer(instance_of(c).terminate()); }
fmi2Status fmi2Reset(fmi2Component c) { return answer(instance_of(c).reset()); }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       fmi2Real values[]) {
  return get(c, kReal, vr, n, values);
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          fmi2Integer values[]) {
  return get(c, kInteger, vr, n, values);
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          fmi2Boolean values[]) {
  return get(c, kBoolean, vr, n, values);
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference[], size_t n, fmi2String[]) {
  return n == 0 ? fmi2OK : refuse(c, "value reference: the unit has no text variables");
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real values[]) {
  return set(c, kReal, vr, n, values);
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          const fmi2Integer values[]) {
  return set(c, kInteger, vr, n, values);
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          const fmi2Boolean values[]) {
  return set(c, kBoolean, vr, n, values);
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference[], size_t n,
                         const fmi2String[]) {
  return n == 0 ? fmi2OK : refuse(c, "value reference: the unit has no text variables");
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
  return answer(instance_of(c).save(*state));
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  return answer(instance_of(c).restore(state));
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
  return answer(instance_of(c).forget(*state));
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate, size_t *) {
  return refuse(c, "state: the unit does not convert a state to bytes");
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate, fmi2Byte[], size_t) {
  return refuse(c, "state: the unit does not convert a state to bytes");
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte[], size_t, fmi2FMUstate *) {
  return refuse(c, "state: the unit does not convert a state to bytes");
}
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference[], size_t,
                                        const fmi2ValueReference[], size_t, const fmi2Real[],
                                        fmi2Real[]) {
  return refuse(c, "derivatives: the unit has none");
}
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference[], size_t,
                                       const fmi2Integer[], const fmi2Real[]) {
  return refuse(c, "derivatives: the unit holds its inputs over a step");
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference[], size_t,
                                        const fmi2Integer[], fmi2Real[]) {
  return refuse(c, "derivatives: the unit has none");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point_s, fmi2Real step_s, fmi2Boolean) {
  return answer(instance_of(c).step(point_s, step_s));
}
fmi2Status fmi2CancelStep(fmi2Component c) {
  return refuse(c, "cancellation: a step has ended when the call of it returns");
}

fmi2Status fmi2GetStatus(fmi2Component, const fmi2StatusKind, fmi2Status *) { return fmi2Discard; }
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
  if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
  *value = instance_of(c).time_s();
  return fmi2OK;
}
fmi2Status fmi2GetIntegerStatus(fmi2Component, const fmi2StatusKind, fmi2Integer *) {
  return fmi2Discard;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component, const fmi2StatusKind kind, fmi2Boolean *value) {
  if (kind != fmi2Terminated) return fmi2Discard;
  *value = fmi2False;
  return fmi2OK;
}
fmi2Status fmi2GetStringStatus(fmi2Component, const fmi2StatusKind, fmi2String *) {
  return fmi2Discard;
}

// Functions of model exchange, which some importers look up in each library.
#define FORCEAXIS_NEVER(NAME, ...)                                          \
  fmi2Status fmi2##NAME(fmi2Component c __VA_OPT__(, ) __VA_ARGS__) {       \
    return refuse(c, "model exchange: the unit is for co-simulation only"); \
  }
FORCEAXIS_NEVER(EnterEventMode)
FORCEAXIS_NEVER(NewDiscreteStates, fmi2EventInfo *)
FORCEAXIS_NEVER(EnterContinuousTimeMode)
FORCEAXIS_NEVER(CompletedIntegratorStep, fmi2Boolean, fmi2Boolean *, fmi2Boolean *)
FORCEAXIS_NEVER(SetTime, fmi2Real)
FORCEAXIS_NEVER(SetContinuousStates, const fmi2Real[], size_t)
FORCEAXIS_NEVER(GetDerivatives, fmi2Real[], size_t)
FORCEAXIS_NEVER(GetEventIndicators, fmi2Real[], size_t)
FORCEAXIS_NEVER(GetContinuousStates, fmi2Real[], size_t)
FORCEAXIS_NEVER(GetNominalsOfContinuousStates, fmi2Real[], size_t)
