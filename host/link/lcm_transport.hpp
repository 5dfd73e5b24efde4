#pragma once
// Records as LCM messages (host/lcm/link.lcm), one channel an axis and direction. Every message
// carries the run's number; those of other runs are counted as foreign and change nothing.
#include <cstdint>
#include <memory>
#include <string>

#include "host/link/transport.hpp"

namespace forceaxis::host {

// Where a run's records go when no other place is given: a UDP multicast port of this machine that
// follows from the run's number, so that two runs seldom meet and, where they do, ignore each
// other.
std::string lcm_url_of(std::int64_t run_id);

// Throw TransportError: not an URL that LCM takes, or no route for multicast.
std::unique_ptr<PlantTransport> lcm_plant_transport(const std::string &url, std::int64_t run_id);
std::unique_ptr<AxisTransport> lcm_axis_transport(const std::string &url, std::int64_t run_id);

}  // namespace forceaxis::host
