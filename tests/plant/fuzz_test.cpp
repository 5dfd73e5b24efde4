// Random models, modes and states: the stepper's result of a tick is checked at 1e4 points of it.
//
// The sampler takes from the simulator only the equations of a mode, the list of events and the
// product of a matrix and a vector (kernel_test.cpp). It builds the flow over 1e-4 tick by a power
// series of its own and goes from point to point: every signal must stay within the bounds of the
// reported mode, and at every event the signal must have reached the bound.
// FORCEAXIS_FUZZ_TICKS is the number of ticks.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "sim/hybrid/stepper.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

constexpr int kSamples = 10000;
constexpr std::size_t kBlock = 16;  // samples computed together; a multiple of 4
constexpr double kStepS = kTickS / kSamples;
constexpr double kLongestViolationS = 1e-9;
constexpr double kRounding = 1e-12;  // of the sum of the absolute terms
constexpr int kTicksPerModel = 1000;

// Draws the TOML of a model.
class Writer {
 public:
  explicit Writer(unsigned seed) : random_(seed) {}

  double between(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  double log(double low, double high) { return low * std::pow(high / low, between(0, 1)); }
  int below(int count) { return std::uniform_int_distribution<int>(0, count - 1)(random_); }
  bool chance(double p) { return between(0, 1) < p; }
  double zero_or(double value) { return chance(0.1) ? 0.0 : value; }  // ties happen to users

  std::string model();
  std::size_t bodies() const { return mass_.size(); }

 private:
  struct Pair {
    std::string text;
    double mass;  // reduced
    int a, b;
  };
  Pair pair(int a, int b) {
    const auto name = [](int i) { return i < 0 ? std::string("ground") : indexed('b', i); };
    const auto inverse = [&](int i) {
      return i < 0 ? 0.0 : 1 / mass_[static_cast<std::size_t>(i)];
    };
    return {"between = [\"" + name(a) + "\", \"" + name(b) + "\"]\n", 1 / (inverse(a) + inverse(b)),
            a, b};
  }
  Pair any_pair() {
    const int count = static_cast<int>(mass_.size());
    const int a = below(count);
    int b = below(count) - 1;  // -1: ground
    if (b >= a) ++b;
    return chance(0.5) ? pair(a, b) : pair(b, a);
  }
  void add(const std::string &kind, const std::string &entries) {
    text_ += "[[" + kind + "]]\nname = \"" + kind + std::to_string(count_++) + "\"\n" + entries;
  }
  static std::string entry(const char *key, double value) {
    return std::string(key) + " = " + number(value) + "\n";
  }
  std::string slopes(const char *key, double about, const char *breaks, double reach) {
    const int segments = 2 + below(3);
    std::string list;
    std::vector<double> at;
    for (int k = 0; k < segments; ++k) list += (k ? ", " : "") + number(about * log(0.2, 5));
    for (int k = 1; k < segments; ++k) at.push_back(between(-reach, reach));
    std::sort(at.begin(), at.end());
    std::string where;
    for (const double b : at) where += (where.empty() ? "" : ", ") + number(b);
    return std::string(key) + " = [" + list + "]\n" + breaks + " = [" + where + "]\n";
  }
  std::string slopes_from_0(double about) {
    const double first = log(1e-6, 1e-4);
    return "stiffness = [" + number(about * log(0.2, 5)) + ", " + number(about * log(0.2, 5)) +
           ", " + number(about * log(0.2, 5)) + "]\nbreaks = [" + number(first) + ", " +
           number(first * log(1.1, 5)) + "]\n";
  }
  std::string stiff(const Pair &p, double slow, double fast) {
    const double rate = log(slow, fast);
    std::string text = entry("stiffness", p.mass * rate * rate);
    if (chance(0.7)) text += entry("damping", 2 * log(0.005, 0.3) * p.mass * rate);
    return text;
  }
  void structure();
  void drive();

  std::mt19937 random_;
  std::vector<double> mass_;
  std::string text_;
  int count_ = 0;
};

std::string Writer::model() {
  const int bodies = 1 + below(3);
  for (int i = 0; i < bodies; ++i) {
    mass_.push_back(log(0.1, 10));
    text_ += "[[body]]\nname = \"" + indexed('b', i) + "\"\n" + entry("mass", mass_.back()) +
             entry("position", between(-1e-3, 1e-3)) + entry("velocity", between(-0.1, 0.1));
  }
  for (int i = 0; i < bodies; ++i) {
    const Pair p = pair(i, below(i + 1) - 1);
    const double rate = log(20, 1000);
    add("spring", p.text +
                      (chance(0.3) ? slopes("stiffness", p.mass * rate * rate, "breaks", 1e-3)
                                   : entry("stiffness", p.mass * rate * rate)) +
                      entry("damping", 2 * log(0.001, 0.1) * p.mass * rate));
  }
  if (chance(0.4)) structure();
  std::vector<int> tied(mass_.size() + 1);  // frictions must not form a loop
  for (std::size_t i = 0; i < tied.size(); ++i) tied[i] = static_cast<int>(i);
  const int elements = 2 + below(4);
  for (int i = 0; i < elements; ++i) {
    const Pair p = any_pair();
    switch (below(11)) {
      case 0:
        add("contact", p.text + stiff(p, 200, 2e4) + entry("gap", zero_or(between(-2e-4, 1e-3))));
        break;
      case 1:
        add("backlash", p.text + stiff(p, 200, 1e4) + entry("width", zero_or(log(1e-5, 1e-3))));
        break;
      case 2: {
        const int sides = below(3);
        add("stop", p.text + stiff(p, 200, 2e4) +
                        (sides != 0 ? entry("low", between(-1e-3, -1e-4)) : "") +
                        (sides != 1 ? entry("high", between(1e-4, 1e-3)) : ""));
        break;
      }
      case 3:
        add("damper", p.text + slopes("damping", p.mass * log(1, 100), "breaks", 0.1));
        break;
      case 4: {
        const int from = tied[static_cast<std::size_t>(p.a + 1)];
        const int to = tied[static_cast<std::size_t>(p.b + 1)];
        if (from == to) break;
        std::replace(tied.begin(), tied.end(), from, to);
        const double coulomb = zero_or(p.mass * log(0.3, 30));
        add("friction", p.text + entry("coulomb", coulomb) +
                            (chance(0.6) ? entry("stiction", coulomb * between(1, 2)) : ""));
        break;
      }
      case 5:
        add("contact", p.text + slopes_from_0(p.mass * log(4e4, 4e8)) +
                           (chance(0.7) ? entry("damping", p.mass * log(1, 300)) : "") +
                           entry("gap", zero_or(between(-2e-4, 1e-3))));
        break;
      case 6: {
        const double stiffness = p.mass * log(4e4, 4e7);
        add(chance(0.7) ? "contact" : "spring",
            p.text + entry("stiffness", stiffness) +
                entry("maxwell_stiffness", stiffness * log(0.1, 10)) +
                entry("maxwell_time", log(2e-4, 3e-2)));
        break;
      }
      case 7:
        add("cogging",
            p.text + entry("force", p.mass * log(1, 50)) + entry("period", log(2e-4, 3e-3)) +
                entry("position", between(-1e-3, 1e-3)) +
                "from = -2e-3\nto = 2e-3\nsegments = " + std::to_string(4 + below(10)) + "\n");
        break;
      case 8:
        add("external", "body = \"" + indexed('b', below(bodies)) + "\"\ntimes = [" +
                            number(between(0, 0.01)) + ", " + number(between(0.02, 0.03)) + ", " +
                            number(between(0.04, 0.06)) + "]\nforces = [" +
                            number(between(-30, 30)) + ", " + number(between(-30, 30)) + ", 0]\n");
        break;
      case 9: {
        const double stiffness = p.mass * log(4e4, 4e7);
        add("contact", p.text + entry("stiffness", stiffness) +
                           entry("hysteresis_stiffness", stiffness * log(0.1, 10)) +
                           entry("hysteresis_force", stiffness * log(1e-6, 1e-4)) +
                           entry("gap", zero_or(between(-2e-4, 1e-3))));
        break;
      }
      default:
        add("gravity", "body = \"" + indexed('b', below(bodies)) +
                           (chance(0.5) ? "\"\nacceleration = " + number(between(-10, 10)) + "\n"
                                        : "\"\nacceleration = [-5, 9, 2]\npositions = "
                                          "[-4.1e-4, 1.2e-4, 6.3e-4]\n"));
    }
  }
  drive();
  return text_;
}

// A structure without a rigid-body mode, whose ports continue the names of the bodies.
void Writer::structure() {
  const int ports = 1 + below(2);
  std::string names;
  for (int i = 0; i < ports; ++i)
    names += (i ? "\", \"" : "") + indexed('b', static_cast<int>(mass_.size()) + i);
  add("structure", "ports = [\"" + names + "\"]\n");
  std::vector<double> mobility(static_cast<std::size_t>(ports), 0.0);
  const int modes = ports + below(2);
  for (int k = 0; k < modes; ++k) {
    const double mass = log(0.1, 10);
    std::string shape;
    for (double &sum : mobility) {
      const double size = between(-1, 1);
      sum += size * size / mass;
      shape += (shape.empty() ? "" : ", ") + number(size);
    }
    text_ += "[[structure.mode]]\n" + entry("frequency", log(3, 150)) +
             entry("damping_ratio", zero_or(log(0.001, 0.1))) + entry("modal_mass", mass) +
             "shape = [" + shape + "]\n";
  }
  for (const double sum : mobility) mass_.push_back(1 / sum);
}

void Writer::drive() {
  const double strength = mass_[0] * log(3, 100);
  switch (below(5)) {
    case 0:
      text_ += motor_drive(
          "b0", (chance(0.5) ? entry("preamp_limit", between(2, 12)) : "") +
                    (chance(0.5) ? entry("current_feedback_limit", between(0.1, 3)) : ""));
      break;
    case 1:
      text_ += "[drive]\ntype = \"first_order\"\nbody = \"b0\"\n" + entry("k_act", mass_[0] * 30) +
               entry("a_act", log(50, 2000)) +
               entry("velocity_per_volt", strength / 10 / (mass_[0] * 30)) +
               entry("force_limit", strength * between(0.2, 1));
      break;
    case 2:
    case 3: {
      const bool torque = chance(0.5);
      const double peak = strength / 20 * between(0.2, 1);
      text_ += "[drive]\nbody = \"b0\"\nk_force = 20\n" + entry("current_bandwidth", log(300, 2e4));
      if (torque)
        text_ += "type = \"torque\"\n" + entry("current_per_volt", strength / 200) +
                 entry("damping", zero_or(mass_[0] * log(5, 100)));
      else
        text_ += "type = \"velocity\"\n" + entry("k_velocity", mass_[0] * 50) +
                 entry("velocity_per_volt", strength / 10 / (mass_[0] * 50)) +
                 entry("integral_time", log(3e-3, 0.1));
      if (chance(0.8)) {
        text_ += entry("peak_current", peak);
        if (chance(0.8))
          text_ += entry("rated_current", peak * between(0.2, 0.9)) +
                   entry("peak_time", log(1e-3, 2e-2));
      }
      break;
    }
    default:
      text_ += "[drive]\ntype = \"perfect\"\nbody = \"b0\"\n" +
               entry("force_per_volt", strength / 10) +
               (chance(0.5) ? entry("force_limit", strength * between(0.2, 1)) : "");
  }
}

// One mode, sampled.
class Sampled {
 public:
  Sampled(const Network &network, ModeKey key) {
    const ModeEquations equations = network.equations(key);
    channels = equations.channels;
    c = static_cast<std::size_t>(network.columns());
    g = channels.size();
    const auto size = static_cast<Eigen::Index>(c);
    rate_ = ExtendedMatrix::Zero(size, size);
    rate_.topRows(network.states()) = equations.flow;
    // exp(A h) - I, so that small changes keep their digits.
    const ExtendedMatrix scaled = rate_ * static_cast<Extended>(kStepS);
    ExtendedMatrix term = scaled;
    ExtendedMatrix change = term;
    for (int k = 2; k < 16; ++k) {  // |A| h is 0.02 at most: rates below 3e5 rad/s
      term = ExtendedMatrix(term * scaled) / static_cast<Extended>(k);
      change += term;
    }
    signal_ = ExtendedMatrix(static_cast<Eigen::Index>(g), size);
    for (std::size_t i = 0; i < g; ++i)
      signal_.row(static_cast<Eigen::Index>(i)) = equations.wires.row(channels[i].wire);
    ahead_.resize(kBlock * g * c);
    ExtendedMatrix so_far = change;
    for (std::size_t k = 0; k < kBlock; ++k) {
      if (k > 0) so_far = ExtendedMatrix(so_far + change + so_far * change);
      const ExtendedMatrix there = signal_ + signal_ * so_far;
      for (std::size_t j = 0; j < c; ++j)
        for (std::size_t i = 0; i < g; ++i)
          ahead_[j * kBlock * g + k * g + i] = static_cast<double>(
              there(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)));
    }
    block_.resize(c * c);
    for (std::size_t j = 0; j < c; ++j)
      for (std::size_t i = 0; i < c; ++i)
        block_[j * c + i] =
            static_cast<double>(so_far(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)));
    values.resize(kBlock * g);
    next_.resize(c);
    for (std::size_t k = 0; k < kBlock; ++k)
      for (const Channel &channel : channels) {
        low_.push_back(channel.low);
        high_.push_back(channel.high);
      }
  }

  /// The signals at the next kBlock samples.
  void compute(const std::vector<double> &z) {
    if (g > 0) multiply_(ahead_.data(), kBlock * g, z.data(), c, values.data());
  }
  /// Whether the first `count` of these samples lie within all bounds.
  bool inside(std::size_t count) const {
    int outside = 0;
    for (std::size_t i = 0; i < count * g; ++i)
      outside += (values[i] < low_[i] ? 1 : 0) + (values[i] > high_[i] ? 1 : 0);
    return outside == 0;
  }
  void step_block(std::vector<double> &z) {
    std::fill(next_.begin(), next_.end(), 0.0);
    for (std::size_t j = 0; j < c; ++j)
      for (std::size_t i = 0; i < c; ++i) next_[i] += block_[j * c + i] * z[j];
    for (std::size_t i = 0; i < c; ++i) z[i] += next_[i];
  }
  /// The flow over less than a block.
  void step(std::vector<double> &z, double time_s) const {
    Eigen::Matrix<Extended, Eigen::Dynamic, 1> term(static_cast<Eigen::Index>(c));
    for (std::size_t i = 0; i < c; ++i) term(static_cast<Eigen::Index>(i)) = z[i];
    auto sum = term;
    for (int k = 1; k < 30; ++k) {
      term = (rate_ * term).eval() * (static_cast<Extended>(time_s) / k);
      sum += term;
    }
    for (std::size_t i = 0; i < c; ++i)
      z[i] = static_cast<double>(sum(static_cast<Eigen::Index>(i)));
  }
  /// Value of a channel, its rate and the sum of its absolute terms.
  struct Signal {
    double value, rate, scale;
  };
  Signal signal(std::size_t channel, const std::vector<double> &z) const {
    Extended value = 0, rate = 0, scale = 0;
    for (std::size_t j = 0; j < c; ++j) {
      const Extended factor =
          signal_(static_cast<Eigen::Index>(channel), static_cast<Eigen::Index>(j));
      Extended slope = 0;
      for (std::size_t k = 0; k < c; ++k)
        slope += rate_(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(k)) * z[k];
      value += factor * z[j];
      rate += factor * slope;
      scale += std::fabs(factor * z[j]);
    }
    return {static_cast<double>(value), static_cast<double>(rate), static_cast<double>(scale)};
  }

  std::vector<Channel> channels;
  std::vector<double> values;  // [sample][channel]
  std::size_t c = 0, g = 0;

 private:
  ExtendedMatrix rate_;    // c x c, 1/s; the rows of 1 and u are 0
  ExtendedMatrix signal_;  // g x c
  kernel::Multiply multiply_ = kernel::best_multiply();
  std::vector<double> ahead_;
  std::vector<double> block_;
  std::vector<double> next_;
  std::vector<double> low_, high_;  // of the values
};

