#include "sim/hybrid/plant.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>

#include "sim/hybrid/kernel.hpp"
#include "sim/model/elements/adc.hpp"
#include "sim/model/elements/dac.hpp"
#include "sim/model/elements/drive.hpp"
#include "sim/model/elements/encoder.hpp"
#include "sim/model/elements/machine_controller.hpp"

namespace forceaxis::sim {
namespace {

// Returns floor(value), without the C library, for a value within the range of std::int64_t.
std::int64_t floor_integer(double value) {
  const auto cut = static_cast<std::int64_t>(value);
  return cut - static_cast<std::int64_t>(static_cast<double>(cut) > value);
}

double smaller(double a, double b) { return a < b ? a : b; }

// Returns the distance from y to the nearest integer, computed from floor(y).
double edge_distance(double y, std::int64_t floor_y) {
  const double past = y - static_cast<double>(floor_y);
  return smaller(past, 1.0 - past);
}

// Returns the data of the drive that the firmware has in this tick, with or without a bus.
DriveBus::Sample over(DriveBus &bus, std::int64_t tick, std::int32_t count) {
  return bus.fitted() ? bus.sense(tick, count) : DriveBus::Sample{count, 0, 0};
}

constexpr double kFar = 0x1p62;

// Channel number of the DAC in the noise generator. The ADCs have the numbers 0 and 1.
constexpr std::uint64_t kDacChannel = 2;

// Returns a random number with approximately a normal distribution of mean 0 and variance 1. The
// number is computed from the sum of twelve random integers of 16 bits, whose standard deviation is
// 2^16 (to 1 part in 2^33). splitmix64 (Steele, Lea, Flood 2014) computes the integers from a
// counter, so the noise of a tick does not depend on other ticks.
double deviate(std::uint64_t seed, std::uint64_t channel, std::int64_t tick) {
  const auto mixed = [](std::uint64_t x) {
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
    return x ^ (x >> 31);
  };
  const std::uint64_t stream = mixed(seed * 4 + channel + 0x9E3779B97F4A7C15ULL);
  std::int64_t sum = 0;
  for (std::uint64_t k = 0; k < 3; ++k) {
    const std::uint64_t count = static_cast<std::uint64_t>(tick) * 3 + k;
    std::uint64_t bits = mixed(stream + (count + 1) * 0x9E3779B97F4A7C15ULL);
    for (int i = 0; i < 4; ++i, bits >>= 16) sum += static_cast<std::int64_t>(bits & 0xFFFF);
  }
  return static_cast<double>(2 * sum - 12 * 0xFFFF) * 0x1p-17;
}

// Returns the start values of all bodies as pairs of position and velocity, which is the form that
// Stepper expects.
std::vector<double> start_of(const PlantOptions &options) {
  std::vector<double> values;
  for (const BodyStart &start : options.starts) {
    values.push_back(start.position);
    values.push_back(start.velocity);
  }
  return values;
}

}  // namespace

Plant::Plant(std::shared_ptr<const Model> model, PlantOptions options)
    : Plant(std::make_shared<ModeCache>(std::move(model)), options) {}

Plant::Plant(std::shared_ptr<ModeCache> cache, PlantOptions options)
    : stepper_(std::move(cache), options.audit, options.listed_events, start_of(options)),
      seed_(options.seed),
      audit_(options.audit),
      edge_margin_(std::numeric_limits<double>::infinity()) {
  const Model &description = model();
  auto names = std::make_shared<std::vector<std::string>>();
  for (const SignalInfo &signal : description.signal_list()) names->push_back(signal.name);
  signal_names_ = std::move(names);
  volts_per_step_ = description.dac->volts_per_step();
  dac_offset_ = description.dac->offset;
  lowest_code_ = -(1 << (description.dac->bits - 1));
  highest_code_ = -lowest_code_ - 1;
  for (std::size_t channel = 0; channel < 2; ++channel)
    if (const auto &adc = description.adc[channel]) {
      converters_[channel] = converter_of(*adc);
      begin_samples(channel, *adc);
    }
  has_encoder_ = description.encoder.has_value();
  if (has_encoder_) {
    read_encoder(*description.encoder);
    switches_ = SwitchBank(*description.switches);
  }
  if (const auto &drive = description.drive;
      drive && (drive->enable_ticks || !drive->bus.immediate()))
    bus_ = DriveBus(drive->bus, drive->enable_ticks);
  if (const auto &controller = description.machine_controller) {
    machine_law_.emplace(*controller, 1.0 / stepper_.cache().rate_hz());
    const MachineForce *force = controller->force();
    const auto place = std::find(signal_names_->begin(), signal_names_->end(),
                                 force == nullptr ? "" : force->signal);
    if (place != signal_names_->end())
      machine_signal_ = static_cast<std::size_t>(place - signal_names_->begin());
  }
  if (audit_) initial_energy_ = total_energy();
}

Plant::Converter Plant::converter_of(const Adc &adc) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const int top = (1 << adc.bits) - 1;
  // If a filter follows a limit, the network applies this limit.
  const bool by_network = adc.sinc_order > 0;
  const double sensor_limit =
      adc.filter || by_network ? kInfinity : adc.sensor_limit.value_or(kInfinity);
  const double limit = by_network ? kInfinity : adc.conditioning_limit.value_or(kInfinity);
  return {true,
          top,
          adc.zero_code,
          smaller(limit, sensor_limit),
          adc.noise,
          1.0 / adc.per_count,
          adc.rounding,
          static_cast<double>(1 - adc.zero_code),
          static_cast<double>(top - adc.zero_code),
          {},
          {},
          0.0};
}

