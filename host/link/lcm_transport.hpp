#pragma once
// Sends records as LCM messages (host/lcm/link.lcm). Each axis and direction has one channel. Every
// message contains the run number. Messages of other runs are counted as foreign and have no
// effect.
#include <cstdint>
#include <memory>
#include <string>

#include "host/link/transport.hpp"

namespace forceaxis::host {

// Returns the default URL of a run: a UDP multicast port of this machine, computed from the run
// number. Two runs seldom have the same port. If two runs have the same port, each run ignores the
// records of the other run.
std::string lcm_url_of(std::int64_t run_id);

// Open the plant's end or the firmware's end of the link. Throw TransportError if LCM refuses the
// URL or the machine has no route for multicast.
std::unique_ptr<PlantTransport> lcm_plant_transport(const std::string &url, std::int64_t run_id);
std::unique_ptr<AxisTransport> lcm_axis_transport(const std::string &url, std::int64_t run_id);

}  // namespace forceaxis::host