double rounding_of(double scale, double bound) {
  return kRounding * (scale + (std::isfinite(bound) ? std::fabs(bound) : 0.0));
}

struct Totals {
  std::int64_t ticks = 0, samples = 0, events = 0, modes = 0;
  std::set<std::string> kinds;
};

class Follower {
 public:
  Follower(const std::string &text, unsigned seed, Totals &totals)
      : random_(seed), totals_(totals), cache_(std::make_shared<ModeCache>(make_model(text))) {}

  void run(int ticks) {
    Stepper stepper(cache_, false, 1U << 20);
    std::uniform_real_distribution<double> volts(-10, 10), speed(-0.2, 0.2), chance(0, 1);
    double command = 0.0;
    largest_.assign(stepper.z().size(), 1e-6);
    stepper.step(0.0, true);  // what enabling changes is not listed
    for (int k = 0; k < ticks && !testing::Test::HasFailure(); ++k) {
      const auto &points = stepper.network().points();
      // A change by an impulse that a new command takes back at the same instant is not listed.
      if (chance(random_) < 0.5) {
        command = volts(random_);
      } else {
        for (std::size_t p = 0; p < points.size(); ++p) {
          const auto moved = static_cast<std::size_t>(points[p].front().coordinate);
          if (chance(random_) < 0.5)
            stepper.kick(p, stepper.network().coordinates()[moved].mass * speed(random_));
        }
      }
      std::vector<double> z = stepper.z();
      z.back() = command;
      ModeKey key = stepper.mode().key;
      const std::size_t seen = stepper.events().size();
      stepper.step(command, true);
      follow(stepper, key, z, seen, k + 1);
    }
    totals_.modes += static_cast<std::int64_t>(sampled_.size());
  }

