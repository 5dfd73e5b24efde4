#include "host/fmu/firmware_unit.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <type_traits>
#include <utility>

#include "firmware/port/host/firmware.hpp"
#include "host/fmu/codes.hpp"
#include "host/run/experiment_writes.hpp"
#include "host/run/objects.hpp"
#include "sim/model/elements/drive.hpp"
#include "sim/model/text.hpp"

namespace forceaxis::fmu {
namespace {

constexpr std::size_t kEnable = kCodeCount;
constexpr std::size_t kInputCount = kCodeCount + 2;
// Index after the outputs dac_code, amp_enable and brake_release.
constexpr std::size_t kFirstObject = kInputCount + 3;

// Returns the largest value of an input that is neither a Boolean nor the encoder count.
double top_of(std::size_t input) { return input == kAdc0 || input == kAdc1 ? 65535.0 : 255.0; }

// Returns the bit of `din` that an input sets, or 0 if the input is not a bit.
std::uint8_t din_bit(std::size_t input) {
  constexpr std::uint8_t kSwitches[] = {AXIS_DIGITAL_INPUTS_LIMIT_POSITIVE,
                                        AXIS_DIGITAL_INPUTS_LIMIT_NEGATIVE,
                                        AXIS_DIGITAL_INPUTS_INDEX, AXIS_DIGITAL_INPUTS_HOME};
  if (input == kEnable) return AXIS_DIGITAL_INPUTS_ENABLE;
  return input >= kLimitPos && input <= kHome ? kSwitches[input - kLimitPos] : 0;
}

void write_input(axis_inputs_t &inputs, std::size_t input, double value) {
  if (const unsigned bit = din_bit(input)) {
    inputs.din = static_cast<std::uint8_t>(value != 0.0 ? inputs.din | bit : inputs.din & ~bit);
    return;
  }
  switch (input) {
    case kEncoder:
      inputs.encoder_cnt = static_cast<std::int32_t>(value);
      break;
    case kPositionAge:
      inputs.position_age = static_cast<std::uint8_t>(value);
      break;
    case kAdc0:
    case kAdc1:
      inputs.adc_code[input == kAdc1 ? 1 : 0] = static_cast<std::uint16_t>(value);
      break;
    case kForceAge:
      inputs.force_age = static_cast<std::uint8_t>(value);
      break;
    case kDriveReport:
      inputs.drive = static_cast<std::uint8_t>(value);
      break;
    default:
      inputs.sensor_valid = value != 0.0;
  }
}

// The firmware with all of its memory. A copy of these bytes, written back to the same address,
// restores the complete state.
struct Memory {
  fw_t fw;
  std::uint8_t recorder[FW_RECORDER_BYTES];
  std::uint32_t programs[FW_PROGRAM_BYTES / sizeof(std::uint32_t)];
  cycle_part_t results[FW_RESULTS];
  std::uint32_t curve[FW_CURVE_BYTES / sizeof(std::uint32_t)];
};
static_assert(std::is_trivially_copyable_v<Memory>);

bool is_signed(const axis_object_meta_t &meta) { return meta.type[0] == 'i'; }

double value_of(const axis_object_meta_t &meta, std::int32_t raw) {
  const double number = is_signed(meta) ? static_cast<double>(raw)
                                        : static_cast<double>(static_cast<std::uint32_t>(raw));
  return number * meta.scale;
}

std::string meaning_of(const axis_object_meta_t &meta) {
  std::string text = meta.meaning;
  int number = 0;
  for (const std::string &name : host::enum_texts(meta.object))
    text += (number == 0 ? "; 0 " : ", " + std::to_string(number) + " ") + name, ++number;
  return text;
}

class FirmwareUnit final : public Unit {
 public:
  explicit FirmwareUnit(FirmwareFacts facts)
      : facts_(std::move(facts)), memory_(std::make_unique<Memory>()) {
    for (const Code &code : kCodes)
      variables_.push_back({code.name, code.type, Role::input, code.unit, code.meaning});
    variables_.push_back(
        {"enable", Type::boolean, Role::input, "", "the enable chain is closed", 1});
    variables_.push_back({"sensor_valid", Type::boolean, Role::input, "",
                          "encoder count and ADC codes are valid", 1});
    variables_.push_back({"dac_code", Type::int32, Role::output, "code",
                          "code of a DAC of " + std::to_string(facts_.dac_bits) + " bits"});
    variables_.push_back(
        {"amp_enable", Type::boolean, Role::output, "", "the amplifier is enabled"});
    variables_.push_back(
        {"brake_release", Type::boolean, Role::output, "", "the brake is released"});
    power_up();
    list_objects();
    list_time();
    reset();
  }

