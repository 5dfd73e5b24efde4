// The store in a file of the host.

#include "firmware/port/host/store_file.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <string>

#include "tests/firmware/unit/store_fixture.hpp"

namespace {

class StoreFile : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = std::filesystem::temp_directory_path() / "forceaxis_store_XXXXXX";
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
    path_ = folder_ / "axis.store";
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path folder_;
  std::filesystem::path path_;
};

TEST_F(StoreFile, KeepsASet) {
  Values saved;
  {
    store_file_t file;
    ASSERT_EQ(store_file_open(&file, path_.c_str()), nullptr);
    Axis axis(&file.memory);
    EXPECT_EQ(axis.State(), AXIS_STORE_STATE_EMPTY);
    for (uint32_t i = 1; i < 40; ++i) {  // over both sectors and back
      axis.Change(i, 100);
      axis.Save();
    }
    saved = axis.Stored();
    store_file_close(&file);
  }
  store_file_t file;
  ASSERT_EQ(store_file_open(&file, path_.c_str()), nullptr);
  EXPECT_EQ(Axis(&file.memory).Stored(), saved);
  store_file_t second;
  EXPECT_STREQ(store_file_open(&second, path_.c_str()),
               "expected a file that no other axis uses; stop the other axis");
  store_file_close(&file);
}

TEST_F(StoreFile, AnotherFileIsRefusedAndNotTouched) {
  std::FILE *other = std::fopen(path_.c_str(), "w");
  ASSERT_NE(other, nullptr);
  std::fputs("not a store", other);
  std::fclose(other);
  store_file_t file;
  EXPECT_NE(store_file_open(&file, path_.c_str()), nullptr);
  EXPECT_EQ(std::filesystem::file_size(path_), 11u);
  EXPECT_STREQ(store_file_open(&file, folder_.c_str()), "Is a directory");
}

// A process that is killed in the middle of a save, at known places of it: before it, after so many
// ticks, and after its end.
TEST_F(StoreFile, AKilledProcessLeavesAWholeSet) {
  // Longer than a save: an erase, a sector that is seen to be blank, the set there and back.
  constexpr int kTicks = 2 + STORE_FILE_SECTOR_BYTES / 64 + AXIS_STORED_COUNT + 40;
  Axis empty(nullptr);
  ASSERT_EQ(empty.Write(AXIS_OBJ_FIRST_MOTION_TEST, 1), FW_OK);  // as without a stored set
  Values before = empty.Stored();
  int old_sets = 0;
  int new_sets = 0;
  for (int round = 1; round <= 24; ++round) {
    const int ticks = (round - 1) * kTicks / 23;
    Axis made(nullptr);  // the values that the child process saves
    made.Change(static_cast<uint32_t>(round), 100);
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      store_file_t file;
      if (store_file_open(&file, path_.c_str()) != nullptr) _exit(1);
      Axis axis(&file.memory);
      for (uint16_t i = 1; i < AXIS_OBJ_COUNT; ++i) {
        if (axis_objects[i].stored != 0) dictionary_restore(&axis.fw().objects, i, made.Read(i));
      }
      if (axis.Stored() != made.Stored()) _exit(2);
      axis_output_loaded(&axis.fw().axis, AXIS_DAC_BITS_MAX);  // as after a load
      if (axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1) != FW_OK) _exit(3);
      for (int i = 0; i < ticks; ++i) axis.Tick();
      kill(getpid(), SIGKILL);
    }
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL)
        << "round " << round << ", status " << status;
    store_file_t file;
    ASSERT_EQ(store_file_open(&file, path_.c_str()), nullptr);
    const Values found = Axis(&file.memory).Stored();
    store_file_close(&file);
    ASSERT_TRUE(found == before || found == made.Stored()) << "killed after tick " << ticks;
    if (ticks == 0) {
      EXPECT_EQ(found, before);
    }
    if (ticks == kTicks) {
      EXPECT_EQ(found, made.Stored());
    }
    (found == before ? old_sets : new_sets) += 1;
    before = found;
  }
  EXPECT_GE(old_sets, 4) << "killed in the middle";
  EXPECT_GE(new_sets, 1);
}

}  // namespace
