// Update of the firmware: the application writes the slot that does not run, and the loader chooses
// the slot that runs, on a modelled flash whose power fails in any operation.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "tests/firmware/unit/flash.hpp"
#include "tests/firmware/unit/fw_fixture.hpp"

namespace {

constexpr uint32_t kAddress[SLOTS] = {0x08020000, 0x08040000};
constexpr char kBoard[16] = "a-board-of-test";
constexpr uint32_t kMagicU = 0x55584146, kMagicT = 0x31544146, kBlank = 0xFFFFFFFF;
constexpr uint16_t kProgramData = 0x1F50;
constexpr uint32_t kConfirmTicks = 15000;
constexpr uint32_t kState = 0x08000022, kValue = 0x06090030, kLocked = 0x08000021,
                   kTooLong = 0x06070012, kMemory = 0x05040005;
constexpr int kControl = AXIS_OBJ_PROGRAM_CONTROL;

bool restarted = false;

// Two slots, and what may be programmed in them: each operation is one step. A word that is torn
// has some of its bits, an erase that is torn some of its bytes.
class SlotFlash {
 public:
  explicit SlotFlash(uint32_t slot_bytes)
      : bytes_(slot_bytes),
        words_(2 * slot_bytes / 4, kBlank),
        memory_{this, slot_bytes, &SlotFlash::Read, &SlotFlash::Program, &SlotFlash::Erase} {}
  SlotFlash(const SlotFlash &) = delete;
  SlotFlash &operator=(const SlotFlash &) = delete;

  const store_memory_t *memory() const { return &memory_; }
  const uint32_t *slot(int number) const { return &words_[number * bytes_ / 4]; }
  uint32_t *slot(int number) { return &words_[number * bytes_ / 4]; }
  slot_trailer_t &trailer(int number) {
    return *reinterpret_cast<slot_trailer_t *>(slot(number) + bytes_ / 4 - 16);
  }
  Bytes image(int number, size_t count) const {
    const auto *bytes = reinterpret_cast<const uint8_t *>(slot(number));
    return {bytes, bytes + count};
  }
  uint32_t slot_bytes() const { return bytes_; }

  // An image that a debug probe has written.
  void Put(int number, const Bytes &image, uint32_t sequence) {
    std::fill_n(slot(number), bytes_ / 4, kBlank);
    std::copy(image.begin(), image.end(), reinterpret_cast<uint8_t *>(slot(number)));
    trailer(number).magic = kMagicT;
    trailer(number).length = static_cast<uint32_t>(image.size());
    trailer(number).crc = Crc32(image.data(), image.size());
    trailer(number).sequence = sequence;
    trailer(number).confirmed = 0;
  }

  void PowerFor(int64_t life, uint32_t seed) {
    life_ = life;
    random_.seed(seed);
  }

  uint8_t running = 0;
  int64_t steps = 0;
  std::vector<std::string> misuses;

  // One of the tries of the loader, also a step.
  bool UseTry(int number) {
    const uint32_t next = slots_next_try(&trailer(number));
    return Word(trailer(number).tries[next], 0);
  }

 private:
  static SlotFlash &Of(void *context) { return *static_cast<SlotFlash *>(context); }

  static void Read(void *context, uint32_t address, uint8_t *to, uint32_t count) {
    SlotFlash &f = Of(context);
    if (address + count > 2 * f.bytes_) f.misuses.push_back("read outside");
    std::copy_n(reinterpret_cast<const uint8_t *>(f.words_.data()) + address, count, to);
  }

  bool Word(uint32_t &word, uint32_t value) {
    if (life_ == 0) return false;
    ++steps;
    if (life_ > 0 && --life_ == 0) {
      word &= value | static_cast<uint32_t>(random_() << 16 ^ random_());
      return false;
    }
    if (word != kBlank) misuses.push_back("programmed twice");
    word &= value;
    return true;
  }

  // The slot that runs, apart from the word `confirmed` of its trailer, is never programmed.
  bool MayProgram(uint32_t at) const {
    const uint32_t confirmed = running * bytes_ + bytes_ - 64 + 16;
    return at % 4 == 0 && at < 2 * bytes_ && (at / bytes_ != running || at == confirmed);
  }

