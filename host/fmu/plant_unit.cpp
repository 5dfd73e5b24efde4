#include "host/fmu/plant_unit.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "host/fmu/codes.hpp"
#include "sim/hybrid/plant.hpp"
#include "sim/model/elements/all.hpp"
#include "sim/model/text.hpp"

namespace forceaxis::fmu {
namespace {

using sim::Plant;
using sim::SensorCodes;

double code_value(const SensorCodes &codes, std::size_t code) {
  constexpr sim::SwitchBit kSwitches[] = {sim::kLimitPos, sim::kLimitNeg, sim::kIndex, sim::kHome};
  switch (code) {
    case kEncoder:
      return codes.encoder;
    case kPositionAge:
      return codes.encoder_age;
    case kAdc0:
      return codes.adc[0];
    case kAdc1:
      return codes.adc[1];
    case kForceAge:
      return codes.force_age;
    case kDriveReport:
      return codes.drive;
    default:
      return (codes.switches & kSwitches[code - kLimitPos]) != 0;
  }
}

bool are_same(const Plant::Inputs &a, const Plant::Inputs &b) {
  return a.dac_code == b.dac_code && a.amp_enable == b.amp_enable &&
         a.brake_release == b.brake_release;
}

constexpr std::size_t kInputs = 3;  // number of inputs: dac_code, amp_enable, brake_release

class PlantUnit final : public Unit {
 public:
  PlantUnit(const std::filesystem::path &path, std::span<const sim::Override> set,
            std::int32_t seed)
      : file_(path), set_(set.begin(), set.end()) {
    const sim::Model model = file_.model(set_);
    list_inputs(model);
    for (const Code &code : kCodes)
      variables_.push_back({code.name, code.type, Role::output, code.unit, code.meaning});
    first_signal_ = variables_.size();
    for (const sim::SignalInfo &signal : model.signal_list())
      variables_.push_back({signal.name, Type::real, Role::output,
                            std::string(sim::unit_of(signal.dimension)),
                            "true signal of the model"});
    seed_ = variables_.size();
    variables_.push_back({"seed", Type::int32, Role::fixed, "", "seed of the noise, not negative",
                          static_cast<double>(seed)});
    list_parameters(model);
    list_time();
    reset();
  }

  double get(std::size_t variable) override {
    if (variable < first_code_ || variable >= seed_) return values_[variable];
    build();
    if (variable >= first_signal_) {
      const std::size_t signal = variable - first_signal_;
      return within_.empty() ? plant_->signal_at(signal) : within_[signal];
    }
    return code_value(codes_, variable - first_code_);
  }

  void set(std::size_t variable, double value) override {
    if (variable == seed_ && value < 0)
      throw ValueRefused("seed: expected a number from 0 to 2147483647, got " +
                         sim::number_text(value));
    const bool changes = values_[variable] != value;
    values_[variable] = value;
    if (changes && variables_[variable].role == Role::fixed) plant_.reset();
  }

  void initialise() override { build(); }

  void advance(double end) override {
    const int code = static_cast<int>(values_[0]);
    if (code < -top_ || code >= top_)
      throw ValueRefused("dac_code: expected a code from " + std::to_string(-top_) + " to " +
                         std::to_string(top_ - 1) + ", got " + std::to_string(code));
    Plant::Inputs inputs{0.0, code, values_[1] != 0.0, values_[2] != 0.0};
    while (now_ < end) {
      const auto tick = static_cast<double>(plant_->tick());
      inputs.at = now_ - tick;
      if (now_ == tick) apply_impulses();
      if (in_tick_.empty() || !are_same(in_tick_.back(), inputs)) in_tick_.push_back(inputs);
      now_ = std::min(end, tick + 1.0);
      if (now_ < tick + 1.0) {
        within_.resize(seed_ - first_signal_);
        plant_->signals_within(in_tick_, now_ - tick, within_);
        continue;
      }
      plant_->step(in_tick_);
      codes_ = plant_->codes();
      in_tick_.clear();
      within_.clear();
    }
  }

  void reset() override {
    values_.resize(variables_.size());
    for (std::size_t i = 0; i < variables_.size(); ++i) values_[i] = variables_[i].start;
    plant_.reset();
    now_ = 0.0;
    in_tick_.clear();
    within_.clear();
  }

