#pragma once
// Records as LCM messages (host/lcm/link.lcm), one channel an axis and direction. Every message
// carries the run's number; those of other runs are counted as foreign and change nothing.
#include <cstdint>
#include <memory>
#include <string>

#include "host/link/transport.hpp"

namespace forceaxis::host {

// The default URL of a run: a UDP multicast port of this machine that follows from the run's
// number. Two runs seldom share a port; those that do ignore each other's records.
std::string lcm_url_of(std::int64_t run_id);

// Throw TransportError: LCM does not accept the URL, or there is no route for multicast.
std::unique_ptr<PlantTransport> lcm_plant_transport(const std::string &url, std::int64_t run_id);
std::unique_ptr<AxisTransport> lcm_axis_transport(const std::string &url, std::int64_t run_id);

}  // namespace forceaxis::host
