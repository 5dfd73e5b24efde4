#pragma once
// The command line of the gateway.
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "host/gateway/axis.hpp"
#include "host/program/program.hpp"

namespace forceaxis::nodes {

struct GatewayOptions {
  std::string can = "vcan0";
  std::string axes = "1";
  std::string lcm_url;
  std::vector<std::string> lcm_remote;
  std::string modbus_address = "127.0.0.1";
  int modbus_port = 1502;
  int node_id = AXIS_GATEWAY_NODE_ID;
  double sync_hz = 50;
  int heartbeat_ms = 100;
  int watch_ms = 0;
  int sdo_timeout_ms = 500;
  std::vector<std::string> sets;

  // Settings of all axes, which finish_gateway_options() derives from the options.
  std::vector<AxisSettings> settings;
  std::vector<lcm_bus::Network> remote;
};

void add_gateway_options(CLI::App &app, GatewayOptions &options);
// Checks the options and derives the settings of the axes from the options. Throws UsageError.
void finish_gateway_options(GatewayOptions &options);

}  // namespace forceaxis::nodes