void Plant::begin_samples(std::size_t channel, const Adc &adc) {
  if (!adc.sampling) return;
  sampled_ = true;
  Converter &converter = converters_[channel];
  const double start = stepper_.sensors()[channel];
  converter.samples = SampledSensor(*adc.sampling, stepper_.cache().rate_hz(), parts());
  converter.samples.begin(convert(channel, start, -1));
  if (adc.sinc_order == 0) return;
  converter.filter =
      SincFilter(static_cast<std::size_t>(adc.sinc_order), kTickRateHz / adc.sampling->rate_hz);
  converter.filter.begin(start, converter.samples.next_instant() / parts());
}

void Plant::read_encoder(const Encoder &encoder) {
  encoder_scale_ = encoder.scale;
  const Network &network = stepper_.network();
  const auto &coordinates = network.coordinates();
  if (model().is_body(encoder.body) &&
      (encoder.reference == kGround || model().is_body(encoder.reference))) {
    const auto position_of = [&](int body) {
      return static_cast<std::size_t>(coordinates[static_cast<std::size_t>(body)].position);
    };
    encoder_state_ = position_of(encoder.body);
    if (encoder.reference != kGround) reference_state_ = position_of(encoder.reference);
    return;
  }
  reference_state_ = encoder_state_;
  encoder_row_.assign(static_cast<std::size_t>(network.states()), 0.0);
  const auto add = [&](int point, double sign) {
    if (point == kGround) return;
    for (const Wiring::Share &share : network.points()[static_cast<std::size_t>(point)]) {
      const auto coordinate = static_cast<std::size_t>(share.coordinate);
      encoder_row_[static_cast<std::size_t>(coordinates[coordinate].position)] +=
          sign * share.factor;
    }
  };
  add(encoder.body, 1.0);
  add(encoder.reference, -1.0);
}

// Returns the position in m that an encoder with a reference, or with a port as an end, measures.
double Plant::relative_place() const {
  const double *z = stepper_.z().data();
  if (!encoder_row_.empty()) return kernel::dot(encoder_row_.data(), z, encoder_row_.size());
  return z[encoder_state_] - z[*reference_state_];
}

double Plant::volts(int dac_code) const {
  if (dac_code < lowest_code_ || dac_code > highest_code_)
    throw std::invalid_argument("DAC code " + std::to_string(dac_code) + " is outside " +
                                std::to_string(lowest_code_) + ".." +
                                std::to_string(highest_code_));
  double volts = static_cast<double>(dac_code) * volts_per_step_ + dac_offset_;
  if (const double noise = model().dac->noise; noise > 0.0)
    volts += noise * deviate(seed_, kDacChannel, tick());
  return volts;
}