 private:
  void follow(const Stepper &stepper, ModeKey key, std::vector<double> z, std::size_t seen,
              int tick) {
    const Network &network = stepper.network();
    double at = 0.0;
    for (std::size_t i = seen; i < stepper.events().size(); ++i) {
      const SwitchEvent &event = stepper.events()[i];
      const double time = event.time_s - tick * kTickS;
      dwell(key, z, at, time, tick);
      at = std::max(at, time);
      ASSERT_EQ(network.state_of(key, event.switch_index), event.from);
      reached(key, z, event, tick);
      key = network.with_state(key, event.switch_index, event.to);
      ++totals_.events;
      totals_.kinds.insert(network.switches()[static_cast<std::size_t>(event.switch_index)]
                               .state_names[static_cast<std::size_t>(event.to)]);
    }
    dwell(key, z, at, kTickS, tick);
    ASSERT_EQ(key, stepper.mode().key) << "tick " << tick;
    for (std::size_t j = 0; j < z.size(); ++j) {
      largest_[j] = std::max(largest_[j], std::fabs(z[j]));
      ASSERT_NEAR(stepper.z()[j], z[j], 1e-9 * largest_[j]) << "state " << j << ", tick " << tick;
    }
    ++totals_.ticks;
  }

  Sampled &sampled(ModeKey key) {
    const auto found = sampled_.find(key);
    return found != sampled_.end()
               ? found->second
               : sampled_.emplace(key, Sampled(cache_->network(), key)).first->second;
  }

