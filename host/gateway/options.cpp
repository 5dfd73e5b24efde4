#include "host/gateway/options.hpp"

#include <arpa/inet.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <memory>

#include "host/lcm/url.hpp"
#include "host/program/help.hpp"
#include "host/program/number_range.hpp"
#include "host/run/objects.hpp"

namespace forceaxis::nodes {
namespace {

constexpr int kMostNodes = 127;
// The predefined connection set of CiA 301 does not use the CAN identifiers 680h to 6DFh, which are
// those of the SDO channels for LCM and Modbus. Each axis needs four identifiers.
constexpr int kSdosOfAxis = 4, kMostAxes = 24;

// Returns the axis numbers in a text such as "1,2" or "1-6".
std::vector<int> axes_of(const std::string &text) {
  const auto fail = [&text] {
    throw UsageError("--axes " + text + ": expected numbers from 1 to 127 such as 1,2 or 1-6");
  };
  std::vector<int> axes;
  const char *at = text.data();
  const char *const end = at + text.size();
  const auto number = [&] {
    int n = 0;
    const auto [next, error] = std::from_chars(at, end, n);
    if (error != std::errc() || n < 1 || n > kMostNodes) fail();
    at = next;
    return n;
  };
  for (;;) {
    const int first = number();
    int last = first;
    if (at != end && *at == '-') {
      ++at;
      last = number();
    }
    if (last < first) fail();
    for (int n = first; n <= last; ++n) {
      if (std::ranges::find(axes, n) != axes.end()) fail();
      axes.push_back(n);
    }
    if (at == end) return axes;
    if (*at++ != ',') fail();
  }
}

// Returns the first SDO identifier of each axis. The identifier is computed from the node id modulo
// 24, so that it does not depend on the other axes of the gateway. If this identifier is not free,
// the next free identifier is used.
std::vector<std::uint32_t> first_sdos(const GatewayOptions &o, const std::vector<int> &axes) {
  if (axes.size() > kMostAxes) {
    throw UsageError("--axes " + o.axes + ": expected at most " + std::to_string(kMostAxes) +
                     " axes, CAN has no SDO identifiers left for axis " +
                     std::to_string(axes[kMostAxes]));
  }
  std::array<bool, kMostAxes> taken{};
  std::vector<std::uint32_t> found;
  for (const int axis : axes) {
    auto place = static_cast<std::size_t>((axis - 1) % kMostAxes);
    while (taken[place]) place = (place + 1) % kMostAxes;
    taken[place] = true;
    found.push_back(AXIS_GATEWAY_FIRST_SDO + kSdosOfAxis * static_cast<std::uint32_t>(place));
  }
  return found;
}

// Reads a parameter "NAME=VALUE". The value is a number in the unit of the object or a text of an
// enumeration.
AxisSettings::Parameter parameter_of(const std::string &set, const std::string &assignment) {
  const auto fail = [&set](const std::string &what) {
    throw UsageError("--set " + set + ": " + what);
  };
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos) fail("expected NAME=VALUE or N:NAME=VALUE");
  const std::string name = assignment.substr(0, equals), text = assignment.substr(equals + 1);
  const auto object = host::find_object(name);
  if (!object) fail("expected the name of a firmware object; see `forceaxis objects`");
  const axis_object_meta_t &meta = host::object_meta(*object);
  if (std::string_view(meta.kind) != "parameter" || !host::object_writable(*object)) {
    fail("expected a parameter, got a " + std::string(meta.kind));
  }
  if (const auto value = host::enum_value(*object, text)) return {*object, *value};
  char *end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  const double raw = std::round(value / meta.scale);
  if (text.empty() || *end != 0 || !(raw >= static_cast<double>(meta.min)) ||
      !(raw <= static_cast<double>(meta.max))) {
    char range[96];
    std::snprintf(range, sizeof range, "%g to %g", static_cast<double>(meta.min) * meta.scale,
                  static_cast<double>(meta.max) * meta.scale);
    fail("expected " + (*meta.enum_texts ? "one of " + std::string(meta.enum_texts)
                                         : std::string(range) + " " + meta.unit));
  }
  return {*object, static_cast<std::int64_t>(raw)};
}

}  // namespace

