#pragma once
// The verdict of a run by the limits in the table [verdict], and all limits that the run has
// missed.
//
//   stable            no limit is missed
//   unstable          a fault, a ripple that does not decay, or contact loss in the window
//   not_met           not unstable, but a limit is exceeded, the contact is made too late, or the
//                     measured force or the output is at an end of its range in the window
//   never_in_contact  the criterion needs a contact, and this contact was never made
//
// The criterion needs a contact in two cases: the table has `contact_held`, or the experiment
// controls force and the table limits the measured force or the force ripple.
#include <string>
#include <tuple>
#include <vector>

#include "host/run/item.hpp"

namespace forceaxis::host {

struct Criterion;
struct Metrics;

inline constexpr const char *kStable = "stable";
inline constexpr const char *kUnstable = "unstable";
inline constexpr const char *kNotMet = "not_met";
inline constexpr const char *kNeverInContact = "never_in_contact";

// A ripple decays if its value in the second half of the window is at most kDyingPart times its
// value in the complete window.
inline constexpr double kDyingPart = 0.6;

// One limit that a run missed. `limit` is a key of [verdict] or one of these names:
//   fault             the firmware had a fault
//   contact_made_s    the contact was made too late; value: time of the first contact in s, bound:
//                     start of the time window
//   contact_losses    a contact opened in the time window
//   setpoint          the experiment has no force set-point
//   position_setpoint the experiment has no position set-point
//   setpoint_range    value: set-point in N, bound: end of the measuring range
//   reading_range     ticks of the time window with the force reading at an end of its range
//   output_range      ticks of the time window with the output at an end of its range
struct Missed {
  static constexpr const char *kName = "MissedLimit";
  static constexpr const char *kMeaning = "A limit of [verdict] that a run exceeds.";
  std::string limit;
  std::string verdict;
  double value = 0.0;
  double bound = 0.0;
  std::string unit;

  static constexpr auto items() {
    return std::tuple{
        item("limit", &Missed::limit, "key of [verdict], or the name of another condition"),
        item("verdict", &Missed::verdict, "verdict that this missed limit alone would give"),
        item("value", Finite{&Missed::value},
             "value of the run; None if the force does not settle, so that the value is infinite"),
        item("bound", &Missed::bound),
        item("unit", &Missed::unit, "unit of the limit: N, %, s, count, tick, or empty")};
  }
};

struct Evaluation {
  // The most serious verdict of all missed limits: kNeverInContact, then kUnstable, then kNotMet.
  std::string verdict;
  std::vector<Missed> missed;
};

// Computes the verdict from the metrics of a run. A change of the limits needs no new run.
Evaluation evaluate(const Criterion &criterion, const Metrics &metrics, bool faulted);

}  // namespace forceaxis::host
