#include "sim/model/elements/structure.hpp"

#include <algorithm>

#include "sim/model/read.hpp"

namespace forceaxis::sim {

void Structure::Mode::complete(Section &section, Names &) {
  if (frequency_hz == 0.0 && damping_ratio > 0.0)
    section.fail("damping_ratio", "expected 0 beside the frequency 0, got " +
                                      number_text(damping_ratio) +
                                      "; remove this key, a [[damper]] can damp a rigid body");
}

void Structure::complete(Section &section, Names &names) {
  if (modes.empty())
    section.fail("mode", "expected at least one mode, got none; add [[structure.mode]]");
  for (std::size_t i = 0; i < modes.size(); ++i)
    if (modes[i].shape.size() != ports.size())
      section.fail("mode[" + std::to_string(i) + "].shape",
                   "expected " + std::to_string(ports.size()) +
                       " values, one for each of ports, got " +
                       std::to_string(modes[i].shape.size()) + "; add or remove values");
  for (std::size_t port = 0; port < ports.size(); ++port) {
    const std::string key = "ports[" + std::to_string(port) + "]";
    names.claim(section, key, ports[port]);
    if (std::all_of(modes.begin(), modes.end(),
                    [&](const Mode &mode) { return mode.shape[port] == 0.0; }))
      section.fail(key, "expected a port that a mode moves, got " + in_quotes(ports[port]) +
                            ", whose shape is 0 in each mode; remove this port");
  }
}

}  // namespace forceaxis::sim
