// Cuts of the power in every step.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "tests/firmware/unit/store_fixture.hpp"
#include "tests/support/poisoned.hpp"

namespace {

// The whole set, its cut at the first byte, at every kEvery-th from there on, and behind the last.
int64_t NextCut(int64_t life, int64_t last) {
  if (life == -1) return 1;
  return life < last ? std::min(life + kEvery, last) : last + 1;
}

// Several saves that fill a sector and continue in the other. Power is cut after every single step;
// at the next start the old set or the new set is loaded; behind every fourth cut the next save
// works.
TEST(Store, ACutAfterAnyByteLeavesTheOldSetOrTheNewOne) {
  Flash flash;
  Axis first(flash.memory());
  Values old_set = first.Stored();
  int cuts = 0;
  int old_seen = 0;
  int new_seen = 0;
  int erases_cut = 0;
  int reported = 0;
  for (uint32_t save = 1; save <= 5; ++save) {
    const std::vector<uint8_t> before = flash.bytes();
    const int percent = (save % 2 == 1) ? 100 : 40;
    int64_t steps = 0;
    Values new_set;
    std::vector<uint8_t> after;
    for (int64_t life = -1; life <= steps + 1; life = NextCut(life, steps + 1)) {
      flash.bytes() = before;
      flash.PowerFor(-1, 0);
      Axis axis(flash.memory());
      ASSERT_EQ(axis.Stored(), old_set) << "save " << save;
      axis.Change(save, percent);
      const Values wanted = axis.Stored();
      const int64_t begin = flash.steps();
      const int erases = flash.erases();
      flash.PowerFor(life, static_cast<uint32_t>(save * 100000 + life));
      ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
      axis.Run();
      flash.PowerFor(-1, 0);
      if (life == -1) {
        ASSERT_EQ(axis.State(), AXIS_STORE_STATE_SAVED);
        steps = flash.steps() - begin;
        new_set = wanted;
        after = flash.bytes();
      } else {
        ++cuts;
        erases_cut += (flash.erases() > erases && life <= Flash::kEraseSteps) ? 1 : 0;
        const std::string replay =
            "save " + std::to_string(save) + ", cut in step " + std::to_string(life);
        Axis next(flash.memory());
        const Values found = next.Stored();
        ASSERT_TRUE(found == old_set || found == new_set) << replay;
        (found == new_set ? new_seen : old_seen) += 1;
        if (found == new_set) {
          ASSERT_EQ(next.State(), AXIS_STORE_STATE_LOADED) << replay;
        } else {
          reported += next.State() == AXIS_STORE_STATE_LOADED_OLDER ? 1 : 0;
        }
        if (cuts % 4 == 0) {  // what it begins with is the same behind most cuts of a record
          next.Change(save + 1000, 10);
          ASSERT_EQ(next.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
          next.Run();
          ASSERT_EQ(next.State(), AXIS_STORE_STATE_SAVED) << replay;
          ASSERT_EQ(Axis(flash.memory()).Stored(), next.Stored()) << replay;
        }
        ASSERT_FALSE(flash.misused()) << replay;
      }
    }
    flash.bytes() = after;
    old_set = new_set;
  }
  std::printf("%d cuts (%d of them in an erase): old set %d times, new set %d times\n", cuts,
              erases_cut, old_seen, new_seen);
  EXPECT_GT(cuts, 5 * STORE_SET_BYTES / kEvery);
  EXPECT_GE(erases_cut, 2 * Flash::kEraseSteps / kEvery);
  EXPECT_GE(new_seen, 5);  // cut just behind the last byte
  EXPECT_GT(reported, old_seen / 2);
}

// Repeated cuts with saves between them, so that the memory holds remains of several.
TEST(Store, ManyCutsInARow) {
  for (uint32_t seed = 1; seed <= 40; ++seed) {
    std::minstd_rand random(seed);
    Flash flash;
    Values kept = Axis(flash.memory()).Stored();
    for (uint32_t i = 0; i < 60; ++i) {
      flash.PowerFor(-1, 0);
      Axis axis(flash.memory());
      ASSERT_EQ(axis.Stored(), kept) << "seed " << seed << " cut " << i;
      axis.Change(static_cast<uint32_t>(random() % 100000), static_cast<int>(random() % 60));
      const Values wanted = axis.Stored();
      flash.PowerFor(1 + static_cast<int64_t>(random() % 900), static_cast<uint32_t>(random()));
      ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
      axis.Run();
      const bool saved = axis.State() == AXIS_STORE_STATE_SAVED;
      flash.PowerFor(-1, 0);
      const Values found = Axis(flash.memory()).Stored();
      ASSERT_TRUE(found == wanted || (!saved && found == kept)) << "seed " << seed << " cut " << i;
      kept = found;
    }
    EXPECT_FALSE(flash.misused());
  }
}

// "save", and a reset of the node before it is done: the reset is delayed, nothing is lost.
TEST(Store, AResetOfTheNodeFindsWhatWasJustSaved) {
  Flash flash;
  fw_config_t config{};
  config.memory = flash.memory();
  config.buses = 1;
  fw_t fw = poisoned<fw_t>();
  fw_init(&fw, &config);
  const auto read = [&](uint16_t object) {
    int32_t value = 0;
    EXPECT_EQ(fw_object_read(&fw, object, &value), FW_OK);
    return value;
  };
  ASSERT_EQ(fw_object_write(&fw, FW_SOURCE_CANOPEN, AXIS_OBJ_FORCE_GAIN, 1234), FW_OK);
  ASSERT_EQ(fw_object_write(&fw, FW_SOURCE_CANOPEN, AXIS_OBJ_STORE_ALL, 0x65766173), FW_OK);
  const can_frame_t reset{0, 2, 0, {0x81, 0}};
  fw_can_receive(&fw, &reset);
  const axis_inputs_t inputs{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
  axis_outputs_t outputs;
  for (int i = 0; i < 1000 && read(AXIS_OBJ_STORE_STATE) != AXIS_STORE_STATE_LOADED; ++i) {
    fw_tick(&fw, &inputs, &outputs);
  }
  EXPECT_EQ(read(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_LOADED);
  EXPECT_EQ(read(AXIS_OBJ_FORCE_GAIN), 1234);
}

}  // namespace