  std::unique_ptr<State> state() override {
    auto copy = std::make_unique<Copy>();
    copy->values = values_;
    copy->plant = plant_;
    copy->codes = codes_;
    copy->top = top_;
    copy->now = now_;
    copy->in_tick = in_tick_;
    copy->within = within_;
    return copy;
  }
  void restore(const State &state) override {
    const Copy &copy = static_cast<const Copy &>(state);
    values_ = copy.values;
    if (copy.plant)
      plant_.emplace(*copy.plant);
    else
      plant_.reset();
    codes_ = copy.codes;
    top_ = copy.top;
    now_ = copy.now;
    in_tick_ = copy.in_tick;
    within_ = copy.within;
  }

 private:
  struct Copy final : State {
    std::vector<double> values;
    std::optional<Plant> plant;
    SensorCodes codes;
    int top = 0;
    double now = 0.0;
    std::vector<Plant::Inputs> in_tick;
    std::vector<double> within;
  };

  void apply_impulses() {
    for (std::size_t i = 0; i < impulse_bodies_.size(); ++i) {
      const double impulse = values_[kInputs + i];
      if (impulse != 0.0) plant_->apply_impulse(impulse_bodies_[i], impulse);
    }
  }

  void list_inputs(const sim::Model &model) {
    variables_ = {
        {"dac_code", Type::int32, Role::input, "code", "code of the DAC of the model"},
        {"amp_enable", Type::boolean, Role::input, "", "output of the firmware: amplifier enabled"},
        {"brake_release", Type::boolean, Role::input, "", "output of the firmware: brake released"},
    };
    for (const sim::Body &body : model.bodies) {
      impulse_bodies_.push_back(body.name);
      variables_.push_back({"impulse." + body.name, Type::real, Role::input, "N s",
                            "impulse on the body at the begin of each tick of a step"});
    }
    first_code_ = variables_.size();
  }

  void list_parameters(const sim::Model &model) {
    for (const sim::Parameter &parameter : model.parameters) {
      if (!parameter.used) continue;
      variables_.push_back({"model." + parameter.name, Type::real, Role::fixed, parameter.unit,
                            parameter.source.empty()
                                ? "parameter of the model"
                                : "parameter of the model; " + parameter.source,
                            parameter.value});
    }
  }

  // Builds the plant with the present parameters. A parameter that still has its start value is not
  // overridden. So a parameter with an expression follows the parameters in this expression.
  void build() {
    if (plant_) return;
    std::map<std::string, sim::Override> changed;
    for (const sim::Override &own : set_) changed[own.parameter] = own;
    constexpr std::size_t kPrefix = sizeof("model.") - 1;
    for (std::size_t i = seed_ + 1; i < variables_.size(); ++i) {
      if (variables_[i].role != Role::fixed || values_[i] == variables_[i].start) continue;
      const std::string name = variables_[i].name.substr(kPrefix);
      changed[name] = {name, values_[i]};
    }
    std::vector<sim::Override> overrides;
    for (const auto &[name, override] : changed) overrides.push_back(override);
    auto model = std::make_shared<const sim::Model>(file_.model(overrides));
    top_ = 1 << (model->dac->bits - 1);
    const auto seed = static_cast<std::uint64_t>(values_[seed_]);
    plant_.emplace(std::move(model), sim::PlantOptions{.listed_events = 0, .seed = seed});
    codes_ = plant_->codes();
  }

  sim::ModelFile file_;
  std::vector<sim::Override> set_;
  std::vector<std::string> impulse_bodies_;
  std::size_t first_code_ = 0;
  std::size_t first_signal_ = 0;
  std::size_t seed_ = 0;  // index of the variable `seed`; the parameters of the model follow it

  // Present values of the inputs and of the parameters.
  std::vector<double> values_;
  // The plant, which is built when one of its values is needed for the first time.
  std::optional<Plant> plant_;
  // Codes of this tick. Plant::codes() is called once in each tick, because it reads the index
  // pulse.
  SensorCodes codes_;
  int top_ = 0;       // number of DAC codes from 0 to the largest positive code
  double now_ = 0.0;  // present time in ticks
  // The inputs since the last tick, and the signals at this instant. Both are empty at a tick. The
  // plant is then simulated from tick to tick, so parts of a tick do not change its doubles.
  std::vector<Plant::Inputs> in_tick_;
  std::vector<double> within_;
};

}  // namespace

std::unique_ptr<Unit> plant_unit(const std::filesystem::path &model,
                                 std::span<const sim::Override> set, std::int32_t seed) {
  return std::make_unique<PlantUnit>(model, set, seed);
}

}  // namespace forceaxis::fmu
