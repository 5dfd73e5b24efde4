#include "host/link/inject.hpp"

#include <array>
#include <charconv>
#include <stdexcept>
#include <utility>

namespace forceaxis::host {
namespace {

void flip(LinkInputs &in, int bit) {
  if (bit < 32) {
    in.encoder_cnt =
        static_cast<std::int32_t>(static_cast<std::uint32_t>(in.encoder_cnt) ^ 1U << bit);
  } else if (bit < 48) {
    in.adc0_code = static_cast<std::uint16_t>(in.adc0_code ^ 1U << (bit - 32));
  } else {
    in.adc1_code = static_cast<std::uint16_t>(in.adc1_code ^ 1U << (bit - 48));
  }
}

void flip(LinkOutputs &out, int bit) {
  out.dac_code =
      static_cast<std::int16_t>(static_cast<std::uint16_t>(out.dac_code) ^ 1U << (bit % 16));
}

// Random numbers from the generator splitmix64, so the faults are the same on every machine.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : state_(seed) {}
  // Returns the next random number in [0, 1).
  double next() {
    std::uint64_t z = (state_ += 0x9E3779B97F4A7C15U);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBU;
    return static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1p-53;
  }

 private:
  std::uint64_t state_;
};

template <class Out, class In>
class Injecting : public Transport<Out, In> {
 public:
  Injecting(std::unique_ptr<Transport<Out, In>> below, const Injection &injection,
            InjectionCounts &counts)
      : below_(std::move(below)), injection_(injection), counts_(counts), dice_(injection.seed) {}

  void send(std::span<const Out> records) override {
    for (Out record : records) {
      if (record.tick == injection_.flip_tick && counts_.flipped == 0) {
        flip(record, injection_.flip_bit);
        ++counts_.flipped;
      }
      const double fate = dice_.next();
      if (fate < injection_.drop) {
        ++counts_.dropped;
        continue;
      }
      below_->send({&record, 1});
      if (fate < injection_.drop + injection_.duplicate) {
        ++counts_.doubled;
        below_->send({&record, 1});
      }
    }
  }

  std::size_t receive(std::span<In> records, std::chrono::milliseconds wait) override {
    return below_->receive(records, wait);
  }

  std::uint64_t foreign() const override { return below_->foreign(); }

 private:
  std::unique_ptr<Transport<Out, In>> below_;
  Injection injection_;
  InjectionCounts &counts_;
  Dice dice_;
};

template <class T>
T number(const std::string &part, T low, T high) {
  const std::size_t equals = part.find('=');
  const char *begin = part.data() + equals + 1, *end = part.data() + part.size();
  T value{};
  const auto parsed = std::from_chars(begin, end, value);
  if (parsed.ec != std::errc() || parsed.ptr != end || !(value >= low && value <= high)) {
    throw std::invalid_argument(part + ": expected a number from " + std::to_string(low) + " to " +
                                std::to_string(high));
  }
  return value;
}

}  // namespace

Injection injection_of(const std::string &text) {
  Injection injection;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t comma = std::min(text.find(',', at), text.size());
    const std::string part = text.substr(at, comma - at);
    const std::string name = part.substr(0, part.find('='));
    if (name == part) {
      throw std::invalid_argument(part + ": expected drop=, double=, seed=, flip= or bit=");
    } else if (name == "drop") {
      injection.drop = number(part, 0.0, 0.9);
    } else if (name == "double") {
      injection.duplicate = number(part, 0.0, 0.9);
    } else if (name == "seed") {
      injection.seed = number<std::uint64_t>(part, 0, 0xFFFFFFFF);
    } else if (name == "flip") {
      injection.flip_tick = number<std::int64_t>(part, 0, 900000);
    } else if (name == "bit") {
      injection.flip_bit = number(part, 0, 63);
    } else {
      throw std::invalid_argument(part + ": expected drop=, double=, seed=, flip= or bit=");
    }
    at = comma + 1;
  }
  return injection;
}

template <class Out, class In>
std::unique_ptr<Transport<Out, In>> injecting(std::unique_ptr<Transport<Out, In>> transport,
                                              const Injection &injection, InjectionCounts &counts) {
  return std::make_unique<Injecting<Out, In>>(std::move(transport), injection, counts);
}

template std::unique_ptr<PlantTransport> injecting(std::unique_ptr<PlantTransport>,
                                                   const Injection &, InjectionCounts &);
template std::unique_ptr<AxisTransport> injecting(std::unique_ptr<AxisTransport>, const Injection &,
                                                  InjectionCounts &);

}  // namespace forceaxis::host