void Plant::step(int dac_code, bool amp_enable, bool brake_release) {
  const Command command = begin_step({0.0, dac_code, amp_enable, brake_release});
  step_volts(command.volts, command.amp_enable, command.brake_release);
}

Plant::Command Plant::begin_step(const Inputs &inputs) {
  if (machine_law_) return {machine_law_->volts(tick(), signal_at(machine_signal_)), true, true};
  DriveBus::Frame frame{inputs.dac_code, inputs.amp_enable};
  if (bus_.fitted()) {
    codes();  // The drive measures its encoder in every tick, even if the firmware does not use the
              // value.
    frame = bus_.act(tick(), frame);
  }
  return {volts(frame.dac_code), frame.amp_enable, inputs.brake_release};
}

// Pauses one step of the plant at the instants of the samples.
class Plant::SamplePauses final : public Stepper::Pauses {
 public:
  explicit SamplePauses(Plant &plant) : plant_(plant) {}
  double next() const override {
    const double start = static_cast<double>(plant_.tick());
    double first = std::numeric_limits<double>::infinity();
    for (const Converter &adc : plant_.converters_)
      if (adc.samples.fitted()) first = smaller(first, adc.samples.next_instant() - start);
    return first;
  }
  void pause() override {
    const double at = next();
    const double start = static_cast<double>(plant_.tick());
    for (std::size_t channel = 0; channel < 2; ++channel) {
      const SampledSensor &samples = plant_.converters_[channel].samples;
      if (samples.fitted() && samples.next_instant() - start <= at) plant_.take_sample(channel);
    }
  }

 private:
  Plant &plant_;
};

// Pauses one step of the plant at the instants of the samples, at those of its inputs, and at the
// instant at which the signals are wanted.
class Plant::StepPauses final : public Stepper::Pauses {
 public:
  StepPauses(Plant &plant, std::span<const Inputs> inputs, Command command)
      : samples_(plant), plant_(plant), inputs_(inputs), command_(command) {}
  void watch(double at, std::span<double> values) {
    watched_ = at;
    values_ = values;
  }
  double next() const override {
    return smaller(smaller(samples_.next(), watched_), next_inputs());
  }
  void pause() override {
    const double at = next();
    if (samples_.next() <= at) samples_.pause();
    if (next_inputs() <= at) replace(at);
    if (watched_ > at) return;
    plant_.signals(values_);
    watched_ = kNever;
  }

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();
  double next_inputs() const { return inputs_.empty() ? kNever : inputs_.front().at; }
  void replace(double at) {
    const Inputs &inputs = inputs_.front();
    inputs_ = inputs_.subspan(1);
    if (plant_.machine_law_) return;
    command_.brake_release = inputs.brake_release;
    if (!plant_.bus_.fitted()) {
      command_.volts = plant_.volts(inputs.dac_code);
      command_.amp_enable = inputs.amp_enable;
    }
    plant_.stepper_.replace(at, command_.volts, command_.amp_enable, command_.brake_release);
  }

  SamplePauses samples_;
  Plant &plant_;
  std::span<const Inputs> inputs_;
  Command command_;
  double watched_ = kNever;
  std::span<double> values_;
};

void Plant::step(std::span<const Inputs> inputs) {
  if (inputs.size() == 1) {
    step(inputs[0].dac_code, inputs[0].amp_enable, inputs[0].brake_release);
    return;
  }
  const Command command = begin_step(inputs.front());
  begin_sampled_step();
  StepPauses pauses(*this, inputs.subspan(1), command);
  stepper_.step(command.volts, command.amp_enable, command.brake_release, pauses);
}

void Plant::signals_within(std::span<const Inputs> inputs, double at,
                           std::span<double> values) const {
  Plant ahead = *this;
  const Command command = ahead.begin_step(inputs.front());
  ahead.begin_sampled_step();
  StepPauses pauses(ahead, inputs.subspan(1), command);
  pauses.watch(at, values);
  ahead.stepper_.step(command.volts, command.amp_enable, command.brake_release, pauses);
}

