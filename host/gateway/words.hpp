#pragma once
// What numbers of CANopen and CiA 402 say in words.
#include <cstdint>
#include <span>
#include <string>

namespace forceaxis::nodes {

// CiA 402 state of a statusword, "operation enabled".
std::string drive_state_text(std::int64_t statusword);
// Mode of operation (6061h), "profile position".
std::string mode_text(std::int64_t mode);
// NMT state, "operational".
std::string nmt_text(std::int64_t state);
// "EMCY 8130h heartbeat lost"; manufacturer: the five bytes behind the error register, in which
// store_failed says what of the stored parameters is not in force:
// "EMCY 5530h store failed: loaded partly, force_tare and 2 more".
std::string emergency_text(std::uint16_t code, std::span<const std::uint8_t> manufacturer);
// Eight hexadecimal digits.
std::string hash_text(std::int64_t hash);

}  // namespace forceaxis::nodes
