// LSS, CiA 305: every service in every state, what it refuses, and that none of it moves the axis.

#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "tests/firmware/unit/flash.hpp"
#include "tests/firmware/unit/fw_fixture.hpp"

namespace {

constexpr uint16_t kRequest = 0x7E5, kAnswer = 0x7E4;
constexpr uint32_t kSerial = 0x12345678;

class Lss : public Fw {
 protected:
  void PowerUp(uint8_t node_id, const store_memory_t *memory = nullptr, uint16_t bit_rates = 0) {
    fw_config_t config = NodeConfig();
    config.node_id = node_id;
    config.memory = memory;
    config.serial_number = kSerial;
    config.bit_rates = bit_rates;
    fw_ = fw_t{};
    fw_init(&fw_, &config);
  }

  using FirmwareFixture::Write;

  static Bytes Eight(Bytes data) {
    data.resize(8);
    return data;
  }

  // A request of the master; the answers at once, all of which must be LSS.
  std::vector<Bytes> Ask(const Bytes &data) {
    Take();
    Send(kRequest, Eight(data));
    std::vector<Bytes> answers;
    for (const Frame &frame : Take()) {
      EXPECT_EQ(frame.id, kAnswer);
      answers.push_back(frame.data);
    }
    return answers;
  }

  static Bytes Numbered(uint8_t command, uint32_t value) {
    Bytes data{command};
    const Bytes bytes = LittleEndian(value, 4);
    data.insert(data.end(), bytes.begin(), bytes.end());
    return data;
  }

  // The only answer is this.
  bool Answers(const Bytes &request, const Bytes &answer) {
    return Ask(request) == std::vector<Bytes>{Eight(answer)};
  }
  bool IsMute(const Bytes &request) { return Ask(request).empty(); }

  void Configuration() { ASSERT_TRUE(IsMute({0x04, 1})); }
  void Waiting() { ASSERT_TRUE(IsMute({0x04, 0})); }
  bool IsConfiguring() { return !IsMute({0x5E}); }

  bool Selects(uint32_t vendor, uint32_t product, uint32_t revision, uint32_t serial) {
    const uint32_t parts[] = {vendor, product, revision, serial};
    bool answered = false;
    for (uint8_t i = 0; i < 4; ++i) {
      const auto answers = Ask(Numbered(static_cast<uint8_t>(0x40 + i), parts[i]));
      EXPECT_TRUE(answers.empty() || (i == 3 && answers == std::vector<Bytes>{Eight({0x44})}));
      answered = !answers.empty();
    }
    return answered;
  }

  bool Identifies(const uint32_t (&parts)[6]) {
    bool answered = false;
    for (uint8_t i = 0; i < 6; ++i) {
      answered = Answers(Numbered(static_cast<uint8_t>(0x46 + i), parts[i]), {0x4F});
    }
    return answered;
  }

  // Store configuration: ticks until its answer, and the error in it.
  int Store(int limit = 4000) {
    EXPECT_TRUE(IsMute({0x17}));
    for (int i = 0; i < limit; ++i) {
      Tick();
      const auto answers = Take(kAnswer);
      if (!answers.empty()) {
        EXPECT_EQ(answers.size(), 1u);
        EXPECT_EQ(answers[0].data[0], 0x17);
        return answers[0].data[1];
      }
    }
    return -1;
  }