  double get(std::size_t variable) override {
    if (variable < kInputCount) return values_[variable];
    switch (variable - kInputCount) {
      case 0:
        return axis_host_dac_code(&outputs_, facts_.dac_bits);
      case 1:
        return outputs_.amp_enable;
      case 2:
        return outputs_.brake_release;
      default:
        return read(variable);
    }
  }

  void set(std::size_t variable, double value) override {
    if (variable >= kFirstObject) {
      write(variable, value);
      return;
    }
    const Variable &input = variables_[variable];
    if (input.type == Type::int32 && variable != kEncoder &&
        (value < 0 || value > top_of(variable)))
      throw ValueRefused(input.name + ": expected a value from 0 to " +
                         sim::number_text(top_of(variable)) + ", got " + sim::number_text(value));
    values_[variable] = value;
    write_input(inputs_, variable, value);
  }

  void initialise() override {}

  void advance(double end) override {
    while (static_cast<double>(tick_) < end) tick();
  }

  void reset() override {
    power_up();
    values_.resize(variables_.size());
    for (std::size_t i = 0; i < variables_.size(); ++i) values_[i] = variables_[i].start;
    inputs_ = {};
    for (std::size_t i = 0; i < kInputCount; ++i) write_input(inputs_, i, variables_[i].start);
    outputs_ = {};
    tick_ = 0;
  }

  std::unique_ptr<State> state() override {
    auto copy = std::make_unique<Copy>(*writes_);
    copy->memory = std::make_unique<Memory>(*memory_);
    copy->values = values_;
    copy->inputs = inputs_;
    copy->outputs = outputs_;
    copy->tick = tick_;
    return copy;
  }
  void restore(const State &state) override {
    const Copy &copy = static_cast<const Copy &>(state);
    writes_.emplace(copy.writes);
    *memory_ = *copy.memory;
    values_ = copy.values;
    inputs_ = copy.inputs;
    outputs_ = copy.outputs;
    tick_ = copy.tick;
  }

 private:
  struct Copy final : State {
    explicit Copy(const host::ExperimentWrites &done) : writes(done) {}
    host::ExperimentWrites writes;
    std::unique_ptr<Memory> memory;
    std::vector<double> values;
    axis_inputs_t inputs{};
    axis_outputs_t outputs{};
    std::int64_t tick = 0;
  };

  // Computes one tick with the present inputs.
  void tick() {
    const std::size_t refused = writes_->refused().size();
    if (writes_->due(tick_)) writes_->write_due(tick_, writer());
    for (std::size_t i = refused; i < writes_->refused().size(); ++i) {
      const host::Refusal &refusal = writes_->refused()[i];
      warnings_.push_back("tick " + std::to_string(refusal.tick) + ": the firmware refused " +
                          refusal.object + ": " + refusal.reason);
    }
    fw_tick(&memory_->fw, &inputs_, &outputs_);
    ++tick_;
  }

  // Initialises the firmware and writes the initial values of the experiment.
  void power_up() {
    *memory_ = {};
    fw_config_t config{};
    config.dac_bits = static_cast<std::uint8_t>(facts_.dac_bits);
    config.recorder_buffer = memory_->recorder;
    config.recorder_bytes = sizeof(memory_->recorder);
    config.program_memory = memory_->programs;
    config.program_bytes = sizeof(memory_->programs);
    config.result_memory = memory_->results;
    config.result_bytes = sizeof(memory_->results);
    config.curve_memory = memory_->curve;
    config.curve_bytes = sizeof(memory_->curve);
    fw_init(&memory_->fw, &config);
    // This write of an unchanged value starts the drive function, whose signals are variables.
    fw_object_write(&memory_->fw, FW_SOURCE_LOCAL, AXIS_OBJ_VELOCITY_THRESHOLD,
                    raw(AXIS_OBJ_VELOCITY_THRESHOLD));
    if (!facts_.program.empty()) select_program();
    writes_.emplace(facts_.experiment);
    writes_->write_initial(writer());
  }

  void select_program() {
    const auto bytes = static_cast<std::uint32_t>(4 * facts_.program.size());
    const cycle_check_t check = fw_select_program(&memory_->fw, facts_.program.data(), bytes);
    if (check.reason != CYCLE_ACCEPTED)
      throw sim::InputError(facts_.experiment.file.string(), "program",
                            "expected a program that the firmware accepts, got reason " +
                                std::to_string(check.reason));
  }

