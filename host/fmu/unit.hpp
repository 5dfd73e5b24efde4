#pragma once
// A co-simulation unit: the plant or the firmware of an axis, which is accessed through a list of
// variables. The two versions of FMI (fmi2.cpp, fmi3.cpp) and the writer of modelDescription.xml
// read this list, so a value reference is always the index of its variable.
//
// In one tick of the loop, the firmware unit makes a step, its new outputs are set as inputs of the
// plant unit, and the plant unit makes a step. With this order, the codes are equal to the codes in
// a run of forceaxis. A step can also be a part of a tick or several ticks. The firmware computes
// each tick at which the step begins or that lies within the step, and holds its outputs until the
// next tick. The signals of the plant are those of any instant, and its codes those of the last
// tick. A unit has no data in common with another unit.
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace forceaxis::fmu {

enum class Type { real, int32, uint32, boolean };
// An input may change at each communication point. A fixed parameter is set before the end of the
// initialization, a tunable parameter at any communication point. The independent variable is the
// time, the last variable of each unit.
enum class Role { input, output, fixed, tunable, independent };

struct Variable {
  std::string name;
  Type type = Type::real;
  Role role = Role::output;
  std::string unit;     // unit as spelled in sim/model/units.hpp or in the object table; "" without
                        // a unit
  std::string meaning;  // description of the variable in one sentence
  double start = 0.0;   // value that an input or a parameter has after the creation of the unit
};

// Error: the unit refuses a value. The variable keeps its previous value, and the simulation can
// continue. what() is one line.
struct ValueRefused : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class Unit {
 public:
  // A copy of the state of one unit. Only this unit can restore the copy.
  struct State {
    virtual ~State() = default;
  };

  virtual ~Unit() = default;

  const std::vector<Variable> &variables() const { return variables_; }
  // `variable` is an index in variables(), but not the index of the time. A Boolean is 0 or 1.
  // get() may throw sim::InputError if a parameter of a model has a value that the model does not
  // permit. set() throws ValueRefused.
  virtual double get(std::size_t variable) = 0;
  virtual void set(std::size_t variable, double value) = 0;

  // Ends the initialization. After this call, the fixed parameters cannot be changed. Throws
  // sim::InputError.
  virtual void initialise() = 0;
  // Simulates with the present inputs until the time `end` in ticks, which is not before the end of
  // the last call. Throws ValueRefused if an input is outside its range; in this case, nothing has
  // changed. Throws sim::SimulationError if the simulation fails; after this, only reset() may be
  // called.
  virtual void advance(double end) = 0;
  // Returns to the state after the creation.
  virtual void reset() = 0;

  virtual std::unique_ptr<State> state() = 0;
  virtual void restore(const State &state) = 0;

  // Returns the warnings since the last call. A warning is one line about an event that does not
  // end the simulation.
  std::vector<std::string> take_warnings() { return std::exchange(warnings_, {}); }

 protected:
  void list_time() {
    variables_.push_back({"time", Type::real, Role::independent, "s", "simulated time"});
  }

  std::vector<Variable> variables_;
  std::vector<std::string> warnings_;
};

// A unit, and the token that its modelDescription.xml must have.
struct OpenedUnit {
  std::unique_ptr<Unit> unit;
  std::string token;
};

// Creates the unit that the file forceaxis.unit in the folder `resources` describes:
//   kind = "plant" or "firmware", token
//   plant:    model (file name), seed, set (table of parameters with their values)
//   firmware: dac_bits, initial (array of [object, raw value]), at (array of [tick, object, raw
//             value]), program (array of words of firmware/cycle/program.h, empty without program),
//             inputs (array of names of objects)
// Throws sim::InputError.
OpenedUnit open_unit(const std::filesystem::path &resources);

}  // namespace forceaxis::fmu
