#include "sim/hybrid/stepper.hpp"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

#include "sim/hybrid/kernel.hpp"

namespace forceaxis::sim {
namespace {

using kernel::dot;
using kernel::magnitude;

constexpr int kMostChangesPerTick = 5000;
// Largest number of switch changes in one call of settle().
constexpr int kMostChangesPerInstant = 1000;
// Length of the period that is simulated without changes of switches after states contradicted each
// other, as a fraction of Mode::reach.
constexpr double kMoment = 0x1p-20;
// Factor by which the assumed rounding error increases each time that the states of switches
// contradict each other.
constexpr double kDoubtGrowth = 4.0;
// Largest argument of set_doubt(), for an assumed rounding error of 1.5e-11 of the state.
constexpr double kMostDoubt = 0x1p10;
constexpr std::size_t kRecentModes = 64;
// The quadratic forms of a mode are built after its energy was summed over this number of grid
// parts. To build these forms takes as much time as these sums.
constexpr int kPartsWithoutForms = 256;

constexpr double kNever = std::numeric_limits<double>::infinity();
// Largest relative difference of the velocities of a friction's ends that is attributed to
// rounding. With at most this difference, the ends stick.
constexpr double kSame = 0x1p-36;

double smaller(double a, double b) { return a < b ? a : b; }

}  // namespace

Stepper::Stepper(std::shared_ptr<ModeCache> cache, bool audit, std::size_t listed_events,
                 const std::vector<double> &start)
    : cache_(std::move(cache)),
      audit_(audit),
      energy_(cache_->network()),
      listed_events_(listed_events),
      recent_(kRecentModes) {
  const Network &net = network();
  z_ = net.initial();
  for (std::size_t i = 0; i < start.size() / 2; ++i) {
    const auto &coordinate = net.coordinates()[i];
    z_[static_cast<std::size_t>(coordinate.position)] = start[2 * i];
    z_[static_cast<std::size_t>(coordinate.velocity)] = start[2 * i + 1];
  }
  z_.push_back(1.0);
  z_.push_back(0.0);
  for (const Network::Switch &s : net.switches())
    count_stride_ = std::max(count_stride_, s.state_names.size());
  counts_.assign(net.switches().size() * count_stride_ * count_stride_, 0);
  brake_due_.assign(net.brakes().size(), kNever);
  set_mode(net.home_key(false));
  check_finite();
  slide(false);
  settle(false);
  energy_.begin();  // The sums of the energies begin here, because the first mode is known.
}

void Stepper::set_mode(ModeKey key) {
  Recent &slot = recent_[((key * 0x9E3779B97F4A7C15ULL) >> 58) % kRecentModes];
  if (slot.mode == nullptr || slot.key != key) {
    slot.mode = &cache_->mode(key);
    slot.forms = nullptr;
    slot.parts = 0;
    slot.key = key;
    const std::size_t chain = (slot.mode->order + 1) * slot.mode->flow_stride;
    if (chain_.size() < chain) chain_.resize(chain);
    if (increment_.size() < slot.mode->flow_stride) increment_.resize(slot.mode->flow_stride);
  }
  mode_ = slot.mode;
  detector_.enter(*mode_);
  current_ = &slot;
  energy_.enter(*mode_);
}

void Stepper::check_finite() const {
  for (const double value : z_)
    if (!(magnitude(value) < 1e100))
      throw SimulationError("the plant's state left all bounds at t = " +
                            std::to_string(static_cast<double>(tick_) / cache_->rate_hz()) +
                            " s: the loop is unstable; lower the gain or check the model");
}

void Stepper::fail_switching(int switch_index, double s) const {
  throw SimulationError(
      network().switches()[static_cast<std::size_t>(switch_index)].element +
      " keeps switching without end at t = " +
      std::to_string((static_cast<double>(tick_) + s) / cache_->rate_hz()) +
      " s: the states of this element contradict each other; change the parameters of this "
      "element or of its neighbours");
}

void Stepper::switch_drive(double command, bool enable) {
  const double before = audit_ ? energy_.stored(z_.data()) : 0.0;
  if (!enable)
    for (const int state : network().drive_states()) z_[static_cast<std::size_t>(state)] = 0.0;
  z_[mode_->states + 1] = command;
  set_mode(network().with_enable(mode_->key, enable));
  if (audit_) energy_.discard(before - energy_.stored(z_.data()));
  settle(false);
}

void Stepper::step(double command, bool enable, bool release) {
  const std::size_t n = mode_->states;
  if (!brake_due_.empty()) {
    command_brakes(release);
    if (std::any_of(brake_due_.begin(), brake_due_.end(), [](double due) { return due < 1.0; })) {
      hold(command, enable);
      step_in_parts(nullptr);
      return;
    }
    for (double &due : brake_due_) due -= 1.0;
  }
  if (Network::enabled(mode_->key) != enable) {
    switch_drive(command, enable);
  } else if (sensors_in_result_ && detector_.beyond_after(command - z_[n + 1])) {
    // This test only saves the time of a quiet test that would fail. settle() decides whether a
    // switch changes.
    z_[n + 1] = command;
    settle(true);
  }
  z_[n + 1] = command;
  if (!detector_.quiet(z_.data())) {
    // The step of the command can have moved signals outside their bounds.
    sensors_in_result_ = false;
    const bool quiet = detector_.beyond_now() && (settle(true), detector_.quiet(z_.data()));
    if (!quiet && cross(0.0, 1.0)) {
      ++tick_;
      return;
    }
  }
  if (audit_) audit_whole(0);
  const double *next = detector_.result();
  for (std::size_t i = 0; i < n; ++i) z_[i] = next[i];
  sensors_in_result_ = true;
  ++tick_;
}

void Stepper::step(double command, bool enable, bool release, Pauses &pauses) {
  if (!(pauses.next() < 1.0)) {
    step(command, enable, release);
    return;
  }
  command_brakes(release);
  hold(command, enable);
  step_in_parts(&pauses);
}

// Starts the release or engage times of all brakes if their command has changed, `at` ticks after
// the start of the present tick.
void Stepper::command_brakes(bool release, double at) {
  if (release == release_) return;
  release_ = release;
  for (std::size_t i = 0; i < brake_due_.size(); ++i) {
    const Wiring::BrakeTimes &times = network().brakes()[i];
    brake_due_[i] = at + (release ? times.release_s : times.engage_s) * cache_->rate_hz();
  }
}

void Stepper::hold(double command, bool enable) {
  if (Network::enabled(mode_->key) != enable) {
    switch_drive(command, enable);
  } else {
    z_[mode_->states + 1] = command;
    settle(true);
  }
  sensors_in_result_ = false;
}

const double *Stepper::sensors() {
  if (sensors_in_result_) return detector_.result() + mode_->states;
  multiply_(mode_->sensor.data(), kernel::padded(2), z_.data(), mode_->columns, sensors_);
  return sensors_;
}

// Changes the state of every switch whose signal is outside its bounds by more than rounding, in
// the order of dependence, until no such signal is left. If a signal is on its bound, within
// rounding, its switch does not change here, because Detector::examine() decides by the next
// derivative of the signal.
void Stepper::settle(bool count_jumps) {
  int changes = 0;
  for (std::size_t i = 0; i < mode_->channels; ++i) {
    const Mode &m = *mode_;
    const Channel &channel = m.channel[i];
    const double value = dot(&m.signal[i * m.columns], z_.data(), m.columns);
    if (value >= m.low[i] && value <= m.high[i]) continue;
    const double *doubt = &m.doubt[i * (m.order + 1) * m.columns];
    double scale = 0.0;
    for (std::size_t j = 0; j < m.columns; ++j) scale += doubt[j] * magnitude(z_[j]);
    const bool below = value < channel.low - kChannelRounding * (scale + magnitude(channel.low));
    const bool above = value > channel.high + kChannelRounding * (scale + magnitude(channel.high));
    if (!below && !above) continue;
    if (++changes > kMostChangesPerInstant) fail_switching(channel.switch_index, 0.0);
    // In the new mode, this switch has other channels. The loop continues at the first channel of
    // this switch. Earlier channels belong to switches that do not depend on this switch.
    const int moved = channel.switch_index;
    change(i, above, 0.0, true, count_jumps);
    while (i > 0 && mode_->channel[i - 1].switch_index >= moved) --i;
    --i;
  }
}

// Computes the Taylor coefficients of the state at this instant. The unit of time is the tick.
void Stepper::expand() {
  const Mode &m = *mode_;
  for (std::size_t i = 0; i < m.states; ++i) chain_[i] = z_[i];
  multiply_(m.taylor.data(), m.order * m.flow_stride, z_.data(), m.columns,
            chain_.data() + m.flow_stride);
}

// Computes the state `s` ticks later, with s at most Mode::reach. To be called after expand().
void Stepper::evaluate(double s) {
  const Mode &m = *mode_;
  // Each power s^k is the product of two lower powers, so consecutive products do not depend on
  // each other.
  powers_[0] = s;
  for (std::size_t k = 2; k <= m.order; ++k)
    powers_[k - 1] = powers_[k / 2 - 1] * powers_[(k + 1) / 2 - 1];
  // The sum of all terms from k = 1 is computed first, so that only the last addition has a
  // rounding error of the size of the state.
  multiply_(chain_.data() + m.flow_stride, m.flow_stride, powers_, m.order, increment_.data());
  for (std::size_t i = 0; i < m.states; ++i) z_[i] = chain_[i] + increment_[i];
}

// Advances the state by a time of at most Mode::reach ticks with the Taylor series.
void Stepper::advance_within_part(double ticks) {
  expand();
  if (audit_) energy_.add_part(z_.data(), chain_.data(), ticks, cache_->rate_hz());
  evaluate(ticks);
}

// Advances the state by a time in ticks. Complete pieces or parts of the grid use a flow matrix;
// the remaining time uses the Taylor series.
void Stepper::advance(double ticks) {
  const Mode &m = *mode_;
  if (m.pieces) {
    advance_pieces(ticks);
    return;
  }
  const auto parts = static_cast<std::size_t>(ticks / m.reach);
  if (parts > 0) {
    if (audit_) audit_grid(parts);
    multiply_(&m.grid_flow[(parts - 1) * m.flow_stride * m.columns], m.flow_stride, z_.data(),
              m.columns, increment_.data());
    for (std::size_t i = 0; i < m.states; ++i) z_[i] = increment_[i];
  }
  const double left = ticks - static_cast<double>(parts) * m.reach;
  if (left > 0.0) advance_within_part(left);
}

// Returns the index of the brake that changes its state next in this tick, or the number of brakes
// if no brake changes.
std::size_t Stepper::next_brake() const {
  std::size_t next = brake_due_.size();
  for (std::size_t i = 0; i < brake_due_.size(); ++i)
    if (brake_due_[i] < 1.0 && (next == brake_due_.size() || brake_due_[i] < brake_due_[next]))
      next = i;
  return next;
}

// Simulates a tick in which brakes are released or engaged, or in which the caller needs the state
// at instants of `pauses`, which may be nullptr. To be called after hold().
void Stepper::step_in_parts(Pauses *pauses) {
  double done = 0.0;
  for (;;) {
    const std::size_t next = next_brake();
    double until = next < brake_due_.size() ? std::max(brake_due_[next], done) : 1.0;
    const double paused = pauses != nullptr ? pauses->next() : kNever;
    const bool pausing = paused < until;
    if (pausing) until = paused;
    if (until > done && !(detector_.quiet(z_.data()), cross(done, until))) advance(until - done);
    done = until;
    if (pausing) {
      pauses->pause();
      continue;
    }
    if (next == brake_due_.size()) break;
    brake_due_[next] = kNever;
    move_brake(next, done);
  }
  for (double &due : brake_due_) due -= 1.0;
  ++tick_;
}

// Releases or engages a brake. If the ends have different velocities when the brake engages, the
// brake slides.
void Stepper::move_brake(std::size_t brake, double s) {
  const auto place = static_cast<std::size_t>(network().brakes()[brake].friction);
  const Wiring::FrictionEnds &friction = network().frictions()[place];
  const int from = network().state_of(mode_->key, friction.switch_index);
  if (release_ == (from == Wiring::kReleased)) return;
  switch_to(friction.switch_index, release_ ? int{Wiring::kReleased} : sliding(friction), s, false,
            true);
}

// Returns the state of a friction that follows from the velocities of its ends.
int Stepper::sliding(const Wiring::FrictionEnds &friction) const {
  double size = 0.0;
  const auto velocity = [&](const std::vector<Wiring::StateShare> &shares) {
    double sum = 0.0;
    for (const Wiring::StateShare &share : shares) {
      const double part =
          static_cast<double>(share.factor) * z_[static_cast<std::size_t>(share.state)];
      sum += part;
      size += magnitude(part);
    }
    return sum;
  };
  const double a = velocity(friction.velocity_a);
  const double b = velocity(friction.velocity_b);
  if (!(magnitude(a - b) > kSame * size)) return Wiring::kStuck;
  return a > b ? Wiring::kForward : Wiring::kBackward;
}

// Searches the next `rest` ticks of a mode without pieces, but at most Mode::grid parts. `quiet` is
// the result of the quiet test. Returns false if no switch changes in a whole tick; the detector
// then has the state at the end of the tick.
bool Stepper::cross_grid(double rest, bool quiet, bool whole, Progress *progress) {
  const Mode &m = *mode_;
  // Number of parts of the grid up to the end of this tick. The last part can be incomplete.
  const double places = rest / m.reach;  // the division by m.reach, a power of two, has no rounding
                                         // error
  std::size_t parts = m.grid;
  if (places < static_cast<double>(parts)) {
    parts = static_cast<std::size_t>(places);
    if (static_cast<double>(parts) < places) ++parts;
  }
  const double covered = smaller(static_cast<double>(parts) * m.reach, rest);
  std::uint64_t doubtful = 0;
  if (!quiet) {
    const bool calm_first = whole && detector_.expects_calm();
    if (calm_first && detector_.calm(z_.data())) return false;
    doubtful = detector_.doubtful_parts(z_.data(), parts);
    if (whole && covered == 1.0 && (doubtful == 0 || (!calm_first && detector_.calm(z_.data())))) {
      detector_.expect_calm();
      return false;
    }
  }
  // A part in which a switch can change uses the Taylor series even if no switch changes in this
  // part, because the rounding error of the series is smaller than that of the flow matrix.
  double passed = 0.0;
  for (; doubtful != 0; doubtful &= doubtful - 1) {
    const auto part = static_cast<std::size_t>(std::countr_zero(doubtful));
    const double start = static_cast<double>(part) * m.reach;
    if (start > passed) advance(start - passed);
    passed = start;
    const double end = smaller(m.reach, rest - start);
    progress->changed = detector_.first_change(z_.data(), part, end, &progress->next);
    if (progress->changed) break;
    advance_within_part(end);
    passed = smaller(start + m.reach, rest);
  }
  if (!progress->changed) {
    if (covered > passed) advance(covered - passed);
    passed = covered;
  } else if (progress->next.after > 0.0) {
    advance_within_part(progress->next.after);
    passed += progress->next.after;
  }
  progress->passed = passed;
  return true;
}

// Advances the state by one piece of 2^-k ticks, whose end is `end`.
void Stepper::end_piece(std::size_t k, const double *end) {
  if (audit_) audit_whole(k);
  for (std::size_t i = 0; i < mode_->states; ++i) z_[i] = end[i];
}

// Advances the state by `rest` ticks in pieces in which no switch changes.
Stepper::Progress Stepper::advance_pieces(double rest) {
  const Mode &m = *mode_;
  double left = rest;
  double length = 1.0;
  for (std::size_t k = 0; k <= m.pieces->halvings; ++k, length *= 0.5) {
    if (left < length) continue;
    end_piece(k, detector_.end_of_piece(z_.data(), k));
    left -= length;
  }
  if (left > 0.0) advance_within_part(left);
  return {rest, false, {}};
}

// Returns the longest piece that can start at `place` and is at most `left` ticks long, unless the
// finest piece is longer. A piece starts only at a multiple of its length. A longer piece that
// contains this start has failed the test before.
static std::size_t longest_piece(const Pieces &pieces, std::uint64_t place, double left) {
  const auto zeros = static_cast<std::size_t>(std::countr_zero(place));
  std::size_t k = place == 0 ? 0 : pieces.halvings - zeros;
  while (k < pieces.halvings && Pieces::length(k) > left) ++k;
  return k;
}

// Searches the next `rest` ticks of a mode with pieces, up to the first change of a switch.
Stepper::Progress Stepper::cross_pieces(double rest) {
  const Mode &m = *mode_;
  const std::size_t halvings = m.pieces->halvings;
  std::uint64_t place = 0;  // time from the begin of the tick to the next piece; the unit is the
                            // length of the smallest piece
  for (;;) {
    const double done = static_cast<double>(place) * m.reach;
    const double left = rest - done;
    if (!(left > 0.0)) return {rest, false, {}};
    std::size_t k = longest_piece(*m.pieces, place, left);
    detector_.start_piece(z_.data());
    bool passes = detector_.passes_piece(z_.data(), k);
    while (!passes && k < halvings) passes = detector_.passes_piece(z_.data(), ++k);
    const double end = smaller(m.reach, left);
    if (passes && left >= Pieces::length(k)) {
      end_piece(k, detector_.result());
      place += std::uint64_t{1} << (halvings - k);
      continue;
    }
    Progress progress{done, false, {}};
    if (!passes && detector_.first_change(z_.data(), 0, end, &progress.next)) {
      progress.changed = true;
      if (progress.next.after > 0.0) advance_within_part(progress.next.after);
      progress.passed += progress.next.after;
      return progress;
    }
    advance_within_part(end);
    ++place;
  }
}

// Simulates the time `from` to `until` of a tick, after the quiet test has failed or if brakes
// change in this tick. Returns false if no switch changes in the complete tick. The detector then
// has the state at the end of the tick.
bool Stepper::cross(double from, double until) {
  check_finite();
  double done = from;  // time that has passed since the start of the tick, in ticks
  bool quiet = false;
  int changes = 0;
  int changes_here = 0;
  double doubt = 1.0;
  detector_.set_doubt(doubt);
  // Largest number of switch changes at one instant, which is several times the number of switches.
  const int enough_here = 16 + 4 * static_cast<int>(network().switches().size());
  for (;;) {
    const Mode &m = *mode_;
    const double rest = until - done;
    if (changes_here >= enough_here) {
      // Some signals are on their bounds, and the Taylor coefficients that decide are about as
      // large as the rounding error: larger in one mode and smaller in the next mode. An example is
      // a body that comes to rest slowly while the sum of the other forces on it approaches its
      // friction. In the sliding mode, the velocity of the body is within rounding, and a higher
      // derivative stops the body. In the sticking mode, the force on the body is above rounding,
      // and the body slides again. The assumed rounding error is then increased until the tick ends
      // or both modes agree. The effect of the wrong mode during this time is far below one code.
      // If the states still contradict each other at the largest rounding error, the number of
      // changes reaches its limit and the run ends with an error.
      const double moment = smaller(rest, kMoment * m.reach);
      advance_within_part(moment);
      done = moment < rest ? done + moment : until;
      doubt = smaller(kDoubtGrowth * doubt, kMostDoubt);
      detector_.set_doubt(doubt);
      changes_here = 0;
    } else {
      Progress progress;
      if (m.pieces)
        progress = quiet ? advance_pieces(rest) : cross_pieces(rest);
      else if (!cross_grid(rest, quiet, from == 0.0 && rest == 1.0, &progress))
        return false;
      if (progress.passed > 0.0) {
        done = progress.passed < rest ? done + progress.passed : until;
        changes_here = 0;
      }
      if (progress.changed) {
        const Detector::Change &next = progress.next;
        const int switch_index = m.channel[next.channel].switch_index;
        if (++changes > kMostChangesPerTick) fail_switching(switch_index, done);
        ++changes_here;
        change(next.channel, next.above, done, false, true);
      }
    }
    if (!(done < until)) return true;
    quiet = detector_.quiet(z_.data());
  }
}

void Stepper::change(std::size_t channel, bool above, double s, bool jump, bool counted) {
  const Channel &crossed = mode_->channel[channel];
  switch_to(crossed.switch_index, above ? crossed.state_above : crossed.state_below, s, jump,
            counted);
}

void Stepper::switch_to(int index, int to, double s, bool jump, bool counted) {
  const int from = network().state_of(mode_->key, index);
  const double before = audit_ ? energy_.stored(z_.data()) : 0.0;
  set_mode(network().with_state(mode_->key, index, to));
  // When a friction begins to stick, its relative velocity differs from 0 by the rounding error of
  // the instant. This difference is removed.
  const std::size_t n = mode_->states;
  if (to == network().switches()[static_cast<std::size_t>(index)].stuck) {
    for (std::size_t i = 0; i < n; ++i) increment_[i] = dot(&mode_->slip[i * n], z_.data(), n);
    for (std::size_t i = 0; i < n; ++i) z_[i] -= increment_[i];
  }
  if (audit_) energy_.discard(before - energy_.stored(z_.data()));
  if (!counted) return;
  const double time_s = (static_cast<double>(tick_) + s) / cache_->rate_hz();
  // If a change is reversed at the same instant, neither change is counted.
  if (last_.switch_index == index && last_.time_s == time_s && last_.from == to &&
      last_.to == from && last_.jump == jump) {
    --(jump ? jumps_ : crossings_);
    --counts_[count_place(index, to, from)];
    if (last_listed_) events_.pop_back();
    last_.switch_index = -1;
    last_listed_ = false;
    return;
  }
  ++(jump ? jumps_ : crossings_);
  ++counts_[count_place(index, from, to)];
  last_ = {time_s, index, from, to, jump};
  last_listed_ = events_.size() < listed_events_;
  if (last_listed_) events_.push_back(last_);
}

void Stepper::kick(std::size_t point, double impulse) {
  for (const Wiring::Share &share : network().points()[point]) {
    const Wiring::Coordinate &moved =
        network().coordinates()[static_cast<std::size_t>(share.coordinate)];
    double &velocity = z_[static_cast<std::size_t>(moved.velocity)];
    const double before = velocity;
    velocity += share.factor * impulse / moved.mass;
    energy_.add_impulse(0.5 * moved.mass * (velocity - before) * (velocity + before));
  }
  sensors_in_result_ = false;
  slide(true);
  settle(true);
}

// After an impulse, each friction slides if its ends have different velocities.
void Stepper::slide(bool counted) {
  for (const Wiring::FrictionEnds &friction : network().frictions()) {
    const int state = sliding(friction);
    const int before = network().state_of(mode_->key, friction.switch_index);
    if (state != Wiring::kStuck && before != state && before != Wiring::kReleased)
      switch_to(friction.switch_index, state, 0.0, true, counted);
  }
}

std::size_t Stepper::count_place(int switch_index, int from, int to) const {
  const std::size_t row =
      static_cast<std::size_t>(switch_index) * count_stride_ + static_cast<std::size_t>(from);
  return row * count_stride_ + static_cast<std::size_t>(to);
}

std::int64_t Stepper::count(int switch_index, int from, int to) const {
  return counts_[count_place(switch_index, from, to)];
}

// Adds the energies of complete parts of the grid. The energy integrals need a Taylor expansion in
// each part; the flow matrix does not.
void Stepper::audit_grid(std::size_t parts) {
  const std::vector<double> start = z_;
  for (std::size_t k = 0; k < parts; ++k) {
    expand();
    energy_.add_part(z_.data(), chain_.data(), mode_->reach, cache_->rate_hz());
    evaluate(mode_->reach);
  }
  z_ = start;
}

// Adds the energies of 2^-halvings ticks. The forms of a mode take as long to build as the sums
// over kPartsWithoutForms parts of the grid, so they are built only after this number of parts. A
// mode with pieces has no grid.
void Stepper::audit_whole(std::size_t halvings) {
  if (current_->forms == nullptr) {
    if (mode_->grid > 0 && current_->parts < kPartsWithoutForms) {
      const auto parts = static_cast<int>(1.0 / mode_->reach);
      audit_grid(static_cast<std::size_t>(parts));
      current_->parts += parts;
      return;
    }
    current_->forms = &cache_->energy_forms(mode_->key);
  }
  energy_.add_whole(*current_->forms, z_.data(), halvings);
}

double Stepper::kinetic() const {
  double sum = 0.0;
  for (const Wiring::Coordinate &moved : network().coordinates()) {
    const double v = z_[static_cast<std::size_t>(moved.velocity)];
    sum += 0.5 * moved.mass * v * v;
  }
  return sum;
}

}  // namespace forceaxis::sim