  // From `from` to `to`, s within the tick, in one mode.
  void dwell(ModeKey key, std::vector<double> &z, double from, double to, int tick) {
    if (!(to > from)) return;
    Sampled &mode = sampled(key);
    const auto samples = static_cast<std::size_t>((to - from) / kStepS);
    totals_.samples += static_cast<std::int64_t>(samples);
    std::size_t done = 0;
    for (; done < samples; done += kBlock) {
      mode.compute(z);
      const std::size_t count = std::min(kBlock, samples - done);
      if (!mode.inside(count))
        judge(mode, z, from + static_cast<double>(done) * kStepS, from, to, count, tick);
      if (count < kBlock) break;
      mode.step_block(z);
    }
    mode.step(z, to - from - static_cast<double>(done) * kStepS);
  }

  // A violation is nothing if it is rounding or a moment at either end of the dwell.
  void judge(const Sampled &mode, const std::vector<double> &z, double start, double from,
             double to, std::size_t count, int tick) {
    for (std::size_t k = 0; k < count; ++k) {
      const double time = start + static_cast<double>(k + 1) * kStepS;
      if (time - from < kLongestViolationS || to - time < kLongestViolationS) continue;
      for (std::size_t i = 0; i < mode.g; ++i) {
        const Channel &channel = mode.channels[i];
        const double value = mode.values[k * mode.g + i];
        const double by = std::max(channel.low - value, value - channel.high);
        if (by <= 0.0) continue;
        const double scale = mode.signal(i, z).scale;
        const double bound = value < channel.low ? channel.low : channel.high;
        ASSERT_LE(by, rounding_of(scale, bound))
            << name(channel.switch_index) << " in state " << channel.state_below << ".."
            << channel.state_above << " at " << time << " s of tick " << tick << ", dwell " << from
            << ".." << to;
      }
    }
  }

