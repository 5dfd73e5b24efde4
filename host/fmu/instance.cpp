#include "host/fmu/instance.hpp"

#include <cmath>
#include <utility>

namespace forceaxis::fmu {
namespace {

// Error: the importer calls a function at a time at which FMI does not permit this call, or with a
// wrong argument.
struct WrongCall : std::runtime_error {
  using std::runtime_error::runtime_error;
};

constexpr const char *kTypeNames[] = {"a real number", "an integer", "an unsigned integer",
                                      "a Boolean"};

}  // namespace

Instance::Instance(const std::filesystem::path &resources, const std::string &token, Log log)
    : log_(std::move(log)) {
  OpenedUnit opened = open_unit(resources);
  if (opened.token != token)
    throw sim::InputError("modelDescription.xml", "",
                          "expected the token " + opened.token + " of the resources, got " + token +
                              "; use the files of one FMU");
  unit_ = std::move(opened.unit);
}

Status Instance::report(Status status, const std::string &text) const {
  if (log_) log_(status, sim::one_line(text));
  return status;
}

template <class Action>
Status Instance::guarded(Action action) {
  try {
    action();
  } catch (const ValueRefused &refused) {
    return report(Status::discard, refused.what());
  } catch (const std::exception &error) {
    return report(Status::error, error.what());
  }
  Status status = Status::ok;
  for (const std::string &text : unit_->take_warnings()) status = report(Status::warning, text);
  return status;
}

void Instance::expect(bool permitted, const char *text) const {
  if (!permitted) throw WrongCall(text);
}

Status Instance::set_start(double start_s) {
  return guarded([&] {
    expect(phase_ == Phase::created, "start time: expected a new or reset instance");
    expect(std::isfinite(start_s), "start time: expected a finite number");
    clock_ = TickClock(start_s);
  });
}

Status Instance::enter_initialization() {
  return guarded([&] {
    expect(phase_ == Phase::created, "initialization: expected a new or reset instance");
    phase_ = Phase::initializing;
  });
}

Status Instance::exit_initialization() {
  return guarded([&] {
    expect(phase_ == Phase::initializing, "end of the initialization: expected its begin before");
    unit_->initialise();
    phase_ = Phase::stepping;
  });
}

Status Instance::terminate() {
  return guarded([&] {
    expect(phase_ == Phase::stepping, "termination: expected an instance that is initialized");
    phase_ = Phase::terminated;
  });
}

Status Instance::reset() {
  return guarded([&] {
    unit_->reset();
    clock_ = TickClock();
    phase_ = Phase::created;
    failed_ = false;
  });
}

Status Instance::step(double point_s, double step_s) {
  return guarded([&] {
    expect(phase_ == Phase::stepping, "step: expected an instance that is initialized");
    expect(!failed_, "step: the simulation has failed before; reset the instance");
    TickClock after = clock_;
    after.advance(point_s, step_s);
    failed_ = true;
    try {
      unit_->advance(after.now());
    } catch (const ValueRefused &refused) {
      failed_ = false;
      throw WrongCall(refused.what());
    }
    failed_ = false;
    clock_ = after;
  });
}

const Variable &Instance::variable(std::uint32_t reference, Types types) const {
  const std::vector<Variable> &known = unit_->variables();
  if (reference >= known.size())
    throw WrongCall("value reference " + std::to_string(reference) + ": expected one of 0 to " +
                    std::to_string(known.size() - 1) + "; modelDescription.xml lists them");
  const Variable &found = known[reference];
  if ((types & of(found.type)) == 0)
    throw WrongCall("value reference " + std::to_string(reference) + ": " + found.name + " is " +
                    kTypeNames[static_cast<int>(found.type)] + "; use the function of this type");
  return found;
}

Type Instance::type_of(std::uint32_t reference) const {
  const std::vector<Variable> &known = unit_->variables();
  return reference < known.size() ? known[reference].type : Type::int32;
}

Status Instance::get(std::uint32_t reference, Types types, double &value) {
  return guarded([&] {
    const Role role = variable(reference, types).role;
    value = role == Role::independent ? clock_.time_s() : unit_->get(reference);
  });
}

Status Instance::set(std::uint32_t reference, Types types, double value) {
  return guarded([&] {
    const Variable &known = variable(reference, types);
    if (known.role == Role::output || known.role == Role::independent)
      throw WrongCall(known.name + ": an output cannot be set");
    if (known.role == Role::fixed && phase_ != Phase::created && phase_ != Phase::initializing)
      throw WrongCall(known.name + ": a fixed parameter cannot be set after the initialization");
    if (!std::isfinite(value)) throw ValueRefused(known.name + ": expected a finite number");
    unit_->set(reference, value);
  });
}

Status Instance::save(void *&handle) {
  return guarded([&] {
    auto fresh = std::make_unique<Saved>(Saved{unit_->state(), clock_, phase_, failed_});
    if (handle == nullptr) {
      handle = fresh.get();
      saved_[handle] = std::move(fresh);
    } else {
      *saved_state(handle) = std::move(*fresh);
    }
  });
}

Status Instance::restore(const void *handle) {
  return guarded([&] {
    const Saved &saved = *saved_state(handle);
    unit_->restore(*saved.unit);
    clock_ = saved.clock;
    phase_ = saved.phase;
    failed_ = saved.failed;
  });
}

Status Instance::forget(void *&handle) {
  return guarded([&] {
    if (handle == nullptr) return;
    saved_.erase(saved_state(handle).get());
    handle = nullptr;
  });
}

const std::unique_ptr<Instance::Saved> &Instance::saved_state(const void *handle) const {
  const auto found = saved_.find(handle);
  if (found == saved_.end())
    throw WrongCall("state: expected a state that this instance has saved");
  return found->second;
}

}  // namespace forceaxis::fmu