  static bool Program(void *context, uint32_t address, const uint8_t *from, uint32_t count) {
    SlotFlash &f = Of(context);
    for (uint32_t i = 0; i < count; i += 4) {
      if (!f.MayProgram(address + i) || count % 4 != 0) {
        f.misuses.push_back("programmed " + std::to_string(address + i));
        return false;
      }
      const uint32_t value = static_cast<uint32_t>(from[i] | from[i + 1] << 8) |
                             static_cast<uint32_t>(from[i + 2]) << 16 |
                             static_cast<uint32_t>(from[i + 3]) << 24;
      if (!f.Word(f.words_[(address + i) / 4], value)) return false;
    }
    return true;
  }

  static bool Erase(void *context, uint8_t sector) {
    SlotFlash &f = Of(context);
    if (sector > 1 || sector == f.running) f.misuses.push_back("erased " + std::to_string(sector));
    if (f.life_ == 0) return false;
    ++f.steps;
    const bool is_torn = f.life_ > 0 && --f.life_ == 0;
    for (uint32_t i = 0; i < f.bytes_ / 4; ++i) {
      uint32_t &word = f.slot(sector)[i];
      if (!is_torn) {
        word = kBlank;
      } else if (f.random_() % 2 == 0) {
        word |= static_cast<uint32_t>(f.random_() << 16 ^ f.random_());
      }
    }
    return !is_torn;
  }

  uint32_t bytes_;
  std::vector<uint32_t> words_;
  store_memory_t memory_;
  std::minstd_rand random_;
  int64_t life_ = -1;
};

// What loader.c does at a reset: the slot that runs, 2 without one.
int Boot(SlotFlash &flash) {
  const uint32_t *const slots[SLOTS] = {flash.slot(0), flash.slot(1)};
  uint8_t without = 0;
  for (int slot; (slot = slots_choose(slots, flash.slot_bytes(), without)) != SLOTS_NONE;) {
    if (flash.trailer(slot).confirmed == 0 || flash.UseTry(slot)) {
      flash.running = static_cast<uint8_t>(slot);
      return slot;
    }
    without |= static_cast<uint8_t>(1 << slot);
  }
  return SLOTS_NONE;
}

Bytes RandomImage(uint32_t count, uint32_t seed) {
  std::mt19937 random(seed);
  Bytes image(count);
  for (uint8_t &byte : image) byte = static_cast<uint8_t>(random());
  return image;
}

// The 64 bytes in front of an image, by hand as fw.h describes them.
struct Head {
  uint32_t magic = kMagicU;
  uint32_t address = kAddress[1];
  uint32_t length = 0;
  uint32_t crc = 0;
  uint32_t replaced = AXIS_OBJECTS_HASH32;
  std::string board{kBoard};
  uint32_t wrong_crc = 0;
};

Bytes UpdateOf(const Bytes &image, Head head = {}) {
  Bytes bytes(64, 0);
  PutWord(bytes, 0, head.magic);
  PutWord(bytes, 4, head.address);
  PutWord(bytes, 8, head.length != 0 ? head.length : static_cast<uint32_t>(image.size()));
  PutWord(bytes, 12, head.crc != 0 ? head.crc : Crc32(image.data(), image.size()));
  PutWord(bytes, 16, AXIS_OBJECTS_HASH32);
  PutWord(bytes, 20, head.replaced);
  std::copy(head.board.begin(), head.board.end(), bytes.begin() + 24);
  PutWord(bytes, 60, Crc32(bytes.data(), 60) ^ head.wrong_crc);
  bytes.insert(bytes.end(), image.begin(), image.end());
  return bytes;
}

class Update : public Fw {
 protected:
  Update() { Begin(8192); }

  // A chip whose slot A has a confirmed image and whose slot B is blank.
  void Begin(uint32_t slot_bytes) {
    flash_ = std::make_unique<SlotFlash>(slot_bytes);
    old_ = RandomImage(slot_bytes / 4, 1);
    flash_->Put(0, old_, 7);
    PowerUpChip();
  }

  void PowerUpChip(const fw_core_fault_t *fault = nullptr) {
    fw_ = fw_t{};
    slots_ = {flash_->memory(),
              {kAddress[0], kAddress[1]},
              kBoard,
              [] { restarted = true; },
              flash_->running};
    fw_config_t config = NodeConfig();
    config.slots = &slots_;
    config.memory = store_.memory();
    config.core_fault = fault;
    fw_init(&fw_, &config);
    EnableServers();
    Set(AXIS_OBJ_FIRST_MOTION_TEST, AXIS_FIRST_MOTION_TEST_OFF);
    Tick(3);
    restarted = false;
  }