  void list_objects() {
    for (const axis_object_meta_t &meta : axis_objects_meta) {
      const std::string_view part = meta.part;
      // These objects concern buses and boards, so they are not variables of the unit.
      if (part == "canopen" || part == "device") continue;
      objects_.push_back(&meta);
      variables_.push_back(variable_of(meta));
    }
  }

  Variable variable_of(const axis_object_meta_t &meta) const {
    Variable variable{std::string(meta.part) + "." + meta.name, Type::real, Role::output, meta.unit,
                      meaning_of(meta)};
    if (variable.unit == "1") variable.unit.clear();
    if (meta.scale == 1.0)
      variable.type = meta.size_bytes == 4 && !is_signed(meta) ? Type::uint32 : Type::int32;
    if (host::object_writable(meta.object)) {
      const auto &inputs = facts_.inputs;
      const bool is_input = std::find(inputs.begin(), inputs.end(), meta.object) != inputs.end();
      variable.role = is_input ? Role::input : Role::tunable;
      variable.start = readable(meta) ? value_of(meta, raw(meta.object)) : 0.0;
    }
    return variable;
  }

  static bool readable(const axis_object_meta_t &meta) {
    return std::string_view(meta.access) != "wo";
  }
  const axis_object_meta_t &meta_of(std::size_t variable) const {
    return *objects_[variable - kFirstObject];
  }
  std::int32_t raw(std::uint16_t object) const {
    std::int32_t value = 0;
    fw_object_read(&memory_->fw, object, &value);
    return value;
  }
  double read(std::size_t variable) const {
    const axis_object_meta_t &meta = meta_of(variable);
    return readable(meta) ? value_of(meta, raw(meta.object)) : values_[variable];
  }

  // Writes an object. Throws ValueRefused if the firmware refuses the write.
  void write(std::size_t variable, double value) {
    const axis_object_meta_t &meta = meta_of(variable);
    const double number = std::round(value / meta.scale);
    const auto refuse = [&](const std::string &reason) {
      throw ValueRefused(variables_[variable].name + ": the firmware refuses " +
                         sim::number_text(value) + ": " + reason);
    };
    if (is_new(variable, number)) {
      const auto low = static_cast<double>(meta.min), high = static_cast<double>(meta.max);
      if (number < low || number > high)
        refuse("expected a value from " + sim::number_text(low * meta.scale) + " to " +
               sim::number_text(high * meta.scale));
      const int error =
          fw_object_write(&memory_->fw, FW_SOURCE_LOCAL, meta.object,
                          static_cast<std::int32_t>(static_cast<std::int64_t>(number)));
      if (error != FW_OK) refuse(host::refusal_text(error));
    }
    values_[variable] = value;
  }

  // Returns true if the raw value `number` must be written to the object of a variable. A parameter
  // is written unless the object already has this value. An importer sets each input at each
  // communication point. An input that is not 0 is written only if its value has changed, so the
  // axis does not start again by itself after a fault. An input that is 0 is written if the object
  // is not 0, so a stop always acts.
  bool is_new(std::size_t variable, double number) const {
    const axis_object_meta_t &meta = meta_of(variable);
    const double present = readable(meta) ? std::round(read(variable) / meta.scale) : 0.0;
    if (variables_[variable].role == Role::tunable) return number != present;
    const double before = std::round(values_[variable] / meta.scale);
    return number == 0.0 ? present != 0.0 : number != before;
  }

  host::ExperimentWrites::Write writer() {
    return [this](std::int64_t, const host::ObjectWrite &w) {
      return fw_object_write(&memory_->fw, FW_SOURCE_LOCAL, w.object, w.raw);
    };
  }

  FirmwareFacts facts_;
  std::unique_ptr<Memory> memory_;
  // Objects of the variables from the index kFirstObject on.
  std::vector<const axis_object_meta_t *> objects_;
  std::optional<host::ExperimentWrites> writes_;
  // last values that the user of the unit gave to its inputs and parameters
  std::vector<double> values_;
  axis_inputs_t inputs_{};
  axis_outputs_t outputs_{};
  std::int64_t tick_ = 0;
};

}  // namespace

std::unique_ptr<Unit> firmware_unit(FirmwareFacts facts) {
  return std::make_unique<FirmwareUnit>(std::move(facts));
}

}  // namespace forceaxis::fmu