  int NodeId() const { return Inner(AXIS_OBJ_NODE_ID); }
  uint32_t Product() const { return static_cast<uint32_t>(Inner(AXIS_OBJ_PRODUCT_CODE)); }
};

TEST_F(Lss, ANodeWithoutIdIsSilentButForLss) {
  PowerUp(FW_NODE_ID_BY_LSS);
  EXPECT_EQ(NodeId(), 255);
  for (uint16_t id = 0; id < 0x800; ++id) {
    if (id == kRequest) continue;
    Send(id, {});
    Send(id, {1, 0});
    Send(id, {0x40, 0x00, 0x10, 0, 0, 0, 0, 0});
  }
  fw_can_bus(&fw_, CAN_BUS_OFF);
  fw_can_bus(&fw_, CAN_BUS_ACTIVE);
  fw_can_lost(&fw_, 3);
  Tick(1000);
  EXPECT_TRUE(Take().empty());
  EXPECT_EQ(Inner(AXIS_OBJ_NMT_STATE), AXIS_NMT_STATE_INITIALISING);
  for (uint8_t unit : {0, 1, 247, 255}) {
    EXPECT_TRUE(SendRtu(RtuFrame(unit, Pdu(6, {0x0100, 1}))).empty());
  }
  EXPECT_EQ(Inner(AXIS_OBJ_COMMAND_SOURCE), AXIS_COMMAND_SOURCE_CANOPEN);
  EXPECT_TRUE(Answers({0x4C}, {0x50}));
}

TEST_F(Lss, ANodeWithIdIsNotFoundAsOneWithout) {
  EXPECT_TRUE(IsMute({0x4C}));
  EXPECT_TRUE(IsMute({0x51, 0, 0, 0, 0, 128, 0, 0}));
}

TEST_F(Lss, SelectsByItsWholeAddressInItsOrder) {
  for (uint8_t node_id : {uint8_t{5}, uint8_t{255}}) {
    PowerUp(node_id);
    const uint32_t product = Product();
    EXPECT_FALSE(Selects(1, product, 1, kSerial));
    EXPECT_FALSE(Selects(0, product + 1, 1, kSerial));
    EXPECT_FALSE(Selects(0, product, 0x10001, kSerial));
    EXPECT_FALSE(Selects(0, product, 1, kSerial ^ 0x80000000));
    EXPECT_FALSE(IsConfiguring());
    ASSERT_TRUE(IsMute(Numbered(0x40, 0)));
    ASSERT_TRUE(IsMute(Numbered(0x42, 1)));
    ASSERT_TRUE(IsMute(Numbered(0x41, product)));
    EXPECT_TRUE(IsMute(Numbered(0x43, kSerial))) << "revision before product";
    EXPECT_TRUE(Selects(0, product, 1, kSerial));
    EXPECT_TRUE(IsConfiguring());
    EXPECT_FALSE(Selects(0, product, 1, kSerial)) << "not in configuration";
    Waiting();
    EXPECT_FALSE(IsConfiguring());
  }
}

TEST_F(Lss, IdentifiesItselfWithinTheBoundsInBothStates) {
  PowerUp(5);
  const uint32_t product = Product();
  for (int state = 0; state < 2; ++state) {
    ASSERT_TRUE(IsMute({0x04, static_cast<uint8_t>(state)}));
    EXPECT_TRUE(Identifies({0, product, 1, 1, kSerial, kSerial}));
    EXPECT_TRUE(Identifies({0, product, 0, 0xFFFFFFFF, 0, 0xFFFFFFFF}));
    EXPECT_FALSE(Identifies({0, product, 2, 3, 0, 0xFFFFFFFF}));
    EXPECT_FALSE(Identifies({0, product, 0, 0, 0, 0xFFFFFFFF}));
    EXPECT_FALSE(Identifies({0, product, 1, 1, kSerial + 1, 0xFFFFFFFF}));
    EXPECT_FALSE(Identifies({0, product, 1, 1, 0, kSerial - 1}));
    EXPECT_FALSE(Identifies({0, product + 1, 1, 1, kSerial, kSerial}));
    EXPECT_FALSE(Identifies({1, product, 1, 1, kSerial, kSerial}));
  }
}

TEST_F(Lss, InquiriesAreAnsweredInConfigurationOnly) {
  PowerUp(5);
  const uint32_t expected[] = {0, Product(), 1, kSerial, 5};
  for (uint8_t i = 0; i < 5; ++i) EXPECT_TRUE(IsMute({static_cast<uint8_t>(0x5A + i)}));
  Configuration();
  for (uint8_t i = 0; i < 5; ++i) {
    const auto command = static_cast<uint8_t>(0x5A + i);
    EXPECT_TRUE(Answers({command}, Numbered(command, expected[i])));
  }
  PowerUp(255);
  Configuration();
  EXPECT_TRUE(Answers({0x5E}, {0x5E, 255}));
}

TEST_F(Lss, WhatIsNoRequestIsIgnored) {
  PowerUp(0);
  Configuration();
  EXPECT_TRUE(IsMute({0x04, 2})) << "no state";
  EXPECT_TRUE(IsConfiguring());
  for (uint8_t length = 0; length < 8; ++length) {
    Bytes data{0x5E, 0, 0, 0, 0, 0, 0, 0};
    data.resize(length);
    Send(kRequest, data);
    EXPECT_TRUE(Take(kAnswer).empty()) << int{length};
  }
  Send(kRequest, Eight({}), true);
  EXPECT_TRUE(Take(kAnswer).empty()) << "remote";
  for (int command :
       {0x00, 0x03, 0x05, 0x10, 0x12, 0x14, 0x16, 0x18, 0x44, 0x4F, 0x59, 0x5F, 0xFF}) {
    EXPECT_TRUE(IsMute({static_cast<uint8_t>(command)})) << command;
  }
}

TEST_F(Lss, ANodeIdCountsFromTheNextResetOfCommunication) {
  PowerUp(0);
  Take();
  Send(0, {2, 1});  // served in every NMT state
  Configuration();
  for (uint8_t id : {0, 128, 254}) EXPECT_TRUE(Answers({0x11, id}, {0x11, 1}));
  EXPECT_TRUE(Answers({0x11, 127}, {0x11, 0}));
  Waiting();
  Tick(3);
  EXPECT_EQ(NodeId(), 1);
  Send(0, {130, 1});
  Tick(2);
  EXPECT_EQ(Take(0x700 + 127).size(), 1u);
  EXPECT_EQ(NodeId(), 127);
  EXPECT_EQ(Inner(AXIS_OBJ_EMCY_COB_ID), 0x80 + 127);
  EXPECT_EQ(SendRtu(RtuFrame(127, Pdu(4, {0, 1}))).size(), 7u);
  Send(0, {129, 127});
  Tick(2);
  EXPECT_EQ(Take(0x701).size(), 1u) << "it was not stored";
  EXPECT_EQ(NodeId(), 1);
  // Back to no id.
  Configuration();
  EXPECT_TRUE(Answers({0x11, 255}, {0x11, 0}));
  Waiting();
  Send(0, {130, 1});
  Tick(1000);
  EXPECT_TRUE(Take().empty());
  EXPECT_TRUE(Answers({0x4C}, {0x50}));
}

TEST_F(Lss, AnIdThatThePortHasFixedStays) {
  PowerUp(5);
  Configuration();
  EXPECT_TRUE(Answers({0x11, 7}, {0x11, 255, 1}));
  EXPECT_TRUE(Answers({0x11, 0}, {0x11, 1}));
  Send(0, {130, 5});
  Tick(2);
  EXPECT_EQ(NodeId(), 5);
}

TEST_F(Lss, ANodeWithoutIdBootsWhenItIsGivenOne) {
  PowerUp(FW_NODE_ID_BY_LSS);
  Waiting();
  Tick(2);
  EXPECT_TRUE(Take().empty()) << "none was given";
  Configuration();
  EXPECT_TRUE(Answers({0x11, 9}, {0x11, 0}));
  EXPECT_TRUE(IsMute({0x4C})) << "it has one, though not yet in use";
  Tick(100);
  EXPECT_TRUE(Take().empty());
  Waiting();
  Tick();
  EXPECT_EQ(Take(), (std::vector<Frame>{{0x709, {0}}}));
  EXPECT_EQ(Inner(AXIS_OBJ_NMT_STATE), AXIS_NMT_STATE_PRE_OPERATIONAL);
  Tick(301);
  EXPECT_EQ(Take(0x709).size(), 1u) << "heartbeat";
}

// Four nodes on a bus, scanned by a master of its own: whoever answers, answers for all.
TEST_F(Lss, FastScanFindsOneNodeAfterTheOther) {
  const uint32_t serials[] = {0, 0x80000001, 0x7FFFFFFF, 0x00000400};
  std::vector<std::unique_ptr<fw_t>> bus;
  for (uint32_t serial : serials) {
    fw_config_t config{};
    config.node_id = FW_NODE_ID_BY_LSS;
    config.buses = 1;
    config.serial_number = serial;
    bus.push_back(std::make_unique<fw_t>());
    fw_init(bus.back().get(), &config);
  }
  std::vector<uint16_t> boots;
  const auto ask = [&](const Bytes &data) {
    can_frame_t frame{};
    frame.id = kRequest;
    frame.length = 8;
    std::copy(data.begin(), data.end(), frame.data);
    int answers = 0;
    for (const auto &node : bus) {
      fw_can_receive(node.get(), &frame);
      fw_between(node.get());
      for (can_frame_t sent{}; fw_can_transmit(node.get(), &sent);) {
        if (sent.id == kAnswer) {
          EXPECT_EQ(sent.data[0], data[0] == 0x51 ? 0x4F : data[0]);
          ++answers;
        } else {
          boots.push_back(sent.id);
        }
      }
    }
    return answers;
  };
  const auto scan = [&](uint32_t value, uint8_t check, uint8_t part, uint8_t next) {
    Bytes data = Numbered(0x51, value);
    data.insert(data.end(), {check, part, next});
    return ask(data);
  };
  std::vector<uint32_t> found;
  for (uint8_t id = 10; scan(0, 128, 0, 0) > 0; ++id) {
    uint32_t address[4] = {};
    for (uint8_t part = 0; part < 4; ++part) {
      for (int bit = 31; bit >= 0; --bit) {
        if (scan(address[part], static_cast<uint8_t>(bit), part, part) == 0) {
          address[part] |= 1u << bit;
        }
      }
      const auto next = static_cast<uint8_t>((part + 1) % 4);
      ASSERT_GE(scan(address[part], 0, part, next), 1);
    }
    EXPECT_EQ(address[0], 0u);
    EXPECT_EQ(address[1], 0x46415831u);
    EXPECT_EQ(address[2], 1u);
    found.push_back(address[3]);
    EXPECT_EQ(ask({0x11, id, 0, 0, 0, 0, 0, 0}), 1) << "one alone is in configuration";
    EXPECT_EQ(ask({0x04, 0, 0, 0, 0, 0, 0, 0}), 0);
    ASSERT_LE(found.size(), 4u);
  }
  EXPECT_EQ(found, (std::vector<uint32_t>{0, 0x400, 0x7FFFFFFF, 0x80000001}));
  EXPECT_EQ(boots, (std::vector<uint16_t>{0x70A, 0x70B, 0x70C, 0x70D}));
}

TEST_F(Lss, FastScanIgnoresWhatIsOutOfItsOrder) {
  PowerUp(FW_NODE_ID_BY_LSS);
  const auto scan = [&](uint32_t value, uint8_t check, uint8_t part, uint8_t next) {
    Bytes data = Numbered(0x51, value);
    data.insert(data.end(), {check, part, next});
    return Answers(data, {0x4F});
  };
  EXPECT_TRUE(scan(0, 128, 0, 0));
  EXPECT_FALSE(scan(Product(), 0, 1, 2)) << "vendor first";
  EXPECT_FALSE(scan(0, 32, 0, 0));
  EXPECT_FALSE(scan(0, 127, 0, 0));
  EXPECT_FALSE(scan(0, 0, 0, 4));
  EXPECT_FALSE(scan(0, 0, 4, 0));
  EXPECT_TRUE(scan(0, 0, 0, 1));
  EXPECT_TRUE(scan(Product(), 0, 1, 2));
  EXPECT_TRUE(scan(0, 128, 0, 0));
  EXPECT_FALSE(scan(1, 0, 2, 3)) << "from the beginning";
  EXPECT_FALSE(IsConfiguring());
}

// Selecting and fast scan begin with the first part of the address, the vendor, at power-up and
// after a reset of communication, whatever was asked before.
TEST_F(Lss, ASequenceBeginsAnewWithAReset) {
  const auto part = [&](uint8_t i, uint32_t value) {
    return !Ask(Numbered(static_cast<uint8_t>(0x40 + i), value)).empty();
  };
  PowerUp(5);
  EXPECT_FALSE(part(1, Product()) || part(2, 1) || part(3, kSerial)) << "without the vendor";
  EXPECT_FALSE(part(0, 0) || part(1, Product()) || part(2, 1));
  Send(0, {130, 5});
  Tick(2);
  EXPECT_FALSE(part(3, kSerial)) << "the first three were before the reset";
  EXPECT_FALSE(part(0, 0) || part(1, Product()) || part(2, 1));
  EXPECT_TRUE(part(3, kSerial));
}

TEST_F(Lss, AFastScanBeginsAnewWithAReset) {
  const auto scan = [&](uint32_t value, uint8_t check, uint8_t part, uint8_t next) {
    Bytes data = Numbered(0x51, value);
    data.insert(data.end(), {check, part, next});
    return Answers(data, {0x4F});
  };
  PowerUp(FW_NODE_ID_BY_LSS);
  EXPECT_FALSE(scan(Product(), 0, 1, 2)) << "vendor first";
  EXPECT_TRUE(scan(0, 0, 0, 1));
  EXPECT_TRUE(scan(Product(), 0, 1, 2));
  EXPECT_TRUE(scan(1, 0, 2, 3));
  EXPECT_TRUE(scan(kSerial, 0, 3, 1)) << "selected, and the next part would be the product";
  EXPECT_TRUE(Answers({0x11, 9}, {0x11, 0}));
  Waiting();
  Tick(2);
  ASSERT_EQ(NodeId(), 9);
  Configuration();
  EXPECT_TRUE(Answers({0x11, 255}, {0x11, 0}));
  Waiting();
  Send(0, {130, 9});
  Tick(2);
  ASSERT_EQ(NodeId(), 255);
  EXPECT_FALSE(scan(Product(), 0, 1, 2)) << "vendor first";
  EXPECT_TRUE(scan(0, 0, 0, 1));
}

TEST_F(Lss, ABitRateChangesBetweenTwoSilences) {
  PowerUp(5, nullptr, 0x05);  // 1000 and 500 kbit/s
  Send(0, {1, 5});
  Tick();
  Take();
  Configuration();
  EXPECT_TRUE(Answers({0x13, 0, 1}, {0x13, 1})) << "800: not the port's";
  EXPECT_TRUE(Answers({0x13, 0, 5}, {0x13, 1})) << "reserved";
  EXPECT_TRUE(Answers({0x13, 0, 9}, {0x13, 1})) << "automatic";
  EXPECT_TRUE(Answers({0x13, 1, 0}, {0x13, 1})) << "table of a manufacturer";
  EXPECT_TRUE(Answers({0x13, 0, 2}, {0x13, 0}));
  EXPECT_EQ(Inner(AXIS_OBJ_BIT_RATE), 1000);
  EXPECT_TRUE(IsMute({0x15, 0x2C, 0x01}));  // 300 ms
  for (int i = 1; i <= 900; ++i) {
    Send(0x80, {});
    Send(0x605, {0x40, 0, 0x10, 0, 0, 0, 0, 0});
    Send(0, {129, 5});
    Send(kRequest, Eight({0x5E}));
    EXPECT_TRUE(Take().empty()) << "tick " << i;
    EXPECT_EQ(fw_can_kbit_s(&fw_), i <= 450 ? 1000 : 500) << "tick " << i;
    Tick();
  }
  EXPECT_EQ(Inner(AXIS_OBJ_BIT_RATE), 500);
  EXPECT_EQ(Inner(AXIS_OBJ_SYNC_COUNT), 0);
  EXPECT_EQ(Inner(AXIS_OBJ_NMT_STATE), AXIS_NMT_STATE_PRE_OPERATIONAL) << "1029h";
  Tick(300);
  EXPECT_EQ(Take(0x705).size(), 1u);
  EXPECT_TRUE(Answers({0x5E}, {0x5E, 5}));
  Send(0, {130, 5});
  Tick(2);
  EXPECT_EQ(fw_can_kbit_s(&fw_), 500);
  Send(0, {129, 5});
  Tick(2);
  EXPECT_EQ(fw_can_kbit_s(&fw_), 1000) << "it was not stored";
}

TEST_F(Lss, EveryRateOfTheTable) {
  const int rates[] = {1000, 800, 500, 250, 125, 0, 50, 20, 10};
  PowerUp(255);
  Configuration();
  for (uint8_t i = 0; i < 9; ++i) {
    const bool has = rates[i] != 0;
    EXPECT_TRUE(Answers({0x13, 0, i}, {0x13, static_cast<uint8_t>(has ? 0 : 1)}));
    EXPECT_TRUE(IsMute({0x15, 0, 0}));
    Tick(3);
    if (has) {
      EXPECT_EQ(Inner(AXIS_OBJ_BIT_RATE), rates[i]);
    }
    EXPECT_EQ(Write(AXIS_OBJ_STORED_BIT_RATE, has ? rates[i] : 100), has ? FW_OK : FW_ERROR_RANGE);
  }
}

TEST_F(Lss, OnlyTheActivationOfABitRateStopsTheAxis) {
  PowerUp(0);
  EnableServers();
  const auto at_node = [&](uint16_t index, uint32_t value, int bytes) {
    Send(0x601, Request(static_cast<uint8_t>(0x23 | (4 - bytes) << 2), index, 0, value));
  };
  Set(AXIS_OBJ_BUMP_DECAY_SHIFT, 0);
  Set(AXIS_OBJ_OPEN_LOOP_CODE, kCode);
  at_node(0x6060, AXIS_MODES_OF_OPERATION_OPEN_LOOP & 0xFF, 1);
  at_node(0x6040, 0x06, 2);
  at_node(0x6040, 0x0F, 2);
  Tick(3);
  ASSERT_TRUE(IsOn());
  Take();
  Configuration();
  EXPECT_TRUE(Answers({0x11, 9}, {0x11, 0}));
  EXPECT_TRUE(Answers({0x13, 0, 2}, {0x13, 0}));
  EXPECT_EQ(Store(), 1) << "no store";
  Waiting();
  Configuration();
  Tick(50);
  EXPECT_TRUE(IsOn());
  EXPECT_TRUE(IsMute({0x15, 1, 0}));
  Tick();
  EXPECT_TRUE(IsOff());
  EXPECT_EQ(Inner(AXIS_OBJ_FAULT), AXIS_FAULT_CAN_OFF);
  Tick(10);
  EXPECT_EQ(Take(0x081).size(), 1u) << "when it is back on the bus";
}

TEST_F(Lss, StoresIdAndRateAndNothingElse) {
  Flash flash;
  PowerUp(FW_NODE_ID_BY_LSS, flash.memory());
  Set(AXIS_OBJ_FORCE_GAIN, 1111);
  Configuration();
  EXPECT_TRUE(Answers({0x11, 42}, {0x11, 0}));
  EXPECT_TRUE(Answers({0x13, 0, 3}, {0x13, 0}));
  EXPECT_EQ(Store(), 0);
  EXPECT_EQ(Inner(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_SAVED);
  EXPECT_EQ(Inner(AXIS_OBJ_FORCE_GAIN), 1111);
  PowerUp(FW_NODE_ID_BY_LSS, flash.memory());
  EXPECT_EQ(Inner(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_LOADED);
  EXPECT_EQ(NodeId(), 42);
  EXPECT_EQ(fw_can_kbit_s(&fw_), 250);
  EXPECT_EQ(Inner(AXIS_OBJ_FORCE_GAIN), 0) << "not stored, so its default";
  EXPECT_EQ(Inner(AXIS_OBJ_FIRST_MOTION_TEST), AXIS_FIRST_MOTION_TEST_ON)
      << "as without a set: the axis has not been set up";
  EXPECT_EQ(Inner(AXIS_OBJ_EMCY_COB_ID), 0x80 + 42);
  // Over a set with other values, which stay as they are in it.
  Set(AXIS_OBJ_FORCE_GAIN, 2222);
  Set(AXIS_OBJ_EMCY_COB_ID, fx_s32_from_u32(0x800000FF));
  ASSERT_EQ(Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
  Tick(1000);
  Set(AXIS_OBJ_FORCE_GAIN, 3333);
  Set(AXIS_OBJ_SPEED_MAX, 44);
  Configuration();
  EXPECT_TRUE(Answers({0x11, 43}, {0x11, 0}));
  EXPECT_EQ(Store(), 0);
  PowerUp(0, flash.memory());
  EXPECT_EQ(NodeId(), 43);
  EXPECT_EQ(fw_can_kbit_s(&fw_), 250);
  EXPECT_EQ(Inner(AXIS_OBJ_FORCE_GAIN), 2222);
  EXPECT_EQ(Inner(AXIS_OBJ_EMCY_COB_ID), fx_s32_from_u32(0x800000FF));
  EXPECT_EQ(Inner(AXIS_OBJ_SPEED_MAX), axis_objects[AXIS_OBJ_SPEED_MAX].initial);
  EXPECT_EQ(Inner(AXIS_OBJ_RPDO_COB_ID_1), 0x200 + 43) << "a default follows the id";
  // Stored as no id.
  Configuration();
  EXPECT_TRUE(Answers({0x11, 255}, {0x11, 0}));
  EXPECT_EQ(Store(), 0);
  PowerUp(0, flash.memory());
  EXPECT_EQ(NodeId(), 255);
  EXPECT_FALSE(flash.misused());
}

TEST_F(Lss, AFixedIdIsNotStored) {
  Flash flash;
  PowerUp(5, flash.memory());
  Configuration();
  EXPECT_TRUE(Answers({0x13, 0, 4}, {0x13, 0}));
  EXPECT_EQ(Store(), 0);
  PowerUp(0, flash.memory());
  EXPECT_EQ(NodeId(), 1);
  EXPECT_EQ(fw_can_kbit_s(&fw_), 125);
}

TEST_F(Lss, StoringSaysWhyItFailed) {
  PowerUp(0);
  Configuration();
  EXPECT_EQ(Store(), 1);
  Flash broken;
  broken.faults.program = FlashFaults::Program::kRefused;
  PowerUp(0, broken.memory());
  Configuration();
  EXPECT_EQ(Store(), 2);
  Flash flash;
  PowerUp(0, flash.memory());
  Configuration();
  ASSERT_EQ(Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
  EXPECT_EQ(Store(), 2) << "the store is at work";
  Tick(1000);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  Tick(2);
  EXPECT_EQ(Store(), 2) << "the axis is enabled";
  Set(AXIS_OBJ_MODE, AXIS_MODE_DISABLED);
  Tick(2);
  Send(kRequest, Eight({0x17}));
  EXPECT_EQ(Store(), 0) << "asked for twice, answered once";
}

TEST_F(Lss, WhatDoesNotFitInTheStoreIsNoIdAndNoRate) {
  Flash flash;
  PowerUp(0, flash.memory());
  Set(AXIS_OBJ_STORED_BIT_RATE, 800);
  ASSERT_EQ(Write(AXIS_OBJ_STORE_PARAMETERS, 1), FW_OK);
  Tick(1000);
  PowerUp(FW_NODE_ID_BY_LSS, flash.memory(), 0x01);
  EXPECT_EQ(fw_can_kbit_s(&fw_), 1000) << "the port has no 800 kbit/s";
  EXPECT_EQ(NodeId(), 255);
  for (int id : {128, 254}) EXPECT_EQ(Write(AXIS_OBJ_STORED_NODE_ID, id), FW_ERROR_RANGE);
}

}  // namespace