  Bytes Ask(Way way, Bytes request) {
    request.resize(8);
    return AskSdo(way, request);
  }

  static uint32_t CodeOf(const Bytes &answer) {
    if (answer.empty()) return kSilence;
    return answer[0] == 0x80 ? Word(answer) : 0;
  }

  // Without frames, in pieces of a segment: FW_OK, or the first refusal.
  int Direct(const Bytes &update, uint8_t source = FW_SOURCE_CANOPEN) {
    const auto size = static_cast<uint32_t>(update.size());
    int result = dictionary_download_begin(&fw_.objects, source, kProgramData, size);
    for (uint32_t at = 0; at < size && result == FW_OK; at += 7) {
      result = dictionary_download_append(&fw_.objects, source, at, &update[at],
                                          std::min(7u, size - at));
    }
    return result != FW_OK ? result
                           : dictionary_download_end(&fw_.objects, source, kProgramData, size);
  }

  uint32_t InBlocks(Way way, const Bytes &update) {
    const auto size = static_cast<uint32_t>(update.size());
    Bytes answer = Ask(way, Request(0xC6, kProgramData, 1, size));
    if (uint32_t code = CodeOf(answer)) return code;
    size_t block = answer[4];
    for (size_t at = 0; at < size; at += 7 * block) {
      const size_t count = std::min(block, (size - at + 6) / 7);
      for (size_t i = 1; i <= count; ++i) {
        const size_t from = at + 7 * (i - 1), to = std::min<size_t>(size, from + 7);
        Bytes segment{static_cast<uint8_t>(i | (to == size ? 0x80 : 0))};
        segment.insert(segment.end(), update.begin() + static_cast<long>(from),
                       update.begin() + static_cast<long>(to));
        const int64_t before = flash_->steps;
        answer = Ask(way, segment);
        // The head is complete with the last segment of a block, for whose answer the client waits.
        EXPECT_FALSE(before == 0 && flash_->steps != 0 && answer.empty());
        if (!answer.empty() && answer[0] == 0x80) return Word(answer);
      }
      EXPECT_EQ(answer[0], 0xA2);
      EXPECT_EQ(answer[1], count);
      block = answer[2];
    }
    const uint16_t crc = BlockCrc(update);
    const size_t unused = (7 - size % 7) % 7;
    return CodeOf(Ask(way, {static_cast<uint8_t>(0xC1 | unused << 2), static_cast<uint8_t>(crc),
                            static_cast<uint8_t>(crc >> 8)}));
  }

  uint32_t InSegments(Way way, const Bytes &update) {
    const auto size = static_cast<uint32_t>(update.size());
    if (uint32_t code = CodeOf(Ask(way, Request(0x21, kProgramData, 1, size)))) return code;
    uint8_t toggle = 0;
    for (size_t at = 0; at < size; at += 7, toggle ^= 0x10) {
      const size_t count = std::min<size_t>(7, size - at);
      Bytes request{static_cast<uint8_t>(toggle | (7 - count) << 1 | (at + 7 >= size))};
      request.insert(request.end(), update.begin() + static_cast<long>(at),
                     update.begin() + static_cast<long>(at + count));
      if (uint32_t code = CodeOf(Ask(way, request))) return code;
    }
    return 0;
  }

  // Parts by Modbus; each `repeats`-th request is sent twice, as after an answer that was lost.
  void InParts(const Bytes &update, size_t repeats = SIZE_MAX) {
    size_t sent = 0;
    for (size_t at = 0; at < update.size();) {
      std::vector<unsigned> words{static_cast<unsigned>(at & 0xFFFF)};
      for (size_t k = at; k < std::min(at + 64, update.size()); k += 4) {
        words.push_back(update[k + 2] | update[k + 3] << 8);
        words.push_back(update[k] | update[k + 1] << 8);
      }
      ASSERT_FALSE(IsException(AskRtu(WritePdu(0x040F, words)))) << "at " << at;
      if (++sent % repeats != 0) at += 64;
      Tick();
    }
  }

  int Refusal() const { return Inner(AXIS_OBJ_PROGRAM_REFUSAL); }
  int ImageState() const { return Inner(AXIS_OBJ_PROGRAM_STATE); }

