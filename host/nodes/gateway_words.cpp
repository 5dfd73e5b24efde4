#include "host/nodes/gateway_words.hpp"

#include <cstdio>
#include <map>

namespace forceaxis::nodes {
namespace {

struct StateText {
  int mask, value;
  const char *text;
};

constexpr StateText kStates[] = {
    {0x4F, 0x00, "not ready to switch on"}, {0x4F, 0x40, "switch on disabled"},
    {0x6F, 0x21, "ready to switch on"},     {0x6F, 0x23, "switched on"},
    {0x6F, 0x27, "operation enabled"},      {0x6F, 0x07, "quick stop active"},
    {0x4F, 0x0F, "fault reaction active"},  {0x4F, 0x08, "fault"},
};

std::string hex(unsigned long long value, int digits) {
  char text[24];
  std::snprintf(text, sizeof text, "%0*llXh", digits, value);
  return text;
}

}  // namespace

std::string drive_state_text(std::int64_t statusword) {
  for (const StateText &state : kStates) {
    if ((statusword & state.mask) == state.value) return state.text;
  }
  return "statusword " + hex(static_cast<unsigned long long>(statusword), 4);
}

std::string mode_text(std::int64_t mode) {
  static const std::map<std::int64_t, const char *> texts = {
      {0, "none"},
      {1, "profile position"},
      {3, "profile velocity"},
      {4, "force"},
      {6, "homing"},
      {8, "cyclic position"},
      {9, "cyclic velocity"},
      {10, "cyclic force"},
      {-1, "force counts"},
      {-2, "open loop"},
      {-3, "excitation"},
      {-4, "native position"},
      {-5, "guarded move"},
      {-6, "stiffness"},
      {-7, "damping"},
      {-8, "impedance"},
  };
  const auto found = texts.find(mode);
  return found == texts.end() ? "mode " + std::to_string(mode) : found->second;
}

std::string nmt_text(std::int64_t state) {
  switch (state) {
    case 0:
      return "booting";
    case 4:
      return "stopped";
    case 5:
      return "operational";
    case 127:
      return "pre-operational";
    case -1:
      return "silent";
    default:
      return "NMT state " + std::to_string(state);
  }
}

std::string emergency_text(std::uint16_t code) {
  static const std::map<std::uint16_t, const char *> texts = {
      {0x0000, "error reset"},
      {0x2310, "current"},
      {0x5530, "store"},
      {0x6010, "watchdog"},
      {0x6320, "parameter"},
      {0x7305, "encoder"},
      {0x7310, "speed"},
      {0x8110, "CAN overrun"},
      {0x8120, "CAN passive"},
      {0x8130, "heartbeat lost"},
      {0x8140, "CAN off"},
      {0x8210, "PDO too short"},
      {0x8220, "PDO too long"},
      {0x8240, "SYNC length"},
      {0x8250, "PDO late"},
      {0x8611, "following error"},
      {0x8612, "limit"},
      {0xFF01, "contact lost"},
      {0xFF02, "force sensor saturated"},
      {0xFF03, "limit cycle"},
      {0xFF04, "loop overrun"},
  };
  const auto found = texts.find(code);
  return "EMCY " + hex(code, 4) + (found == texts.end() ? "" : std::string(" ") + found->second);
}

std::string hash_text(std::int64_t hash) {
  char text[24];
  std::snprintf(text, sizeof text, "%08llx", static_cast<unsigned long long>(hash));
  return text;
}

}  // namespace forceaxis::nodes
