// Power cuts of the host while the store is in a file. A disk keeps what was written before a sync,
// and of what was written later any part, in any order, each write whole or torn.
//
// pwrite(), fsync() and fdatasync() of this program are those of this file: they note each call of
// one file and of its folder, and call those of the system. FORCEAXIS_POWER_CUTS: number of cuts.
//
// No cut finds an erase without its sync, because such an erase loses nothing: the sector that is
// erased never has the newest record, and the head of the next record, the first bytes that are
// programmed after an erase, is synced with all that was written before. Until then the disk has a
// part of old records, each with its older number and its CRC, and of that head, which has no valid
// CRC; a power cut within an erase leaves no less.

#include <dlfcn.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "firmware/port/host/store_file.h"
#include "tests/firmware/unit/bus_fixture.hpp"
#include "tests/firmware/unit/press_fixture.hpp"

namespace {

// Parameters and programs.
using Content = std::pair<Values, Kept>;

struct Event {
  enum Kind { kWrite, kSync, kFolder, kBegin, kStored } kind;
  size_t at = 0;
  Bytes bytes{};
  Content content{};  // that is begun, or reported as stored
};

struct Disk {
  std::filesystem::path file;  // empty: no call is noted
  std::vector<Event> events;
};
Disk disk;

// Returns true if `fd` is the watched file, or with `folder` the folder of this file.
bool IsWatched(int fd, bool folder) {
  if (disk.file.empty()) return false;
  std::error_code none;
  const auto path = std::filesystem::read_symlink("/proc/self/fd/" + std::to_string(fd), none);
  return path == (folder ? disk.file.parent_path() : disk.file);
}

template <class Function>
Function *System(const char *name) {
  return reinterpret_cast<Function *>(dlsym(RTLD_NEXT, name));
}

void NoteSync(int fd) {
  if (IsWatched(fd, false)) disk.events.push_back({Event::kSync});
  if (IsWatched(fd, true)) disk.events.push_back({Event::kFolder});
}

}  // namespace

extern "C" ssize_t pwrite(int fd, const void *bytes, size_t count, off_t at) {
  static auto *const system = System<ssize_t(int, const void *, size_t, off_t)>("pwrite");
  const ssize_t done = system(fd, bytes, count, at);
  if (done > 0 && IsWatched(fd, false)) {
    const auto *first = static_cast<const uint8_t *>(bytes);
    disk.events.push_back({Event::kWrite, static_cast<size_t>(at), {first, first + done}});
    if ((fcntl(fd, F_GETFL) & (O_DSYNC | O_SYNC)) != 0) disk.events.push_back({Event::kSync});
  }
  return done;
}

extern "C" int fdatasync(int fd) {
  NoteSync(fd);
  return 0;  // This process does not end in a power cut.
}

extern "C" int fsync(int fd) {
  NoteSync(fd);
  return 0;
}

namespace {

void Apply(Bytes &content, size_t at, const Bytes &bytes, size_t from, size_t to) {
  if (content.size() < at + to) content.resize(at + to, 0);  // A hole reads as zeros.
  std::copy(bytes.begin() + static_cast<ptrdiff_t>(from),
            bytes.begin() + static_cast<ptrdiff_t>(to),
            content.begin() + static_cast<ptrdiff_t>(at + from));
}

// What the disk has if the power is cut before event number `cut`, and whether the folder has the
// name of the file.
std::pair<Bytes, bool> Left(size_t cut, std::minstd_rand &random) {
  size_t synced = 0;
  bool is_named = false;
  for (size_t i = 0; i < cut; ++i) {
    synced = disk.events[i].kind == Event::kSync ? i : synced;
    is_named = is_named || disk.events[i].kind == Event::kFolder;
  }
  Bytes content;
  std::vector<const Event *> later;
  for (size_t i = 0; i < cut; ++i) {
    const Event &one = disk.events[i];
    if (one.kind != Event::kWrite) continue;
    if (i < synced) {
      Apply(content, one.at, one.bytes, 0, one.bytes.size());
    } else {
      later.push_back(&one);
    }
  }
  std::shuffle(later.begin(), later.end(), random);
  for (const Event *one : later) {
    if (random() % 2 == 0) continue;
    size_t from = 0;
    size_t to = one->bytes.size();
    if (random() % 3 == 0) {
      from = random() % to;
      to = from + random() % (to - from + 1);
    }
    Apply(content, one->at, one->bytes, from, to);
  }
  return {content, is_named || random() % 2 == 0};
}

Content ContentOf(const Press &axis) {
  Content content;
  for (uint16_t i = 1; i < AXIS_OBJ_COUNT; ++i) {
    const bool is_test = i == AXIS_OBJ_FIRST_MOTION_TEST;
    if (axis_objects[i].stored != 0) content.first.push_back(is_test ? 0 : axis.Read(i));
  }
  content.second = axis.Programs();
  return content;
}

// A folder with the watched file, and the file that a cut leaves.
class Folder {
 public:
  Folder() {
    // The real disk plays no part, and memory is faster.
    const bool has_memory = access("/dev/shm", W_OK) == 0;
    std::string name = has_memory ? "/dev/shm" : std::filesystem::temp_directory_path().string();
    name += "/forceaxis_power_XXXXXX";
    EXPECT_NE(mkdtemp(name.data()), nullptr);
    path_ = std::filesystem::canonical(name);
    disk.events.clear();
  }
  ~Folder() {
    disk.file.clear();
    std::filesystem::remove_all(path_);
  }
  Folder(const Folder &) = delete;
  Folder &operator=(const Folder &) = delete;

