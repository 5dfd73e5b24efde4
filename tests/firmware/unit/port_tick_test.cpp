// The division of a timer's clock into ticks, for clocks that are no multiple of 1500 Hz.
#include <gtest/gtest.h>

#include <cstdint>

extern "C" {
#include "firmware/port/tick.h"
}

namespace {

// In each second 1500 ticks take exactly the counts of a second, and each tick ends less than one
// count before its time.
TEST(PortTick, TicksOfEachSecondTakeExactlyItsCounts) {
  for (const std::uint32_t hz : {10'000'000u, 16'000'000u, 20'000'000u, 25'000'000u, 32'000'000u,
                                 32'768u, 168'000'000u, 600'000'001u}) {
    std::uint32_t fraction = 0;
    std::uint64_t counts = 0;
    for (std::uint64_t tick = 1; tick <= 3 * 1500; ++tick) {
      counts += tick_counts(hz, &fraction);
      ASSERT_EQ(counts, tick * hz / 1500) << hz << " Hz, tick " << tick;
    }
    EXPECT_EQ(counts, 3 * std::uint64_t{hz});
  }
}

}  // namespace
