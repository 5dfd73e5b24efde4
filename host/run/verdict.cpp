#include "host/run/verdict.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "host/run/experiment.hpp"
#include "host/run/result.hpp"
#include "sim/hybrid/mode.hpp"
#include "sim/model/elements/contact.hpp"

namespace forceaxis::host {
namespace {

class Findings {
 public:
  void add(const char *limit, const char *verdict, double value, double bound, const char *unit) {
    missed_.push_back({limit, verdict, value, bound, unit});
  }

  void at_most(const char *limit, double value, const std::optional<double> &bound,
               const char *unit, const char *verdict = kNotMet) {
    if (bound && value > *bound) add(limit, verdict, value, *bound, unit);
  }

  // Returns the most serious verdict of all missed limits.
  Evaluation evaluation() && {
    const char *verdict = missed_.empty() ? kStable : kNotMet;
    for (const char *word : {kUnstable, kNeverInContact}) {
      const bool given = std::any_of(missed_.begin(), missed_.end(),
                                     [word](const Missed &m) { return m.verdict == word; });
      if (given) verdict = word;
    }
    return {verdict, std::move(missed_)};
  }

 private:
  std::vector<Missed> missed_;
};

bool reads_force(const Criterion &c) { return c.force_ripple_max_count || c.limits_force(); }

// Checks the contact. Returns true if the axis still approached the contact during the window. In
// this case, ripple and contact losses are not signs of instability.
bool check_contact(const Criterion &c, const Metrics &m, Findings &found) {
  const bool asked = c.contact_held || (m.held_force && reads_force(c) && m.contacts > 0);
  if (!asked) return false;
  if (!m.first_contact_s) {
    found.add("contact_held", kNeverInContact, 0.0, 1.0, "");
    return true;
  }
  const double begin_s = m.window_start_s;
  const bool late = begin_s > 0.0 && *m.first_contact_s > begin_s;
  const char *word = late ? kNotMet : kUnstable;
  if (late) found.add("contact_made_s", kNotMet, *m.first_contact_s, begin_s, "s");
  if (m.contact_losses > 0)
    found.add("contact_losses", word, static_cast<double>(m.contact_losses), 0.0, "");
  else if (c.contact_held && !m.in_contact)
    found.add("contact_held", kUnstable, 0.0, 1.0, "");
  else if (c.contact_held && !late && begin_s > 0.0 && !m.contact_at_window)
    found.add("contact_held", kNotMet, 0.0, 1.0, "");
  return late;
}

void check_ripple(const char *limit, const Ripple &ripple, const std::optional<double> &bound,
                  bool approaching, Findings &found) {
  const bool dies = ripple.late_count <= kDyingPart * ripple.count;
  found.at_most(limit, ripple.count, bound, "count", dies || approaching ? kNotMet : kUnstable);
}

void check_force(const Criterion &c, const HeldForce &held, double peak_N, Findings &found) {
  found.at_most("held_force_error_max_N", std::fabs(held.error_N), c.held_force_error_max_N, "N");
  found.at_most("held_force_error_max_percent", held.error_percent, c.held_force_error_max_percent,
                "%");
  found.at_most("overshoot_max_percent", held.overshoot_percent, c.overshoot_max_percent, "%");
  found.at_most("settle_max_s", held.settle_s, c.settle_max_s, "s");
  found.at_most("peak_force_max_percent", 100.0 * std::fabs(peak_N / held.setpoint_N),
                c.peak_force_max_percent, "%");
}

void check_arrival(const Criterion &c, const Metrics &m, Findings &found) {
  if (m.position_error_count)
    found.at_most("position_error_max_count", std::fabs(*m.position_error_count),
                  c.position_error_max_count, "count");
  else if (c.position_error_max_count)
    found.add("position_setpoint", kNotMet, 0.0, *c.position_error_max_count, "count");
}

}  // namespace

Evaluation evaluate(const Criterion &c, const Metrics &m, bool faulted) {
  Findings found;
  if (faulted) found.add("fault", kUnstable, 1.0, 0.0, "");
  const bool approaching = check_contact(c, m, found);
  check_ripple("force_ripple_max_count", m.force_ripple, c.force_ripple_max_count, approaching,
               found);
  check_ripple("position_ripple_max_count", m.position_ripple, c.position_ripple_max_count,
               approaching, found);
  check_arrival(c, m, found);
  if (m.held_force)
    check_force(c, *m.held_force, m.peak_force_N, found);
  else if (c.limits_force())
    found.add("setpoint", kNotMet, 0.0, 0.0, "N");
  found.at_most("peak_force_max_N", m.peak_force_N, c.peak_force_max_N, "N");
  found.at_most("contact_losses_max", static_cast<double>(m.contact_losses_run),
                c.contact_losses_max, "");
  found.at_most("saturated_max_s", static_cast<double>(m.saturated_run_ticks) / sim::kTickRateHz,
                c.saturated_max_s, "s");
  if (m.reading_range_ticks > 0 && (reads_force(c) || (c.contact_held && m.held_force)))
    found.add("reading_range", kNotMet, static_cast<double>(m.reading_range_ticks), 0.0, "tick");
  if (m.setpoint_beyond_N && (reads_force(c) || c.contact_held))
    found.add("setpoint_range", kNotMet, *m.setpoint_beyond_N, m.reading_end_N, "N");
  if (m.saturated_ticks > 0)
    found.add("output_range", kNotMet, static_cast<double>(m.saturated_ticks), 0.0, "tick");
  return std::move(found).evaluation();
}

}  // namespace forceaxis::host
