#pragma once
// An instance of a co-simulation unit for both versions of FMI. It has the states of the life
// cycle, checks value references, and reports each error as one line to the logger of the importer.
// An importer may use two instances at the same time, but not one instance in two threads.
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "host/fmu/tick_clock.hpp"
#include "host/fmu/unit.hpp"

namespace forceaxis::fmu {

// Status of a call, with the same numbers as in fmi2Status and fmi3Status.
enum class Status { ok, warning, discard, error };

class Instance {
 public:
  // Function that receives one line for each status that is not ok.
  using Log = std::function<void(Status, const std::string &)>;
  // Opens the unit in the folder `resources`. Throws sim::InputError, also if `token` differs from
  // the token of the unit.
  Instance(const std::filesystem::path &resources, const std::string &token, Log log);

  // Sets the time in s of tick 0, before the initialization.
  Status set_start(double start_s);
  Status enter_initialization();
  Status exit_initialization();
  Status terminate();
  Status reset();
  // Computes a communication step of any length.
  Status step(double point_s, double step_s);
  double time_s() const { return clock_.time_s(); }

  // Read or write one variable, whose type must be in the set of types.
  using Types = unsigned;  // set of types of variables; the type with the number n is bit n
  Status get(std::uint32_t reference, Types types, double &value);
  Status set(std::uint32_t reference, Types types, double value);
  // Returns the type of a variable; int32 if there is no such variable.
  Type type_of(std::uint32_t reference) const;

  // Handles of saved states, which belong to this instance. save() creates a state if the handle is
  // NULL and overwrites it otherwise. forget() destroys a state and makes the handle NULL.
  Status save(void *&handle);
  Status restore(const void *handle);
  Status forget(void *&handle);

  Status refuse(const std::string &text) { return report(Status::error, text); }

 private:
  enum class Phase { created, initializing, stepping, terminated };
  struct Saved {
    std::unique_ptr<Unit::State> unit;
    TickClock clock;
    Phase phase = Phase::created;
    bool failed = false;
  };

  Status report(Status status, const std::string &text) const;
  template <class Action>
  Status guarded(Action action);
  void expect(bool permitted, const char *text) const;
  const Variable &variable(std::uint32_t reference, Types types) const;
  const std::unique_ptr<Saved> &saved_state(const void *handle) const;

  Log log_;
  std::unique_ptr<Unit> unit_;
  TickClock clock_;
  Phase phase_ = Phase::created;
  bool failed_ = false;  // true from a failure of the simulation on until reset() is called
  std::map<const void *, std::unique_ptr<Saved>> saved_;  // saved states by their handles
};

inline constexpr Instance::Types of(Type type) { return 1U << static_cast<unsigned>(type); }

}  // namespace forceaxis::fmu