void add_gateway_options(CLI::App &app, GatewayOptions &o) {
  app.formatter(std::make_shared<nodes::Help>());
  app.add_option("--can", o.can, "CAN interface of the axes.")->capture_default_str();
  app.add_option(
         "--axes", o.axes,
         "Node ids of the axes, such as 1,2 or 1-6, which are also their Modbus units and LCM "
         "channels.")
      ->capture_default_str();
  app.add_option("--lcm-url", o.lcm_url,
                 "LCM URL, udpm://ADDRESS:PORT?ttl=N; default: LCM_DEFAULT_URL, else "
                 "udpm://239.255.76.67:7667?ttl=0 on this machine.");
  app.add_option("--lcm-remote", o.lcm_remote,
                 "Accept LCM commands also from these addresses, such as 192.168.1.0/24; default: "
                 "only from "
                 "this machine. LCM has no passwords. Repeatable.")
      ->take_all()
      ->expected(1)
      ->type_name("ADDRESS/MASK");
  app.add_option("--modbus-port", o.modbus_port, "TCP port of the Modbus server; 0: no server.")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  app.add_option("--modbus-bind", o.modbus_address,
                 "Address of the Modbus server; 0.0.0.0: accept other machines too. Modbus has no "
                 "passwords.")
      ->capture_default_str();
  app.add_option("--node-id", o.node_id, "Node id of the gateway, for its heartbeat.")
      ->check(CLI::Range(1, kMostNodes))
      ->capture_default_str();
  app.add_option("--sync-hz", o.sync_hz, "Rate in Hz of SYNC and of published states.")
      ->check(real_range(1, 200))
      ->capture_default_str();
  app.add_option("--heartbeat-ms", o.heartbeat_ms, "Heartbeat period in ms of gateway and axes.")
      ->check(CLI::Range(10, 10000))
      ->capture_default_str();
  app.add_option(
         "--watch-ms", o.watch_ms,
         "Time in ms without heartbeat of the gateway after which an axis is disabled; default: "
         "three heartbeat periods.")
      ->check(CLI::Range(20, 65535));
  app.add_option("--sdo-timeout-ms", o.sdo_timeout_ms,
                 "Time in ms within which an axis must answer. A read without an answer after half "
                 "of this time is sent again.")
      ->check(CLI::Range(10, 10000))
      ->capture_default_str();
  app.add_option(
         "--set", o.sets,
         "NAME=VALUE: parameter, in its unit, that the gateway writes at each configuration of an "
         "axis; N:NAME=VALUE for axis N only. Repeatable.")
      ->take_all()
      ->expected(1)
      ->type_name("NAME=VALUE");
}

void finish_gateway_options(GatewayOptions &o) {
  std::string from = "--lcm-url ";
  if (o.lcm_url.empty()) {
    o.lcm_url = lcm_bus::default_url();
    from = "LCM_DEFAULT_URL ";
  }
  const std::string wrong = lcm_bus::url_trouble(o.lcm_url);
  if (!wrong.empty()) throw UsageError(from + wrong);
  for (const std::string &text : o.lcm_remote) {
    std::string trouble;
    const auto network = lcm_bus::network_of(text, trouble);
    if (!network) throw UsageError("--lcm-remote " + text + ": " + trouble);
    o.remote.push_back(*network);
  }
  // 0.0.0.0 stands for all addresses of this machine. Other addresses that begin with 0 are not
  // valid.
  in_addr bind{};
  if (inet_pton(AF_INET, o.modbus_address.c_str(), &bind) != 1 ||
      (o.modbus_address[0] == '0' && bind.s_addr != INADDR_ANY)) {
    throw UsageError("--modbus-bind " + o.modbus_address +
                     ": expected an IPv4 address such as 127.0.0.1, or 0.0.0.0");
  }
  if (o.watch_ms == 0) o.watch_ms = 3 * o.heartbeat_ms;
  if (o.watch_ms <= o.heartbeat_ms) {
    throw UsageError("--watch-ms: expected more than one heartbeat period, " +
                     std::to_string(o.heartbeat_ms) + " ms");
  }
  if (o.watch_ms > 65535) throw UsageError("--heartbeat-ms: expected at most 21845");
  const std::vector<int> axes = axes_of(o.axes);
  const std::vector<std::uint32_t> sdos = first_sdos(o, axes);
  for (std::size_t i = 0; i < axes.size(); ++i) {
    if (axes[i] == o.node_id) {
      throw UsageError("--node-id " + std::to_string(o.node_id) +
                       ": expected a node id that no axis has, --axes " + o.axes);
    }
    AxisSettings s;
    s.number = axes[i];
    s.first_sdo = sdos[i];
    s.master = o.node_id;
    s.heartbeat = std::chrono::milliseconds(o.heartbeat_ms);
    s.watch = std::chrono::milliseconds(o.watch_ms);
    s.sdo_timeout = std::chrono::milliseconds(o.sdo_timeout_ms);
    o.settings.push_back(s);
  }
  for (const std::string &set : o.sets) {
    int only = 0;
    const char *const begin = set.data();
    const auto [at, error] = std::from_chars(begin, begin + set.size(), only);
    const bool prefixed = error == std::errc() && at != begin + set.size() && *at == ':';
    const auto parameter =
        parameter_of(set, prefixed ? std::string(at + 1, begin + set.size()) : set);
    bool found = false;
    for (AxisSettings &s : o.settings) {
      if (prefixed && s.number != only) continue;
      s.parameters.push_back(parameter);
      found = true;
    }
    if (!found) throw UsageError("--set " + set + ": expected an axis of --axes " + o.axes);
  }
}

}  // namespace forceaxis::nodes