// Samples the signal of one converter at this instant.
void Plant::take_sample(std::size_t channel) {
  Converter &adc = converters_[channel];
  double reading = 0.0;
  if (adc.filter.fitted()) {
    collect(channel, adc.samples.next_instant());
    reading = adc.filter.take();
  } else {
    reading = stepper_.sensors()[channel];
  }
  adc.samples.take(convert(channel, reading, adc.samples.next()));
}

// Moves the moments of a signal from the plant to the sinc filter of its converter at this instant.
void Plant::collect(std::size_t channel, double instant) {
  Converter &adc = converters_[channel];
  const auto first = static_cast<std::size_t>(stepper_.network().filter_states()[channel]);
  const std::size_t order = adc.filter.order();
  adc.filter.add({stepper_.z().data() + first, order}, (instant - adc.collected) / parts());
  adc.collected = instant;
  stepper_.clear(first, order);
}

// Samples the signals of all converters that sample at this instant.
void Plant::take_samples() {
  SamplePauses pauses(*this);
  if (pauses.next() <= 0.0) pauses.pause();
}

void Plant::begin_sampled_step() {
  if (!sampled_) return;
  take_samples();
  for (std::size_t channel = 0; channel < 2; ++channel)
    if (converters_[channel].filter.fitted()) collect(channel, static_cast<double>(tick()));
}

void Plant::step_sampled(double volts, bool amp_enable, bool brake_release) {
  begin_sampled_step();
  SamplePauses pauses(*this);
  stepper_.step(volts, amp_enable, brake_release, pauses);
}

void Plant::apply_impulse(std::string_view point, double impulse_N_s) {
  const int index = model().point_index(point);
  if (!(kernel::magnitude(impulse_N_s) < 1e30))
    throw std::invalid_argument("an impulse must be a finite number of N s");
  stepper_.kick(static_cast<std::size_t>(index), impulse_N_s);
}

const SensorCodes &Plant::codes() {
  if (sampled_) take_samples();
  const double *value = stepper_.sensors();
  SensorCodes &codes = codes_;
  if (has_encoder_) {
    const double place = encoder_place();
    const double y = place * encoder_scale_ + 0.5;
    if (!(kernel::magnitude(y) < kFar))
      throw SimulationError(
          "the encoder's body left all bounds at t = " + std::to_string(time_s()) + " s");
    const std::int64_t count = floor_integer(y);
    const DriveBus::Sample seen =
        over(bus_, tick(), static_cast<std::int32_t>(static_cast<std::uint32_t>(count)));
    codes.encoder = seen.count;
    codes.encoder_age = seen.age_ticks;
    codes.drive = seen.report;
    edge_margin_ = smaller(edge_margin_, edge_distance(y, count));
    if (switches_.fitted()) codes.switches = switches_.read(place);
  } else if (bus_.fitted()) {
    codes.drive = bus_.sense(tick(), 0).report;
  }
  for (std::size_t channel = 0; channel < 2; ++channel) {
    const Converter &adc = converters_[channel];
    if (!adc.present) continue;
    if (!adc.samples.fitted()) {
      codes.adc[channel] = convert(channel, value[channel], tick());
      continue;
    }
    const SampledSensor::Reading newest = adc.samples.at(tick());
    codes.adc[channel] = newest.code;
    if (channel == 0) codes.force_age = newest.age_ticks;
  }
  return codes;
}

double Plant::reading(std::size_t channel) {
  const double limit = converters_[channel].limit;
  return std::clamp(stepper_.sensors()[channel], -limit, limit);
}

// Returns the ADC code of a reading, and updates the edge margin. `sample` is the number of the
// sample, on which the noise depends.
std::uint16_t Plant::convert(std::size_t channel, double reading, std::int64_t sample) {
  const Converter &adc = converters_[channel];
  // The ADC code changes at the values 1, 2, ..., top of the scaled signal y.
  if (reading > adc.limit) reading = adc.limit;
  if (reading < -adc.limit) reading = -adc.limit;
  if (adc.noise > 0.0) reading += adc.noise * deviate(seed_, channel, sample);
  const double y = reading * adc.counts_per_unit + adc.rounding;
  double distance = 0.0;
  int code = 0;
  if (!(y >= adc.low)) {
    distance = adc.low - y;
  } else if (y >= adc.high) {
    code = adc.top;
    distance = y - adc.high;
  } else {
    const std::int64_t step = floor_integer(y);
    code = static_cast<int>(step) + adc.zero_code;
    distance = edge_distance(y, step);
  }
  edge_margin_ = smaller(edge_margin_, distance);
  return static_cast<std::uint16_t>(code);
}