  // The signal that an event is about must be at its bound or beyond.
  void reached(ModeKey key, const std::vector<double> &z, const SwitchEvent &event, int tick) {
    const Sampled &mode = sampled(key);
    for (std::size_t i = 0; i < mode.g; ++i) {
      const Channel &channel = mode.channels[i];
      if (channel.switch_index != event.switch_index) continue;
      const auto [value, rate, scale] = mode.signal(i, z);
      const double late = std::fabs(rate) * kLongestViolationS;
      if (channel.state_below == event.to && std::isfinite(channel.low) &&
          value <= channel.low + late + rounding_of(scale, channel.low))
        return;
      if (channel.state_above == event.to && std::isfinite(channel.high) &&
          value >= channel.high - late - rounding_of(scale, channel.high))
        return;
    }
    ADD_FAILURE() << name(event.switch_index) << " went from " << event.from << " to " << event.to
                  << " without cause at " << event.time_s << " s, tick " << tick;
  }

  const std::string &name(int switch_index) const {
    return cache_->network().switches()[static_cast<std::size_t>(switch_index)].element;
  }

  std::mt19937 random_;
  Totals &totals_;
  std::shared_ptr<ModeCache> cache_;
  std::map<ModeKey, Sampled> sampled_;
  std::vector<double> largest_;
};

