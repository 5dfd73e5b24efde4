// The functions of FMI 3.0 for co-simulation without events. Two kinds of functions refuse every
// call: functions for other kinds of simulation, and functions for types that no variable has.
#include <fmi3Functions.h>

#include <algorithm>
#include <exception>
#include <memory>
#include <string>
#include <string_view>

#include "host/fmu/instance.hpp"

namespace {

using forceaxis::fmu::Instance;
using forceaxis::fmu::Status;
using forceaxis::fmu::Type;

Instance &of_handle(fmi3Instance instance) { return *static_cast<Instance *>(instance); }
fmi3Status answer(Status status) { return static_cast<fmi3Status>(status); }
fmi3Status refuse(fmi3Instance instance, const char *text) {
  return answer(of_handle(instance).refuse(text));
}

bool have_equal_lengths(fmi3Instance instance, std::size_t references, std::size_t values) {
  if (references == values) return true;
  refuse(instance, "values: expected one value for each value reference");
  return false;
}

template <class Value>
fmi3Status get(fmi3Instance instance, Type type, const fmi3ValueReference vr[], std::size_t count,
               Value values[], std::size_t value_count) {
  if (!have_equal_lengths(instance, count, value_count)) return fmi3Error;
  Status worst = Status::ok;
  for (std::size_t i = 0; i < count && worst <= Status::warning; ++i) {
    double value = 0.0;
    worst = std::max(worst, of_handle(instance).get(vr[i], of(type), value));
    if (worst <= Status::warning) values[i] = static_cast<Value>(value);
  }
  return answer(worst);
}

template <class Value>
fmi3Status set(fmi3Instance instance, Type type, const fmi3ValueReference vr[], std::size_t count,
               const Value values[], std::size_t value_count) {
  if (!have_equal_lengths(instance, count, value_count)) return fmi3Error;
  Status worst = Status::ok;
  for (std::size_t i = 0; i < count && worst <= Status::discard; ++i)
    worst =
        std::max(worst, of_handle(instance).set(vr[i], of(type), static_cast<double>(values[i])));
  return answer(worst);
}

constexpr const char *kNoEvents = "events: the unit has no events, clocks or partitions";
constexpr const char *kNoDerivatives = "derivatives: the unit has none";
constexpr const char *kNoBytes = "state: the unit does not convert a state to bytes";
constexpr const char *kNoDependencies = "dependencies: modelDescription.xml has them";
constexpr const char *kNoConfiguration = "configuration: the unit has no structural parameters";

fmi3Status no_variable(fmi3Instance instance, std::size_t count) {
  return count == 0 ? fmi3OK : refuse(instance, "value reference: no variable has this type");
}

}  // namespace

const char *fmi3GetVersion() { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance, fmi3Boolean, size_t, const fmi3String[]) {
  return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean, fmi3Boolean, fmi3Boolean, fmi3Boolean,
                                         const fmi3ValueReference[], size_t,
                                         fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback) {
  if (name == nullptr || token == nullptr) return nullptr;
  const auto log = [environment, logger](Status status, const std::string &text) {
    constexpr const char *kCategories[] = {"logAll", "logStatusWarning", "logStatusDiscard",
                                           "logStatusError"};
    if (logger != nullptr)
      logger(environment, answer(status), kCategories[static_cast<int>(status)], text.c_str());
  };
  try {
    if (resources == nullptr) throw std::invalid_argument("expected the folder of the resources");
    const std::string_view text(resources);  // in UTF-8
    return new Instance(std::u8string(text.begin(), text.end()), token, log);
  } catch (const std::exception &error) {
    log(Status::error, error.what());
    return nullptr;
  }
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String, fmi3String, fmi3String, fmi3Boolean,
                                          fmi3Boolean, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback logger) {
  if (logger != nullptr) logger(environment, fmi3Error, "logStatusError", "expected co-simulation");
  return nullptr;
}
fmi3Instance fmi3InstantiateScheduledExecution(fmi3String, fmi3String, fmi3String, fmi3Boolean,
                                               fmi3Boolean, fmi3InstanceEnvironment environment,
                                               fmi3LogMessageCallback logger,
                                               fmi3ClockUpdateCallback, fmi3LockPreemptionCallback,
                                               fmi3UnlockPreemptionCallback) {
  return fmi3InstantiateModelExchange(nullptr, nullptr, nullptr, false, false, environment, logger);
}

