#pragma once
// The command line of the gateway.
#include <CLI/CLI.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "host/nodes/gateway_axis.hpp"

namespace forceaxis::nodes {

// What only the command line can get wrong: exit status 2.
struct GatewayUsage : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct GatewayOptions {
  std::string can = "vcan0";
  std::string axes = "1";
  std::string lcm_url;
  std::string modbus_address = "127.0.0.1";
  int modbus_port = 1502;
  int node_id = 127;
  double sync_hz = 50;
  int heartbeat_ms = 100;
  int watch_ms = 0;
  int sdo_timeout_ms = 500;
  std::vector<std::string> sets;

  // Complete after finish_gateway_options().
  std::vector<AxisSettings> settings;
};

void add_gateway_options(CLI::App &app, GatewayOptions &options);
// Throws GatewayUsage.
void finish_gateway_options(GatewayOptions &options);

}  // namespace forceaxis::nodes
