#pragma once
// What a run is beside what its [verdict] asks for: one of four words, and every limit missed.
//
//   stable            nothing is missed
//   unstable          a fault, a ripple that does not die away, or contact lost in the window
//   not_met           none of these, but a limit is exceeded, the contact is made too late, or the
//                     force reading or the output is at an end of its range in the window
//   never_in_contact  the force was to be put on a contact that was never pressed
//
// A verdict that is about the contact is one with `contact_held`, and one of an experiment that
// controls force and judges the reading or the force.
#include <string>
#include <vector>

namespace forceaxis::host {

struct Criterion;
struct Metrics;

inline constexpr const char *kStable = "stable";
inline constexpr const char *kUnstable = "unstable";
inline constexpr const char *kNotMet = "not_met";
inline constexpr const char *kNeverInContact = "never_in_contact";

// A ripple whose second half of the window has at most this part of it dies away.
inline constexpr double kDyingPart = 0.6;

// One limit that a run missed. Besides the keys of [verdict]: "fault", "contact_made_s" (value:
// when the contact was first pressed, bound: when the window begins), "contact_losses" (in the
// window), "setpoint" (none of force), "setpoint_range" (N, and the end of the reading that it is
// beyond), "reading_range" and "output_range" (ticks of the window at an end of the range).
struct Missed {
  std::string limit;
  std::string verdict;  // what it alone makes of the run
  double value = 0.0;   // infinite: the force never settles
  double bound = 0.0;
  std::string unit;  // "N", "%", "s", "count", "tick", or "" of a number
};

struct Judgement {
  std::string verdict;  // kNeverInContact, else kUnstable, else kNotMet, as any limit says
  std::vector<Missed> missed;
};

// From metrics alone, so that thresholds can be varied without a run.
Judgement judge(const Criterion &criterion, const Metrics &metrics, bool faulted);

}  // namespace forceaxis::host