void fmi3FreeInstance(fmi3Instance instance) { delete static_cast<Instance *>(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean, fmi3Float64,
                                       fmi3Float64 start_s, fmi3Boolean, fmi3Float64) {
  const Status status = of_handle(instance).set_start(start_s);
  return answer(status == Status::ok ? of_handle(instance).enter_initialization() : status);
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
  return answer(of_handle(instance).exit_initialization());
}
fmi3Status fmi3Terminate(fmi3Instance instance) { return answer(of_handle(instance).terminate()); }
fmi3Status fmi3Reset(fmi3Instance instance) { return answer(of_handle(instance).reset()); }

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 point_s, fmi3Float64 step_s, fmi3Boolean,
                      fmi3Boolean *event_needed, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *last_s) {
  const Status status = of_handle(instance).step(point_s, step_s);
  *event_needed = *terminate = *early = false;
  *last_s = of_handle(instance).time_s();
  return answer(status);
}

// Functions that get and set values of the types that the variables have.
#define FORCEAXIS_VALUES(NAME, TYPE)                                                       \
  fmi3Status fmi3Get##NAME(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, \
                           fmi3##NAME values[], size_t n_values) {                         \
    return get(instance, TYPE, vr, n, values, n_values);                                   \
  }                                                                                        \
  fmi3Status fmi3Set##NAME(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, \
                           const fmi3##NAME values[], size_t n_values) {                   \
    return set(instance, TYPE, vr, n, values, n_values);                                   \
  }
FORCEAXIS_VALUES(Float64, Type::real)
FORCEAXIS_VALUES(Int32, Type::int32)
FORCEAXIS_VALUES(UInt32, Type::uint32)
FORCEAXIS_VALUES(Boolean, Type::boolean)

#define FORCEAXIS_NO_VALUES(NAME)                                                       \
  fmi3Status fmi3Get##NAME(fmi3Instance instance, const fmi3ValueReference[], size_t n, \
                           fmi3##NAME[], size_t) {                                      \
    return no_variable(instance, n);                                                    \
  }                                                                                     \
  fmi3Status fmi3Set##NAME(fmi3Instance instance, const fmi3ValueReference[], size_t n, \
                           const fmi3##NAME[], size_t) {                                \
    return no_variable(instance, n);                                                    \
  }
FORCEAXIS_NO_VALUES(Float32)
FORCEAXIS_NO_VALUES(Int8)
FORCEAXIS_NO_VALUES(UInt8)
FORCEAXIS_NO_VALUES(Int16)
FORCEAXIS_NO_VALUES(UInt16)
FORCEAXIS_NO_VALUES(Int64)
FORCEAXIS_NO_VALUES(UInt64)
FORCEAXIS_NO_VALUES(String)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference[], size_t n, size_t[],
                         fmi3Binary[], size_t) {
  return no_variable(instance, n);
}
fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference[], size_t n,
                         const size_t[], const fmi3Binary[], size_t) {
  return no_variable(instance, n);
}
fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference[], size_t n, fmi3Clock[]) {
  return no_variable(instance, n);
}
fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference[], size_t n,
                        const fmi3Clock[]) {
  return no_variable(instance, n);
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) {
  return answer(of_handle(instance).save(*state));
}
fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
  return answer(of_handle(instance).restore(state));
}
fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state) {
  return answer(of_handle(instance).forget(*state));
}

// Functions that FMI 3.0 requires and that have no meaning for this unit.
#define FORCEAXIS_NEVER(NAME, TEXT, ...)                                    \
  fmi3Status fmi3##NAME(fmi3Instance instance __VA_OPT__(, ) __VA_ARGS__) { \
    return refuse(instance, TEXT);                                          \
  }
FORCEAXIS_NEVER(SerializedFMUStateSize, kNoBytes, fmi3FMUState, size_t *)
FORCEAXIS_NEVER(SerializeFMUState, kNoBytes, fmi3FMUState, fmi3Byte[], size_t)
FORCEAXIS_NEVER(DeserializeFMUState, kNoBytes, const fmi3Byte[], size_t, fmi3FMUState *)
FORCEAXIS_NEVER(GetDirectionalDerivative, kNoDerivatives, const fmi3ValueReference[], size_t,
                const fmi3ValueReference[], size_t, const fmi3Float64[], size_t, fmi3Float64[],
                size_t)