  std::unique_ptr<SlotFlash> flash_;
  Flash store_;
  fw_slots_t slots_{};
  Bytes old_;
};

TEST_F(Update, ComesInSegmentsInBlocksAndInParts) {
  const Bytes image = RandomImage(3000, 2), update = UpdateOf(image);
  const std::vector<std::function<void()>> ways{
      [&] { EXPECT_EQ(InSegments(kCanopen, update), 0u); },
      [&] { EXPECT_EQ(InBlocks(kCanopen, update), 0u); },
      [&] {
        ASSERT_TRUE(Acquires(kRtu));
        InParts(update);
      },
      [&] {
        ASSERT_TRUE(Acquires(kRtu));
        InParts(update, 3);
      },
  };
  for (const auto &way : ways) {
    Begin(8192);
    way();
    EXPECT_EQ(Refusal(), AXIS_PROGRAM_REFUSAL_NONE);
    EXPECT_EQ(Read(kCanopen, AXIS_OBJ_PROGRAM_FLASH_STATUS), 0u);
    EXPECT_EQ(Read(kCanopen, AXIS_OBJ_PROGRAM_CRC_1), Crc32(old_.data(), old_.size()));
    EXPECT_EQ(Read(kCanopen, AXIS_OBJ_PROGRAM_CRC_2), Crc32(image.data(), image.size()));
    EXPECT_EQ(flash_->image(1, image.size()), image);
    EXPECT_EQ(flash_->image(0, old_.size()), old_);
    EXPECT_EQ(flash_->trailer(1).sequence, 8u);
    EXPECT_TRUE(flash_->misuses.empty()) << flash_->misuses[0];
    ASSERT_EQ(Boot(*flash_), 1);
    PowerUpChip();
    EXPECT_EQ(ImageState(), AXIS_PROGRAM_STATE_TRIAL);
    EXPECT_EQ(Inner(AXIS_OBJ_PROGRAM_SLOT), AXIS_PROGRAM_SLOT_B);
  }
}

TEST_F(Update, OffsetsOfPartsPassSixteenBits) {
  Begin(131072);
  const Bytes image = RandomImage(SLOT_IMAGE_BYTES_MAX, 3);
  ASSERT_TRUE(Acquires(kRtu));
  InParts(UpdateOf(image), 7);
  EXPECT_EQ(flash_->image(1, image.size()), image);
  EXPECT_EQ(Boot(*flash_), 1);
}

TEST_F(Update, TheFirstWrongThingInTheHeadIsNamedAndTheSlotUntouched) {
  const Bytes image = RandomImage(400, 2);
  const auto with = [&](auto change) {
    Head head;
    change(head);
    return UpdateOf(image, head);
  };
  Bytes shorter = UpdateOf(image);
  shorter.resize(shorter.size() - 8);
  const std::vector<std::pair<int, Bytes>> wrong{
      {AXIS_PROGRAM_REFUSAL_NO_UPDATE, with([](Head &h) { h.magic ^= 1; })},
      {AXIS_PROGRAM_REFUSAL_NO_UPDATE, with([](Head &h) { h.wrong_crc = 1; })},
      {AXIS_PROGRAM_REFUSAL_OTHER_BOARD, with([](Head &h) { h.board = "another board"; })},
      {AXIS_PROGRAM_REFUSAL_OTHER_BOARD, with([](Head &h) { h.board = "a-board-of-tes"; })},
      {AXIS_PROGRAM_REFUSAL_OTHER_TABLE, with([](Head &h) { h.replaced ^= 0x80000000; })},
      {AXIS_PROGRAM_REFUSAL_OTHER_LINK, with([](Head &h) { h.address = kAddress[0]; })},
      {AXIS_PROGRAM_REFUSAL_OTHER_LINK, with([](Head &h) { h.address += 4; })},
      {AXIS_PROGRAM_REFUSAL_WRONG_LENGTH, with([](Head &h) { h.length = 404; })},
      {AXIS_PROGRAM_REFUSAL_WRONG_LENGTH, with([](Head &h) { h.length = 396; })},
      {AXIS_PROGRAM_REFUSAL_WRONG_LENGTH, with([](Head &h) { h.length = 120836; })},
      {AXIS_PROGRAM_REFUSAL_WRONG_LENGTH, shorter},
  };
  for (const auto &[reason, update] : wrong) {
    EXPECT_EQ(InBlocks(kCanopen, update), kValue) << reason;
    EXPECT_EQ(Refusal(), reason);
    EXPECT_EQ(InSegments(kCanopen, update), kValue) << reason;
    EXPECT_EQ(Refusal(), reason);
    EXPECT_NE(Read(kCanopen, AXIS_OBJ_PROGRAM_FLASH_STATUS) & 0xFE, 0u);
  }
  ASSERT_TRUE(Acquires(kRtu));
  for (size_t i = 0; i < 7; ++i) {
    InParts(wrong[i].second);
    // The first word alone tells an update from a program.
    EXPECT_EQ(Refusal(), i == 0 ? Refusal() : wrong[i].first);
  }
  EXPECT_EQ(flash_->steps, 0);
  EXPECT_TRUE(flash_->misuses.empty());
}

TEST_F(Update, AnotherOwnerAnEnabledAxisAndATrialAreRefused) {
  const Bytes update = UpdateOf(RandomImage(400, 2));
  ASSERT_TRUE(Acquires(kLcm));
  EXPECT_EQ(InBlocks(kCanopen, update), kLocked);
  EXPECT_EQ(Write(kCanopen, kControl, AXIS_PROGRAM_CONTROL_START), kLocked);
  ASSERT_TRUE(Acquires(kCanopen));
  Drive();
  EXPECT_EQ(InBlocks(kCanopen, update), kState);
  EXPECT_EQ(InSegments(kCanopen, update), kState);
  EXPECT_EQ(Write(kCanopen, kControl, AXIS_PROGRAM_CONTROL_START), kState);
  EXPECT_EQ(Direct(update), FW_ERROR_STATE);
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  Tick(3);
  EXPECT_EQ(flash_->steps, 0);
  ASSERT_EQ(InBlocks(kCanopen, update), 0u);
  ASSERT_EQ(Boot(*flash_), 1);
  PowerUpChip();
  const int64_t before = flash_->steps;
  Head head;
  head.address = kAddress[0];
  EXPECT_EQ(InBlocks(kCanopen, UpdateOf(RandomImage(400, 3), head)), kState);
  EXPECT_EQ(Refusal(), AXIS_PROGRAM_REFUSAL_NOT_CONFIRMED);
  EXPECT_EQ(flash_->steps, before);
}

TEST_F(Update, WithoutSlotsThereIsNoMemory) {
  PowerUp();
  EXPECT_EQ(InBlocks(kCanopen, UpdateOf(RandomImage(400, 2))), kMemory);
  EXPECT_NE(Write(kCanopen, kControl, AXIS_PROGRAM_CONTROL_START), 0u);
  EXPECT_EQ(ImageState(), AXIS_PROGRAM_STATE_NO_SLOTS);
}

TEST_F(Update, TheAxisCannotBeEnabledMeanwhile) {
  const Bytes update = UpdateOf(RandomImage(400, 2));
  const auto enable = [&] { return Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F); };
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_OPEN_LOOP), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  ASSERT_EQ(dictionary_download_begin(&fw_.objects, FW_SOURCE_CANOPEN, kProgramData, 0), FW_OK);
  ASSERT_EQ(dictionary_download_append(&fw_.objects, FW_SOURCE_CANOPEN, 0, update.data(), 70),
            FW_OK);
  EXPECT_NE(enable(), 0u);
  EXPECT_EQ(FirmwareFixture::Write(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP), FW_ERROR_BUSY);
  Tick(7499);
  EXPECT_NE(enable(), 0u);
  Tick(2);
  EXPECT_EQ(enable(), 0u) << "the client has been silent for 5 s";
  Tick(3);
  ASSERT_TRUE(Inner(AXIS_OBJ_ACTIVE_MODE) != AXIS_MODE_DISABLED);
  const int64_t before = flash_->steps;
  EXPECT_NE(dictionary_download_append(&fw_.objects, FW_SOURCE_CANOPEN, 70, &update[70], 70),
            FW_OK);
  EXPECT_EQ(flash_->steps, before);
}

