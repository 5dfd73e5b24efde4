// The store in a file of the host.

#include "firmware/port/host/store_file.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <random>
#include <string>

#include "tests/unit/store_fixture.hpp"

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
  EXPECT_STREQ(store_file_open(&second, path_.c_str()), "another process has it");
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

// A process that saves without end is killed, over and over.
TEST_F(StoreFile, AKilledProcessLeavesAWholeSet) {
  std::minstd_rand random(5);
  uint32_t last = 0;
  for (int round = 0; round < 30; ++round) {
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      store_file_t file;
      if (store_file_open(&file, path_.c_str()) != nullptr) _exit(1);
      Axis axis(&file.memory);
      for (uint32_t i = last + 1;; ++i) {
        axis.Change(i, 100);
        axis.Save();
      }
    }
    usleep(3000 + static_cast<useconds_t>(random() % 20000));
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status));
    store_file_t file;
    ASSERT_EQ(store_file_open(&file, path_.c_str()), nullptr);
    Axis axis(&file.memory);
    const auto number = static_cast<uint32_t>(axis.Read(AXIS_OBJ_SPEED_MAX));
    ASSERT_GE(number, last);
    // The set of this number, as the child made it: each one changes every parameter.
    Axis made(nullptr);
    for (uint32_t i = 1; i <= number; ++i) made.Change(i, 100);
    EXPECT_EQ(axis.Stored(), made.Stored()) << number;
    last = number;
    store_file_close(&file);
  }
  EXPECT_GT(last, 30u);
}

}  // namespace