void Plant::signals(std::span<double> values) const {
  const Mode &mode = stepper_.mode();
  if (values.size() != signal_names_->size())
    throw std::invalid_argument("signals() expects one element for each signal");
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = kernel::dot(&mode.truth[i * mode.columns], stepper_.z().data(), mode.columns);
}

double Plant::signal(std::string_view name) const {
  const auto found = std::find(signal_names_->begin(), signal_names_->end(), name);
  if (found == signal_names_->end())
    throw std::invalid_argument("no signal named " + std::string(name));
  return signal_at(static_cast<std::size_t>(found - signal_names_->begin()));
}

double Plant::signal_at(std::size_t place) const {
  const Mode &mode = stepper_.mode();
  return kernel::dot(&mode.truth[place * mode.columns], stepper_.z().data(), mode.columns);
}

std::vector<Event> Plant::events() const {
  std::vector<Event> list;
  for (const SwitchEvent &event : stepper_.events()) {
    const auto &s = stepper_.network().switches()[static_cast<std::size_t>(event.switch_index)];
    list.push_back({event.time_s, s.element, s.state_names[static_cast<std::size_t>(event.from)],
                    s.state_names[static_cast<std::size_t>(event.to)], event.jump});
  }
  return list;
}

std::vector<Plant::EventCount> Plant::event_counts() const {
  std::vector<EventCount> list;
  const auto &switches = stepper_.network().switches();
  for (std::size_t i = 0; i < switches.size(); ++i)
    for (std::size_t from = 0; from < switches[i].state_names.size(); ++from)
      for (std::size_t to = 0; to < switches[i].state_names.size(); ++to) {
        const std::int64_t count =
            stepper_.count(static_cast<int>(i), static_cast<int>(from), static_cast<int>(to));
        if (count > 0)
          list.push_back({switches[i].element, switches[i].state_names[from],
                          switches[i].state_names[to], count});
      }
  return list;
}

std::vector<std::string> Plant::mode() const {
  std::vector<std::string> list;
  const Network &network = stepper_.network();
  const ModeKey key = stepper_.mode().key;
  for (std::size_t i = 0; i < network.switches().size(); ++i) {
    const auto &s = network.switches()[i];
    const auto state = static_cast<std::size_t>(network.state_of(key, static_cast<int>(i)));
    const bool off = s.of_drive && !Network::enabled(key);
    list.push_back(s.element + ": " + (off ? std::string("off") : s.state_names[state]));
  }
  return list;
}

double Plant::total_energy() const {
  double sum = stepper_.kinetic();
  for (const double energy : stepper_.stored()) sum += energy;
  return sum;
}

EnergyAudit Plant::energy() const {
  if (!audit_) throw std::logic_error("energy() needs a plant built with PlantOptions::audit");
  const EnergyIntegrals integrals = stepper_.energy();
  EnergyAudit result;
  result.initial = initial_energy_;
  result.impulses = integrals.impulse;
  result.supplied = integrals.impulse;
  for (const double work : integrals.supplied) result.supplied += work;
  result.kinetic = stepper_.kinetic();
  for (const double energy : stepper_.stored()) result.stored += energy;
  result.discarded = integrals.discarded;
  double out = result.kinetic + result.stored + result.discarded;
  const auto &dampers = stepper_.network().dampers();
  for (std::size_t i = 0; i < dampers.size(); ++i) {
    const double energy = integrals.dissipated[i];
    const auto same =
        std::find_if(result.dissipated.begin(), result.dissipated.end(),
                     [&](const auto &other) { return other.element == dampers[i].element; });
    if (same == result.dissipated.end())
      result.dissipated.push_back({dampers[i].element, energy});
    else
      same->energy += energy;
    out += energy;
  }
  result.residual = result.initial + result.supplied - out;
  return result;
}

}  // namespace forceaxis::sim