TEST_F(Update, AWrongImageOrTooFewBytesGetNoTrailer) {
  Head head;
  head.crc = 1;
  EXPECT_EQ(InBlocks(kCanopen, UpdateOf(RandomImage(400, 2), head)), kValue);
  EXPECT_EQ(Refusal(), AXIS_PROGRAM_REFUSAL_WRONG_CRC);
  EXPECT_EQ(Boot(*flash_), 0);
  Bytes update = UpdateOf(RandomImage(400, 2));
  update.resize(300);
  ASSERT_EQ(dictionary_download_begin(&fw_.objects, FW_SOURCE_CANOPEN, kProgramData, 0), FW_OK);
  ASSERT_EQ(dictionary_download_append(&fw_.objects, FW_SOURCE_CANOPEN, 0, update.data(), 300),
            FW_OK);
  EXPECT_EQ(dictionary_download_end(&fw_.objects, FW_SOURCE_CANOPEN, kProgramData, 300),
            FW_ERROR_RANGE);
  EXPECT_EQ(Boot(*flash_), 0);
  EXPECT_EQ(Read(kCanopen, AXIS_OBJ_PROGRAM_CRC_2), 0u);
}

TEST_F(Update, AnImageThatDoesNotConfirmIsTakenBackAtTheFifthStart) {
  const Bytes image = RandomImage(1000, 2);
  ASSERT_EQ(InBlocks(kCanopen, UpdateOf(image)), 0u);
  for (int start = 1; start <= 4; ++start) EXPECT_EQ(Boot(*flash_), 1) << start;
  for (int start = 5; start <= 8; ++start) EXPECT_EQ(Boot(*flash_), 0) << start;
  PowerUpChip();
  EXPECT_EQ(ImageState(), AXIS_PROGRAM_STATE_CONFIRMED);
  EXPECT_EQ(InBlocks(kCanopen, UpdateOf(image)), 0u) << "the next try";
  EXPECT_EQ(Boot(*flash_), 1);
}