FORCEAXIS_NEVER(GetAdjointDerivative, kNoDerivatives, const fmi3ValueReference[], size_t,
                const fmi3ValueReference[], size_t, const fmi3Float64[], size_t, fmi3Float64[],
                size_t)
FORCEAXIS_NEVER(GetOutputDerivatives, kNoDerivatives, const fmi3ValueReference[], size_t,
                const fmi3Int32[], fmi3Float64[], size_t)
FORCEAXIS_NEVER(GetContinuousStateDerivatives, kNoDerivatives, fmi3Float64[], size_t)
FORCEAXIS_NEVER(GetNumberOfVariableDependencies, kNoDependencies, fmi3ValueReference, size_t *)
FORCEAXIS_NEVER(GetVariableDependencies, kNoDependencies, fmi3ValueReference, size_t[],
                fmi3ValueReference[], size_t[], fmi3DependencyKind[], size_t)
FORCEAXIS_NEVER(EnterConfigurationMode, kNoConfiguration)
FORCEAXIS_NEVER(ExitConfigurationMode, kNoConfiguration)
FORCEAXIS_NEVER(EnterEventMode, kNoEvents)
FORCEAXIS_NEVER(EnterStepMode, kNoEvents)
FORCEAXIS_NEVER(EvaluateDiscreteStates, kNoEvents)
FORCEAXIS_NEVER(UpdateDiscreteStates, kNoEvents, fmi3Boolean *, fmi3Boolean *, fmi3Boolean *,
                fmi3Boolean *, fmi3Boolean *, fmi3Float64 *)
FORCEAXIS_NEVER(ActivateModelPartition, kNoEvents, fmi3ValueReference, fmi3Float64)
FORCEAXIS_NEVER(GetIntervalDecimal, kNoEvents, const fmi3ValueReference[], size_t, fmi3Float64[],
                fmi3IntervalQualifier[])
FORCEAXIS_NEVER(GetIntervalFraction, kNoEvents, const fmi3ValueReference[], size_t, fmi3UInt64[],
                fmi3UInt64[], fmi3IntervalQualifier[])
FORCEAXIS_NEVER(GetShiftDecimal, kNoEvents, const fmi3ValueReference[], size_t, fmi3Float64[])
FORCEAXIS_NEVER(GetShiftFraction, kNoEvents, const fmi3ValueReference[], size_t, fmi3UInt64[],
                fmi3UInt64[])
FORCEAXIS_NEVER(SetIntervalDecimal, kNoEvents, const fmi3ValueReference[], size_t,
                const fmi3Float64[])
FORCEAXIS_NEVER(SetIntervalFraction, kNoEvents, const fmi3ValueReference[], size_t,
                const fmi3UInt64[], const fmi3UInt64[])
FORCEAXIS_NEVER(SetShiftDecimal, kNoEvents, const fmi3ValueReference[], size_t, const fmi3Float64[])
FORCEAXIS_NEVER(SetShiftFraction, kNoEvents, const fmi3ValueReference[], size_t, const fmi3UInt64[],
                const fmi3UInt64[])
FORCEAXIS_NEVER(EnterContinuousTimeMode, kNoEvents)
FORCEAXIS_NEVER(CompletedIntegratorStep, kNoEvents, fmi3Boolean, fmi3Boolean *, fmi3Boolean *)
FORCEAXIS_NEVER(SetTime, kNoEvents, fmi3Float64)
FORCEAXIS_NEVER(SetContinuousStates, kNoEvents, const fmi3Float64[], size_t)
FORCEAXIS_NEVER(GetEventIndicators, kNoEvents, fmi3Float64[], size_t)
FORCEAXIS_NEVER(GetContinuousStates, kNoEvents, fmi3Float64[], size_t)
FORCEAXIS_NEVER(GetNominalsOfContinuousStates, kNoEvents, fmi3Float64[], size_t)
FORCEAXIS_NEVER(GetNumberOfEventIndicators, kNoEvents, size_t *)
FORCEAXIS_NEVER(GetNumberOfContinuousStates, kNoEvents, size_t *)
