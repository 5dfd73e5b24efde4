#pragma once
// Functions that return texts for values of CANopen and CiA 402 objects.
#include <cstdint>
#include <span>
#include <string>

namespace forceaxis::nodes {

// Returns the CiA 402 state in a statusword, such as "operation enabled".
std::string drive_state_text(std::int64_t statusword);
// Returns the name of a mode of operation (6061h), such as "profile position".
std::string mode_text(std::int64_t mode);
// Returns the name of an NMT state, such as "operational".
std::string nmt_text(std::int64_t state);
// Returns the text of an emergency message, such as "EMCY 8130h heartbeat lost". `manufacturer` has
// the five bytes after the error register. For store_failed, these bytes contain the stored
// parameters that are not active, so the text is, for example, "EMCY 5530h store failed: loaded
// partly, force_tare and 2 more".
std::string emergency_text(std::uint16_t code, std::span<const std::uint8_t> manufacturer);
// Returns a hash as eight hexadecimal digits.
std::string hash_text(std::int64_t hash);

}  // namespace forceaxis::nodes