TEST_F(Update, IsConfirmedAfterTenSecondsWithoutAnOverrun) {
  ASSERT_EQ(InBlocks(kCanopen, UpdateOf(RandomImage(1000, 2))), 0u);
  ASSERT_EQ(Boot(*flash_), 1);
  const fw_core_fault_t fault{};
  PowerUpChip(&fault);
  Tick(kConfirmTicks + 10);
  EXPECT_EQ(Write(kCanopen, kControl, AXIS_PROGRAM_CONTROL_CONFIRM), kState) << "a core fault";
  PowerUpChip();
  Tick(kConfirmTicks - 10);
  EXPECT_EQ(Write(kCanopen, kControl, AXIS_PROGRAM_CONTROL_CONFIRM), kState) << "too early";
  Tick(8);
  fw_overrun(&fw_, 0);
  Tick(kConfirmTicks - 1);
  EXPECT_EQ(Write(kCanopen, kControl, AXIS_PROGRAM_CONTROL_CONFIRM), kState) << "an overrun";
  Tick();
  EXPECT_EQ(Write(kLcm, kControl, AXIS_PROGRAM_CONTROL_CONFIRM), kLocked);
  fw_.device_signals.store_state = AXIS_STORE_STATE_FAILED;
  EXPECT_EQ(Write(kCanopen, kControl, AXIS_PROGRAM_CONTROL_CONFIRM), kState);
  fw_.device_signals.store_state = AXIS_STORE_STATE_EMPTY;
  EXPECT_EQ(flash_->trailer(1).confirmed, kBlank);
  EXPECT_EQ(Write(kCanopen, kControl, AXIS_PROGRAM_CONTROL_CONFIRM), 0u);
  EXPECT_EQ(flash_->trailer(1).confirmed, 0u);
  EXPECT_EQ(ImageState(), AXIS_PROGRAM_STATE_CONFIRMED);
  for (int start = 0; start < 8; ++start) EXPECT_EQ(Boot(*flash_), 1);
  EXPECT_TRUE(flash_->misuses.empty()) << flash_->misuses[0];
}

