// What the gateway says of an emergency.

#include "host/gateway/words.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>

namespace {

using forceaxis::nodes::emergency_text;
using Manufacturer = std::array<std::uint8_t, 5>;

TEST(Words, AnEmergencyIsNamedByItsCode) {
  EXPECT_EQ(emergency_text(0x8130, Manufacturer{9, 0, 0, 0, 0}), "EMCY 8130h heartbeat lost");
  EXPECT_EQ(emergency_text(0, Manufacturer{}), "EMCY 0000h error reset");
  EXPECT_EQ(emergency_text(0x1234, Manufacturer{}), "EMCY 1234h");
}

// States and parameters by their names, whatever else the firmware could not load.
TEST(Words, TheStoreNamesParametersNotInForce) {
  EXPECT_EQ(emergency_text(0x5530, Manufacturer{6, 0, 0, 0, 0}), "EMCY 5530h store failed: failed");
  EXPECT_EQ(emergency_text(0x5530, Manufacturer{8, 0x0E, 0x20, 0, 1}),
            "EMCY 5530h store failed: loaded partly, force_tare");
  EXPECT_EQ(emergency_text(0x5530, Manufacturer{9, 0x99, 0x60, 2, 4}),
            "EMCY 5530h store failed: loaded old defaults, homing_speed_2 and 3 more");
  EXPECT_EQ(emergency_text(0x5530, Manufacturer{8, 0xF0, 0x3F, 1, 1}),
            "EMCY 5530h store failed: loaded partly, 3FF0h:1")
      << "no table has it";
}

}  // namespace