// A share of the ticks each, so that they run side by side.
class Fuzz : public testing::TestWithParam<unsigned> {};
constexpr unsigned kShares = 4;

TEST_P(Fuzz, NoGuardIsViolatedForLongerThanANanosecond) {
  Totals totals;
  constexpr int kTicks = FORCEAXIS_FUZZ_TICKS / kShares;
  for (unsigned seed = GetParam(); totals.ticks < kTicks; seed += kShares) {
    SCOPED_TRACE("model " + std::to_string(seed));
    Writer writer(seed);
    const std::string text = writer.model();
    Follower(text, seed, totals).run(std::min(kTicks, kTicksPerModel));
    ASSERT_FALSE(HasFailure()) << text;
  }
  std::printf("%lld ticks, %lld samples, %lld events, %lld modes\n",
              static_cast<long long>(totals.ticks), static_cast<long long>(totals.samples),
              static_cast<long long>(totals.events), static_cast<long long>(totals.modes));
  EXPECT_GT(totals.samples, totals.ticks * (kSamples - 100));
  EXPECT_GT(totals.events, 0);
  if (totals.ticks < 10000) return;  // one model, too few ticks to meet everything
  EXPECT_GT(totals.events, totals.ticks / 5);
  for (const char *kind : {"pressed", "overlap", "apart", "stuck", "forward", "backward",
                           "segment 0", "segment 2", "high limit", "low outer"})
    EXPECT_EQ(totals.kinds.count(kind), 1U) << kind;
}

INSTANTIATE_TEST_SUITE_P(Seeds, Fuzz, testing::Range(0U, kShares));

}  // namespace
}  // namespace forceaxis::sim::test