TEST_F(Update, ARestartComesAfterItsAnswer) {
  EXPECT_EQ(Write(kCanopen, kControl, AXIS_PROGRAM_CONTROL_START), 0u);
  EXPECT_NE(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  Tick(149);
  EXPECT_FALSE(restarted);
  Tick();
  EXPECT_TRUE(restarted);
}

// An update with all of its restarts and its confirmation, cut in a step: an image runs.
void ExpectAnImage(SlotFlash &flash, const Bytes &before, const Bytes &after,
                   const std::string &replay) {
  flash.PowerFor(-1, 0);
  int slot = SLOTS_NONE;
  for (int start = 0; start < 6; ++start) {
    slot = Boot(flash);
    ASSERT_NE(slot, SLOTS_NONE) << replay << ", start " << start;
    const auto length = flash.trailer(slot).length;
    const Bytes found = flash.image(slot, length);
    ASSERT_TRUE(found == before || found == after) << replay << ", start " << start;
  }
  // An image that nobody has confirmed does not stay.
  ASSERT_EQ(flash.trailer(slot).confirmed, 0u) << replay;
}

TEST_F(Update, ACutInAnyOperationLeavesAnImageThatRuns) {
  Begin(4096);
  Set(AXIS_OBJ_FORCE_GAIN, 777);
  Set(AXIS_OBJ_STORE_PARAMETERS, 1);
  Tick(2000);
  const Bytes image = RandomImage(1600, 5), update = UpdateOf(image), stored = store_.bytes();
  // Something old is in the slot that is erased.
  const Bytes older = RandomImage(2400, 4);
  int64_t steps = 0;
  int old_runs = 0, new_runs = 0;
  for (int64_t life = -1; life <= steps + 1; life += life == -1 ? 2 : 1) {
    Begin(4096);
    flash_->Put(1, older, 6);
    flash_->PowerFor(life, static_cast<uint32_t>(life + 7));
    Direct(update);
    if (Boot(*flash_) == 1) {
      PowerUpChip();
      fw_.axis.signals.tick_count = kConfirmTicks;
      (void)Write(kCanopen, kControl, AXIS_PROGRAM_CONTROL_CONFIRM);
    }
    if (life == -1) {
      steps = flash_->steps;
      ASSERT_EQ(flash_->trailer(1).confirmed, 0u);
    }
    ASSERT_NO_FATAL_FAILURE(ExpectAnImage(*flash_, old_, image, "cut " + std::to_string(life)));
    (flash_->running == 1 ? new_runs : old_runs) += 1;
    ASSERT_EQ(store_.bytes(), stored);
    ASSERT_TRUE(flash_->misuses.empty()) << flash_->misuses[0];
  }
  EXPECT_EQ(steps, 1 + 400 + 4 + 1 + 1);  // erase, image, trailer, try, confirmation
  EXPECT_GT(old_runs, 400);
  EXPECT_GE(new_runs, 2);
}

TEST_F(Update, TwoHundredCutsAtRandomOfWholeImages) {
  std::mt19937 random(11);
  Begin(131072);
  for (int cut = 0; cut < 200; ++cut) {
    flash_->PowerFor(-1, 0);
    const int other = 1 - flash_->running;
    const Bytes before = flash_->image(flash_->running, flash_->trailer(flash_->running).length);
    const Bytes image = RandomImage(4 * (2 + random() % (SLOT_IMAGE_BYTES_MAX / 4 - 1)), random());
    Head head;
    head.address = kAddress[other];
    PowerUpChip();
    const auto words = static_cast<int64_t>(image.size() / 4);
    // A third of the cuts is in the last operations.
    const int64_t life = cut % 3 == 0 ? words + 1 + random() % 7 : 1 + random() % (words + 7);
    flash_->PowerFor(life, random());
    Direct(UpdateOf(image, head));
    if (Boot(*flash_) == other) {
      PowerUpChip();
      fw_.axis.signals.tick_count = kConfirmTicks;
      (void)Write(kCanopen, kControl, AXIS_PROGRAM_CONTROL_CONFIRM);
    }
    ASSERT_NO_FATAL_FAILURE(ExpectAnImage(*flash_, before, image, "cut " + std::to_string(cut)));
    ASSERT_TRUE(flash_->misuses.empty()) << flash_->misuses[0];
  }
}

// The rule of the loader, a second time.
int Oracle(SlotFlash &flash) {
  int best = SLOTS_NONE;
  for (int slot = 0; slot < SLOTS; ++slot) {
    const slot_trailer_t &t = flash.trailer(slot);
    bool may = t.confirmed == 0;
    for (uint32_t tried : t.tries) may |= tried == kBlank;
    if (t.magic != kMagicT || !may || t.length % 4 != 0 || t.length < 8 ||
        t.length > flash.slot_bytes() - 64) {
      continue;
    }
    const Bytes image = flash.image(slot, t.length);
    if (Crc32(image.data(), image.size()) != t.crc) continue;
    if (best == SLOTS_NONE || t.sequence > flash.trailer(best).sequence) best = slot;
  }
  return best;
}

TEST(Loader, OverTenThousandTrailersNeverTakesAWrongCrc) {
  std::mt19937 random(17);
  SlotFlash flash(2048);
  int counts[3] = {};
  for (int i = 0; i < 10000; ++i) {
    for (int slot = 0; slot < SLOTS; ++slot) {
      flash.Put(slot, RandomImage(8 + 4 * (random() % 490), random()), random() % 4);
      auto *words = reinterpret_cast<uint32_t *>(&flash.trailer(slot));
      words[4] = random() % 2 ? kBlank : words[4];
      for (int word = 0; word < 4; ++word) words[5 + word] = random() % 2 ? kBlank : 0;
      // Torn and wrong words, in the trailer and in the image.
      if (random() % 3 == 0) words[random() % 9] &= random();
      if (random() % 3 == 0) words[random() % 9] ^= 1u << random() % 32;
      if (random() % 4 == 0) flash.slot(slot)[random() % 100] ^= 1u << random() % 32;
      if (random() % 20 == 0) words[random() % 9] = random();
    }
    const uint32_t *const slots[SLOTS] = {flash.slot(0), flash.slot(1)};
    const int found = slots_choose(slots, flash.slot_bytes(), 0);
    ASSERT_EQ(found, Oracle(flash)) << "trailer " << i;
    ++counts[found];
  }
  for (int count : counts) EXPECT_GT(count, 500);
}

// Requests of all kinds in any order: the flash refuses what is not permitted (MayProgram), and the
// store has only what its own commands write.
TEST_F(Update, NoSequenceOfRequestsProgramsAnythingElse) {
  std::mt19937 random(23);
  const Bytes image = RandomImage(800, 2);
  int complete = 0, restarts = 0;
  const Bytes stored = store_.bytes();
  uint32_t at = 0;
  Bytes update = UpdateOf(image);
  for (int step = 0; step < 40000; ++step) {
    const auto source = static_cast<uint8_t>(random() % 4 == 0 ? random() % 3 : 0);
    const auto index = static_cast<uint16_t>(random() % 8 == 0 ? 0x2435 : kProgramData);
    switch (random() % 12) {
      case 0: {
        Head head;
        head.address = random() % 8 == 0 ? random() : kAddress[1 - flash_->running];
        if (random() % 8 == 0) head.length = 4 * (random() % 40000);
        if (random() % 8 == 0) head.replaced = random();
        update = UpdateOf(image, head);
        at = 0;
        (void)dictionary_download_begin(&fw_.objects, source, index,
                                        random() % 2 ? 0 : static_cast<uint32_t>(update.size()));
        break;
      }
      case 1:
        (void)dictionary_download_end(&fw_.objects, source, index, at);
        break;
      case 2:
        (void)dictionary_write(&fw_.objects, source, kControl,
                               static_cast<int32_t>(random() % 3 == 0 ? 128 : random() % 4));
        break;
      case 3: {
        const auto object = static_cast<uint16_t>(AXIS_OBJ_CYCLE_DATA_OFFSET + random() % 19);
        const auto value = random() % 3 == 0 ? random() : random() % 2 == 0 ? 0 : kMagicU;
        (void)dictionary_write(&fw_.objects, source, object, static_cast<int32_t>(value));
        break;
      }
      case 4:
        (void)dictionary_write(&fw_.objects, source, AXIS_OBJ_COMMAND_SOURCE, source);
        break;
      case 5:
        (void)dictionary_write(&fw_.objects, source, AXIS_OBJ_CONTROLWORD,
                               random() % 2 ? 0x0F : 0x06);
        break;
      case 6:
        Tick(static_cast<int>(random() % 40));
        break;
      default:
        for (int piece = 0; piece < 20 && at < update.size(); ++piece) {
          const auto count =
              static_cast<uint32_t>(std::min<size_t>(1 + random() % 7, update.size() - at));
          const int done = dictionary_download_append(&fw_.objects, source, at, &update[at], count);
          if (done == FW_OK) at += count;
        }
    }
    if (restarted || random() % 500 == 0) {
      complete += flash_->trailer(1 - flash_->running).magic == kMagicT ? 1 : 0;
      ++restarts;
      ASSERT_NE(Boot(*flash_), SLOTS_NONE) << "step " << step;
      PowerUpChip();
      fw_.axis.signals.tick_count = random() % 2 ? kConfirmTicks : 0;
    }
    ASSERT_TRUE(flash_->misuses.empty()) << flash_->misuses[0] << " in step " << step;
  }
  EXPECT_EQ(store_.bytes(), stored);
  EXPECT_GT(complete, 10);
  EXPECT_GT(restarts, 50);
}

}  // namespace
