#include "host/gateway/words.hpp"

#include <algorithm>
#include <cstdio>

#include "host/run/objects.hpp"

extern "C" {
#include "firmware/objects/generated/axis_objects.h"
}

namespace forceaxis::nodes {
namespace {

std::string hex(unsigned long long value, int digits) {
  char text[24];
  std::snprintf(text, sizeof text, "%0*llXh", digits, value);
  return text;
}

// Returns the name of a value in the object table. Returns an empty text if the value has no name.
std::string name_in_words(std::uint16_t object, std::int32_t value) {
  std::string text(host::value_name(object, value));
  std::ranges::replace(text, '_', ' ');
  return text;
}

// Returns the text for the manufacturer bytes of an emergency message store_failed. The text has
// the state of the store and the name of the first affected parameter. Such a parameter does not
// have its stored value, or has an earlier default. The text also has the number of further
// affected parameters.
std::string store_text(std::span<const std::uint8_t> manufacturer) {
  std::string text = ": " + host::enum_text(AXIS_OBJ_STORE_STATE, manufacturer[0]);
  std::ranges::replace(text, '_', ' ');
  const unsigned index = manufacturer[1] | manufacturer[2] << 8;
  const unsigned sub = manufacturer[3];
  if (index == 0) return text;
  const std::string_view name = host::name_at(index, sub);
  text += ", " + (name.empty() ? hex(index, 4) + ":" + std::to_string(sub) : std::string(name));
  const unsigned others = manufacturer[4] - 1U;
  return text + (others == 0 ? "" : " and " + std::to_string(others) + " more");
}

}  // namespace

std::string drive_state_text(std::int64_t statusword) {
  for (const axis_status_state_t &state : axis_status_states) {
    if ((statusword & state.mask) == state.value) return state.text;
  }
  return "statusword " + hex(static_cast<unsigned long long>(statusword), 4);
}

std::string mode_text(std::int64_t mode) {
  const std::string text =
      name_in_words(AXIS_OBJ_MODES_OF_OPERATION_DISPLAY, static_cast<std::int32_t>(mode));
  return text.empty() ? "mode " + std::to_string(mode) : text;
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

std::string emergency_text(std::uint16_t code, std::span<const std::uint8_t> manufacturer) {
  const std::string text = code == 0 ? "error reset" : name_in_words(AXIS_OBJ_ERROR_CODE, code);
  return "EMCY " + hex(code, 4) + (text.empty() ? "" : " " + text) +
         (code == AXIS_ERROR_CODE_STORE_FAILED ? store_text(manufacturer) : "");
}

std::string hash_text(std::int64_t hash) {
  char text[24];
  std::snprintf(text, sizeof text, "%08llx", static_cast<unsigned long long>(hash));
  return text;
}

}  // namespace forceaxis::nodes