  // Begins a new file, whose calls are noted.
  const char *Watch() {
    disk.events.clear();
    disk.file = path_ / "axis.store";
    std::filesystem::remove(disk.file);
    return disk.file.c_str();
  }

  // The file, or its absence, after a cut before event number `cut`.
  std::string After(size_t cut, std::minstd_rand &random) const {
    const std::filesystem::path left = path_ / "left.store";
    std::filesystem::remove(left);
    const auto [bytes, is_named] = Left(cut, random);
    if (is_named) {
      std::ofstream(left, std::ios::binary)
          .write(reinterpret_cast<const char *>(bytes.data()),
                 static_cast<std::streamsize>(bytes.size()));
    }
    return left;
  }

 private:
  std::filesystem::path path_;
};

void Note(Event::Kind kind, const Content &content) {
  disk.events.push_back({kind, 0, {}, content});
}

// What may be found after a cut before event `cut`: what was stored last, and what was begun.
std::vector<Content> Allowed(size_t cut) {
  std::vector<Content> allowed;
  for (size_t i = 0; i < cut; ++i) {
    const Event &one = disk.events[i];
    if (one.kind == Event::kStored) allowed.clear();
    if (one.kind == Event::kStored || one.kind == Event::kBegin) allowed.push_back(one.content);
  }
  return allowed;
}

int Cuts(int fewest) {
  const char *asked = std::getenv("FORCEAXIS_POWER_CUTS");
  return asked != nullptr ? std::atoi(asked) : fewest / kEvery;
}

class StorePower : public ::testing::Test {
 protected:
  // Some saves of parameters and downloads of programs, noted with what they begin and store.
  void Record(std::minstd_rand &random) {
    store_file_t file;
    ASSERT_EQ(store_file_open(&file, folder_.Watch()), nullptr);
    Press axis(&file.memory);
    Note(Event::kStored, ContentOf(axis));
    for (int i = 0; i < 14; ++i) {
      const bool is_program = random() % 3 == 0;
      if (is_program) {
        const auto number = static_cast<uint32_t>(1 + random() % 3);
        const auto phases = static_cast<uint32_t>(random() % 40);
        ASSERT_EQ(axis.Download(cycle_record(number, static_cast<int>(phases))), FW_OK);
      } else {
        axis.Write(AXIS_OBJ_SPEED_MAX, static_cast<int32_t>(1 + random() % 100000));
        axis.Write(AXIS_OBJ_FORCE_MAX, static_cast<int32_t>(1 + random() % 1000));
      }
      const Content next = ContentOf(axis);
      Note(Event::kBegin, next);
      if (!is_program) {
        ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
      }
      axis.Settle();
      if (is_program) {
        ASSERT_EQ(axis.Read(AXIS_OBJ_CYCLE_STORE_STATE), AXIS_CYCLE_STORE_STATE_STORED);
      } else {
        ASSERT_EQ(axis.Read(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_SAVED);
      }
      Note(Event::kStored, next);
    }
    store_file_close(&file);
    disk.file.clear();
  }

  Folder folder_;
};

TEST_F(StorePower, NothingStoredIsLostWhateverTheDiskHasReceived) {
  const int cuts = Cuts(300);
  std::minstd_rand random(42);
  int begun = 0;
  for (int done = 0; done < cuts; ++done) {
    if (done % 100 == 0) {
      ASSERT_NO_FATAL_FAILURE(Record(random));
    }
    const size_t cut = random() % (disk.events.size() + 1);
    std::vector<Content> allowed = Allowed(cut);
    store_file_t file;
    ASSERT_EQ(store_file_open(&file, folder_.After(cut, random).c_str()), nullptr)
        << "cut " << done;
    Press axis(&file.memory);
    const Content found = ContentOf(axis);
    if (allowed.empty()) allowed.push_back(ContentOf(Press(nullptr)));
    ASSERT_NE(std::find(allowed.begin(), allowed.end(), found), allowed.end())
        << "cut " << done << " before event " << cut << " of " << disk.events.size();
    begun += allowed.size() > 1 ? 1 : 0;
    if (done % 5 == 0) {  // The next save works on what is left.
      axis.Write(AXIS_OBJ_SPEED_MAX, 777);
      ASSERT_EQ(axis.Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
      axis.Settle();
      ASSERT_EQ(axis.Read(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_SAVED) << "cut " << done;
      EXPECT_EQ(Press(&file.memory).Read(AXIS_OBJ_SPEED_MAX), 777);
    }
    store_file_close(&file);
  }
  std::printf("%d cuts, %d in a save\n", cuts, begun);
  EXPECT_GT(begun, cuts / 2);
}

TEST_F(StorePower, ASaveWaitsForTheDiskAFewTimes) {
  std::minstd_rand random(7);
  ASSERT_NO_FATAL_FAILURE(Record(random));
  int syncs = 0;
  int saves = 0;
  for (const Event &one : disk.events) {
    syncs += one.kind == Event::kSync ? 1 : 0;
    saves += one.kind == Event::kStored ? 1 : 0;
  }
  EXPECT_LT(syncs, 12 * saves);
}

// The archive of incidents, each of another power-up.
class ArchivePower : public BusFixture {
 protected:
  static constexpr uint32_t kRecorderBytes = 60 * 18;

  // The memory of the black box holds anything after a power cut.
  void PowerUp(store_file_t &file) {
    std::memset(static_cast<void *>(&blackbox_), 0xA5, sizeof(blackbox_));
    fw_config_t config = NodeConfig();
    config.recorder_bytes = kRecorderBytes;
    config.blackbox = &blackbox_;
    config.archive = &file.memory;
    fw_init(&fw_, &config);
    inputs_ = {0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 1, 0, 0, 0};
    Tick(4);
  }

  void Settle() {
    const auto is_busy = [&] {
      const int stored = Read(AXIS_OBJ_INCIDENT_STORED);
      return stored == AXIS_INCIDENT_STORED_WRITING || stored == AXIS_INCIDENT_STORED_CHECKING;
    };
    for (int i = 0; i < 1000 && is_busy(); ++i) Tick();
  }

  // An incident whose last position is `position`.
  void Fail(int position) {
    Set(AXIS_OBJ_FAULT_RESET, 1);
    Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
    for (inputs_.encoder_cnt = position - 100; inputs_.encoder_cnt < position;) {
      ++inputs_.encoder_cnt;
      Tick();
    }
    inputs_.din = 0;
    Tick(BLACKBOX_AFTER + kRecorderBytes / 16 + 4);
    Settle();
  }

  // The last position of the archived incident; 0 without one.
  int Loaded() {
    Settle();
    if (Write(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_LOAD) != FW_OK) return 0;
    for (int i = 0; i < 1000; ++i) Tick();
    if (Write(AXIS_OBJ_INCIDENT_COMMAND, AXIS_INCIDENT_COMMAND_FETCH) != FW_OK) return 0;
    std::vector<int32_t> values(RECORDER_CHANNELS);
    const auto error = static_cast<uint32_t>(Read(AXIS_OBJ_RECORDER_TRIGGER_INDEX));
    EXPECT_EQ(fw_recorder_read(&fw_, error, values.data()), RECORDER_CHANNELS);
    return values[0];
  }

  Folder folder_;
  blackbox_t blackbox_{};
};

TEST_F(ArchivePower, NoArchivedIncidentIsLost) {
  std::minstd_rand random(43);
  store_file_t file;
  ASSERT_EQ(archive_file_open(&file, folder_.Watch()), nullptr);
  // More than two sectors hold: the older ones are erased.
  constexpr int kIncidents = 2 * ARCHIVE_FILE_SECTOR_BYTES / static_cast<int>(kRecorderBytes) + 4;
  Note(Event::kStored, {{0}, {}});
  for (int i = 1; i <= kIncidents; ++i) {
    PowerUp(file);
    Note(Event::kBegin, {{1000 * i}, {}});
    Fail(1000 * i);
    ASSERT_EQ(Read(AXIS_OBJ_INCIDENT_STORED), AXIS_INCIDENT_STORED_STORED);
    Note(Event::kStored, {{1000 * i}, {}});
  }
  store_file_close(&file);
  const int cuts = Cuts(150);
  for (int done = 0; done < cuts; ++done) {
    const size_t cut = random() % (disk.events.size() + 1);
    store_file_t left;
    ASSERT_EQ(archive_file_open(&left, folder_.After(cut, random).c_str()), nullptr);
    PowerUp(left);
    const Content found{{Loaded()}, {}};
    std::vector<Content> allowed = Allowed(cut);
    if (allowed.empty()) allowed.push_back({{0}, {}});
    ASSERT_NE(std::find(allowed.begin(), allowed.end(), found), allowed.end())
        << "cut " << done << " before event " << cut << ": found " << found.first[0];
    store_file_close(&left);
  }
}

}  // namespace
