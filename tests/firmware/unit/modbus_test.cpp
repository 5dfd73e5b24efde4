// The Modbus RTU server over a whole firmware: requests as bytes, answers as bytes. The frames and
// CRCs are put together apart from the firmware.

#include <gtest/gtest.h>

#include <cstdint>
#include <fstream>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "firmware/objects/generated/axis_objects_meta.h"
#include "firmware/port/host/firmware.hpp"
#include "tests/firmware/unit/bus_fixture.hpp"

namespace {

constexpr uint8_t kUnit = kNode;

class Modbus : public BusFixture {
 protected:
  static constexpr int kSilence = 4;  // ticks of 1.75 ms, and the one in which the bytes arrive

  Modbus() { PowerUp(0); }

  void PowerUp(uint32_t baud) {
    fw_config_t config = NodeConfig();
    config.modbus_baud = baud;
    fw_init(&fw_, &config);
  }

  void Send(const Bytes &bytes) { SendSerial(bytes); }

  // Sends a request; the response's PDU, empty without one. Its unit and CRC are checked.
  Bytes Ask(const Bytes &pdu, uint8_t unit = kUnit) {
    Send(RtuFrame(unit, pdu));
    Bytes answer = Fetch();
    if (answer.empty()) return {};
    EXPECT_GE(answer.size(), 5u);
    EXPECT_EQ(Crc16(answer), 0) << "CRC of the answer";
    EXPECT_EQ(answer[0], kUnit);
    return {answer.begin() + 1, answer.end() - 2};
  }

  Bytes Ask(uint8_t function, std::initializer_list<unsigned> words, uint8_t unit = kUnit) {
    return Ask(Pdu(function, words), unit);
  }

  Bytes Write16(unsigned first, const std::vector<unsigned> &words, uint8_t unit = kUnit) {
    return Ask(WritePdu(first, words), unit);
  }

  // The values of function 3 or 4; empty after an exception.
  std::vector<unsigned> ReadRegisters(uint8_t function, unsigned first, unsigned count) {
    const Bytes answer = Ask(function, {first, count});
    std::vector<unsigned> words;
    if (answer.size() != 2 + 2 * count || answer[0] != function) return words;
    EXPECT_EQ(answer[1], 2 * count);
    for (size_t i = 2; i < answer.size(); i += 2) {
      words.push_back(256u * answer[i] + answer[i + 1]);
    }
    return words;
  }

  void Own() { Set(AXIS_OBJ_COMMAND_SOURCE, AXIS_COMMAND_SOURCE_MODBUS); }

  static Bytes Exception(uint8_t function, uint8_t code) {
    return {static_cast<uint8_t>(function | 0x80), code};
  }

  unsigned Counter(unsigned sub_function) {
    const Bytes answer = Ask(8, {sub_function, 0});
    return answer.size() == 5 ? 256u * answer[3] + answer[4] : 0xFFFFFFFFu;
  }
};

// The table of requests that the gateway must answer too.
TEST_F(Modbus, EveryRequestOfTheTableHasItsAnswer) {
  std::ifstream file(MODBUS_REQUESTS);
  ASSERT_TRUE(file) << MODBUS_REQUESTS;
  const std::string hash = AXIS_OBJECTS_HASH_TEXT;
  const auto bytes_of = [&hash](std::string text) {
    for (const auto &[half, at] : {std::pair{"HHHH", 0u}, {"LLLL", 4u}}) {
      const size_t place = text.find(half);
      if (place != std::string::npos) text.replace(place, 4, hash, at, 4);
    }
    std::string digits;
    for (size_t i = 0; i < text.size(); ++i) {
      if (text.compare(i, 2, "UU") == 0) {
        digits += "0123456789abcdef"[kUnit >> 4];
        digits += "0123456789abcdef"[kUnit & 15];
        ++i;
      } else if (text[i] != ' ') {
        digits += text[i];
      }
    }
    Bytes bytes;
    for (size_t i = 0; i < digits.size(); i += 2) {
      bytes.push_back(static_cast<uint8_t>(std::stoul(digits.substr(i, 2), nullptr, 16)));
    }
    return bytes;
  };
  int number = 0, requests = 0;
  for (std::string line; std::getline(file, line);) {
    ++number;
    line = line.substr(0, line.find('#'));
    const size_t equals = line.find('=');
    if (equals == std::string::npos) continue;
    Send(RtuFrame(kUnit, bytes_of(line.substr(0, equals))));
    Tick(kSilence);  // those of a wrong length end with it
    const Bytes answer = Fetch();
    ASSERT_GE(answer.size(), 5u) << "line " << number << ": " << line;
    EXPECT_EQ(Bytes(answer.begin() + 1, answer.end() - 2), bytes_of(line.substr(equals + 1)))
        << "line " << number << ": " << line;
    ++requests;
  }
  EXPECT_GT(requests, 80);
}

TEST_F(Modbus, StateIsSmall) { EXPECT_LE(sizeof(modbus_t), 600u); }

// The frame of the specification's own example (function 3, registers 107..109 of unit 17).
TEST_F(Modbus, TheCrcIsThatOfTheSpecification) {
  EXPECT_EQ(Closed({0x11, 0x03, 0x00, 0x6B, 0x00, 0x03}),
            (Bytes{0x11, 0x03, 0x00, 0x6B, 0x00, 0x03, 0x76, 0x87}));
}

// Catalogue values of both CRCs; ticks of 3.5 characters by hand: 57750 / baud,
// rounded up, and of 1.75 ms.
TEST(FxSerial, CrcsSilenceAndBits) {
  uint16_t crc16 = 0xFFFF;
  uint32_t crc32 = UINT32_MAX;
  for (const char c : std::string("123456789")) {
    crc16 = fx_crc16_modbus(crc16, static_cast<uint8_t>(c));
    crc32 = fx_crc32(crc32, static_cast<uint8_t>(c));
  }
  EXPECT_EQ(crc16, 0x4B37);
  EXPECT_EQ(~crc32, 0xCBF43926u);
  const std::pair<uint32_t, uint32_t> silences[] = {
      {0, 3},     {1, 57750}, {1200, 49}, {9600, 7},   {19200, 4},
      {19201, 3}, {57600, 3}, {57750, 3}, {115200, 3}, {UINT32_MAX, 3}};
  for (const auto &[baud, ticks] : silences) {
    modbus_t server;
    modbus_init(&server, 1, baud);
    EXPECT_EQ(server.silence_ticks, ticks) << baud;
  }
  uint8_t row[3] = {0xFF, 0xFF, 0xFF};
  for (uint32_t n = 0; n < 10; ++n) fx_bit_append(row, n, n % 3 == 0);
  EXPECT_EQ(row[0], 0x49);
  EXPECT_EQ(row[1], 0x02);
  EXPECT_EQ(row[2], 0xFF);
  EXPECT_TRUE(fx_bit_get(row, 9));
  EXPECT_FALSE(fx_bit_get(row, 8));
  fx_store_be16(row, 0x1234);
  EXPECT_EQ(row[0], 0x12);
  EXPECT_EQ(fx_load_be16(row), 0x1234);
  for (const auto &[bits, octets] : {std::pair{0u, 0u}, {1u, 1u}, {8u, 1u}, {9u, 2u}}) {
    EXPECT_EQ(fx_octets(bits), octets);
  }
}

// Each object of the map reads as it is, alone, in both word orders.
TEST_F(Modbus, EveryRegisterReadsItsObject) {
  Tick(3);
  for (const int32_t order : {0, 1}) {
    Set(AXIS_OBJ_MODBUS_WORD_ORDER, order);
    const auto check = [&](const axis_register_t &entry, uint8_t function) {
      const auto value = static_cast<uint32_t>(Read(entry.object));
      const uint8_t type = axis_objects[entry.object].type;
      if (type != AXIS_TYPE_U32 && type != AXIS_TYPE_I32) {
        EXPECT_EQ(ReadRegisters(function, entry.first, 1), (std::vector<unsigned>{value & 0xFFFF}));
        return;
      }
      std::vector<unsigned> both{value >> 16, value & 0xFFFF};
      if (order == 1) std::swap(both[0], both[1]);
      EXPECT_EQ(ReadRegisters(function, entry.first, 2), both) << entry.first;
      EXPECT_EQ(ReadRegisters(function, entry.first, 1), (std::vector<unsigned>{both[0]}));
      EXPECT_EQ(ReadRegisters(function, entry.first + 1u, 1), (std::vector<unsigned>{both[1]}));
    };
    for (const auto &entry : axis_holding) check(entry, 3);
    for (const auto &entry : axis_input) check(entry, 4);
  }
}

TEST_F(Modbus, HolesAreException2AndNothingElseIs) {
  const auto check = [&](const axis_register_t *entries, size_t count, uint8_t function) {
    std::map<unsigned, bool> known;
    for (size_t i = 0; i < count; ++i) {
      known[entries[i].first] = true;
      const uint8_t type = axis_objects[entries[i].object].type;
      if (type == AXIS_TYPE_U32 || type == AXIS_TYPE_I32) known[entries[i].first + 1u] = true;
    }
    for (unsigned at = 0; at < 65536; ++at) {
      if (at > 0x400 && at < 65500 && at % 97 != 0) continue;
      const Bytes one = Ask(function, {at, 1});
      if (known.count(at) != 0) {
        EXPECT_EQ(one.size(), 4u) << at;
      } else {
        EXPECT_EQ(one, Exception(function, 2)) << at;
      }
      const bool pair = known.count(at) != 0 && known.count(at + 1) != 0;
      EXPECT_EQ(Ask(function, {at, 2}).size(), pair ? 6u : 2u) << at;
    }
  };
  check(axis_holding, AXIS_HOLDING_COUNT, 3);
  check(axis_input, AXIS_INPUT_COUNT, 4);
}

TEST_F(Modbus, NegativeValuesAreTwosComplement) {
  Own();
  EXPECT_EQ(Ask(6, {0x0001, 0xFFFE}), (Bytes{6, 0, 1, 0xFF, 0xFE}));  // modes_of_operation, i8
  EXPECT_EQ(Read(AXIS_OBJ_MODES_OF_OPERATION), -2);
  EXPECT_EQ(Write16(0x0002, {0xFFFF, 0xFF85}), (Bytes{16, 0, 2, 0, 2}));
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), -123);
  EXPECT_EQ(ReadRegisters(3, 1, 3), (std::vector<unsigned>{0xFFFE, 0xFFFF, 0xFF85}));
  Set(AXIS_OBJ_MODBUS_WORD_ORDER, 1);
  EXPECT_EQ(Write16(0x0002, {0x0007, 0xFFFF}), (Bytes{16, 0, 2, 0, 2}));
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), -65536 + 7);
  EXPECT_EQ(Ask(6, {0x0001, 0x01FF}), Exception(6, 3)) << "511 is not -1";
}

TEST_F(Modbus, A32BitObjectIsWrittenWhole) {
  Own();
  EXPECT_EQ(Ask(6, {2, 1}), Exception(6, 3));
  EXPECT_EQ(Ask(6, {3, 1}), Exception(6, 3));
  EXPECT_EQ(Write16(3, {1}), Exception(16, 3));
  EXPECT_EQ(Write16(3, {1, 2, 3}), Exception(16, 3));
  EXPECT_EQ(Write16(1, {1, 0}), Exception(16, 3));
  EXPECT_EQ(Ask(22, {2, 0, 1}), Exception(22, 3));
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 0);
  EXPECT_EQ(Read(AXIS_OBJ_MODES_OF_OPERATION), 0);
}

TEST_F(Modbus, AWriteOfSeveralRegistersIsAllOrNothing) {
  Own();
  Set(AXIS_OBJ_FORCE_GAIN, 11);
  // force_gain .. adc_bits: the last one is out of range.
  EXPECT_EQ(Write16(0x10C, {256, 0, 100, 5, 1, 0, 0, 17}), Exception(16, 3));
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_GAIN), 11);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SETPOINT), 0);
  EXPECT_EQ(Write16(0x10C, {256, 0, 100, 5, 0xFFFF, 0, 0, 12}), (Bytes{16, 1, 0x0C, 0, 8}));
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_GAIN), 256);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SETPOINT), 100);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SIGN), -1);
  EXPECT_EQ(Read(AXIS_OBJ_ADC_BITS), 12);
  // Each limit fits the stored other one, but not the new one: the second is refused when it is
  // written.
  Set(AXIS_OBJ_POSITION_MIN, -100);
  Set(AXIS_OBJ_POSITION_MAX, 100);
  EXPECT_EQ(Write16(0x11D, {0, 90, 0, 80}), Exception(16, 3));
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_MIN), -100);
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_MAX), 100);
  // A hole behind, a register before.
  EXPECT_EQ(Write16(8, {500, 0}), Exception(16, 2));
  EXPECT_EQ(Read(AXIS_OBJ_WATCHDOG), 1000);
  // Two commands that cannot be undone.
  EXPECT_EQ(Write16(0x1F0, {1, 1}), Exception(16, 3));
}

// A mode, its target and the controlword in one request: the word finds the target.
TEST_F(Modbus, TheControlwordActsLast) {
  Own();
  EXPECT_EQ(Write16(0, {6, 8, 0, 1234, 0xFFFF, 0xFFFF, 10}).size(), 5u);
  Tick();
  EXPECT_EQ(Write16(0, {15, 8, 0, 1234, 0, 3, 10}).size(), 5u);
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 1234);
  // One of them out of range: the axis stays as it is.
  EXPECT_EQ(Write16(0, {0, 8, 0, 99, 0x7FFF, 0xFFFF, 10}), Exception(16, 3));
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  EXPECT_EQ(Read(AXIS_OBJ_TARGET_POSITION), 1234);
  EXPECT_EQ(Ask(6, {0x010F, 1}), Exception(6, 4)) << "force_zero_code: only while disabled";
}

TEST_F(Modbus, FunctionsThatWrite) {
  Own();
  EXPECT_EQ(Ask(6, {0x010C, 1280}), (Bytes{6, 1, 0x0C, 5, 0}));
  EXPECT_EQ(Ask(22, {0x010C, 0x0F00, 0x00FF}), (Bytes{22, 1, 0x0C, 0x0F, 0, 0, 0xFF}));
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_GAIN), 0x05FF);
  // 23: written first, then read.
  Bytes pdu{23};
  for (unsigned word : {0x010Cu, 1u, 0x0114u, 2u}) Add(pdu, word);
  pdu.push_back(4);
  for (unsigned word : {77u, 88u}) Add(pdu, word);
  EXPECT_EQ(Ask(pdu), (Bytes{23, 2, 5, 0xFF}));
  EXPECT_EQ(Read(AXIS_OBJ_VELOCITY_GAIN), 88);
  pdu[1] = 0x33;  // a range that is not there: then nothing is written
  pdu[12] = 99;
  EXPECT_EQ(Ask(pdu), Exception(23, 2));
  EXPECT_EQ(Read(AXIS_OBJ_POSITION_GAIN), 77);
  EXPECT_EQ(Ask(6, {0x0009, 0}), Exception(6, 2));
}

TEST_F(Modbus, CommandsReadAsTheirDefault) {
  EXPECT_EQ(ReadRegisters(3, 0x1F0, 2), (std::vector<unsigned>{0, 0}));
  Own();
  EXPECT_EQ(Ask(6, {0x1F0, 1}), Exception(6, 4)) << "there is no memory";
  EXPECT_EQ(Ask(6, {0x1F0, 0}), Exception(6, 3));
}

TEST_F(Modbus, CountsAreChecked) {
  for (uint8_t function : {1, 2, 3, 4}) {
    EXPECT_EQ(Ask(function, {0, 0}), Exception(function, 3));
    EXPECT_EQ(Ask(function, {0, function < 3 ? 2001u : 126u}), Exception(function, 3));
    EXPECT_EQ(Ask(function, {0, function < 3 ? 2000u : 125u}), Exception(function, 2));
  }
  EXPECT_EQ(Ask(Bytes{16, 1, 0x0C, 0, 1, 4, 0, 0, 0, 0}), Exception(16, 3)) << "byte count";
  EXPECT_EQ(Ask(Bytes{16, 1, 0x0C, 0, 0, 0}), Exception(16, 3));
  EXPECT_EQ(Ask(Bytes{15, 0, 0, 0, 0, 0}), Exception(15, 3));
  EXPECT_EQ(Ask(Bytes{15, 0, 0, 0, 1, 2, 0, 0}), Exception(15, 3));
  EXPECT_EQ(Ask(Bytes{23, 0, 0, 0, 1, 0, 0, 0, 0, 0}), Exception(23, 3));
}

TEST_F(Modbus, CanopenOwnsUntilTheLockIsAcquired) {
  EXPECT_EQ(Ask(6, {0x010C, 5}), Exception(6, 4));
  EXPECT_EQ(Ask(5, {0, 0xFF00}), Exception(5, 4));
  EXPECT_EQ(Ask(5, {1, 0x0000}), Exception(5, 4));
  EXPECT_EQ(ReadRegisters(3, 0x010C, 1), (std::vector<unsigned>{0})) << "reading is free";
  EXPECT_EQ(Ask(6, {7, 2}), Exception(6, 4)) << "not in the name of another";
  EXPECT_EQ(Write16(6, {1, 1}), Exception(16, 4));
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_SOURCE), AXIS_COMMAND_SOURCE_CANOPEN);
  // Acquired and used in one request.
  EXPECT_EQ(Write16(7, {1, 100}), (Bytes{16, 0, 7, 0, 2}));
  EXPECT_EQ(Read(AXIS_OBJ_WATCHDOG), 100);
  EXPECT_EQ(Ask(6, {0x010C, 5}).size(), 5u);
  // Acquired in a request that is refused: not acquired.
  EXPECT_EQ(Ask(6, {7, 0}).size(), 5u);
  EXPECT_EQ(Write16(7, {1, 9}), Exception(16, 3));
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_SOURCE), AXIS_COMMAND_SOURCE_CANOPEN);
}

// 100 ms are 150 ticks; what is written feeds it, also what was there already. A request that
// reads, one that is refused and a broken one do not.
TEST_F(Modbus, TheWatchdogIsFedByWritesThatAreAccepted) {
  EXPECT_EQ(Write16(7, {1, 100}).size(), 5u);
  for (int i = 0; i < 5; ++i) {
    Tick(149);
    EXPECT_EQ(Read(AXIS_OBJ_COMMAND_SOURCE), AXIS_COMMAND_SOURCE_MODBUS);
    EXPECT_EQ(Write16(8, {100}).size(), 5u);
  }
  Tick(149);
  EXPECT_EQ(Ask(4, {0, 1}).size(), 4u);
  EXPECT_EQ(Ask(3, {0, 9}).size(), 20u);
  EXPECT_EQ(Write16(8, {1}), Exception(16, 3));
  Send({kUnit, 6, 0, 8, 0, 100, 0, 0});
  Tick(2);
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_SOURCE), AXIS_COMMAND_SOURCE_CANOPEN);
}

TEST_F(Modbus, CoilsDriveTheStateMachine) {
  Own();
  EXPECT_EQ(Ask(1, {0, 5}), (Bytes{1, 1, 0}));
  Set(AXIS_OBJ_MODES_OF_OPERATION, 8);
  EXPECT_EQ(Ask(5, {0, 0xFF00}), (Bytes{5, 0, 0, 0xFF, 0}));
  Tick(2);
  EXPECT_EQ(Read(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_OPERATION_ENABLED);
  EXPECT_EQ(outputs_.amp_enable, 1);
  EXPECT_EQ(Ask(5, {2, 0xFF00}).size(), 5u);
  EXPECT_EQ(Ask(1, {0, 5}), (Bytes{1, 1, 0b00101}));
  EXPECT_EQ(Ask(Bytes{15, 0, 0, 0, 3, 1, 0}), (Bytes{15, 0, 0, 0, 3}));
  Tick(2);
  EXPECT_EQ(Ask(1, {0, 5}), (Bytes{1, 1, 0}));
  EXPECT_EQ(outputs_.amp_enable, 0);
  EXPECT_EQ(Read(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_READY_TO_SWITCH_ON);
  EXPECT_EQ(Ask(1, {5, 1}), Exception(1, 2));
  EXPECT_EQ(Ask(1, {0, 6}), Exception(1, 2));
  EXPECT_EQ(Ask(5, {5, 0xFF00}), Exception(5, 2));
  EXPECT_EQ(Ask(5, {0, 0x0001}), Exception(5, 3));
}

TEST_F(Modbus, AFaultIsResetByItsCoil) {
  Own();
  const axis_inputs_t broken{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 0, 0, 0, 0};
  fw_tick(&fw_, &broken, &outputs_);
  Tick(3);
  ASSERT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_SENSOR_INVALID);
  EXPECT_EQ(Ask(2, {3, 1}), (Bytes{2, 1, 1}));
  EXPECT_EQ(Ask(5, {0, 0xFF00}), Exception(5, 4));
  EXPECT_EQ(Ask(5, {1, 0xFF00}).size(), 5u);
  Tick();
  EXPECT_EQ(Read(AXIS_OBJ_FAULT), AXIS_FAULT_NONE);
  EXPECT_EQ(outputs_.amp_enable, 0);
  EXPECT_EQ(Ask(5, {0, 0xFF00}).size(), 5u);
}

TEST_F(Modbus, StoreAndEnableAreTwoRequests) {
  Own();
  EXPECT_EQ(Ask(Bytes{15, 0, 0, 0, 4, 1, 0b1001}), Exception(15, 3));
  Tick(2);
  EXPECT_EQ(Read(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_SWITCH_ON_DISABLED);
  EXPECT_EQ(Read(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_EMPTY);
}

// The values are checked before the request acquires the axis.
TEST_F(Modbus, ARefusedRequestLeavesTheAxisToItsOwner) {
  for (const int owner : {AXIS_COMMAND_SOURCE_CANOPEN, AXIS_COMMAND_SOURCE_LCM}) {
    Set(AXIS_OBJ_COMMAND_SOURCE, owner);
    EXPECT_EQ(Write16(7, {1, 9}), Exception(16, 3)) << "a watchdog of 9 ms";
    EXPECT_EQ(Read(AXIS_OBJ_COMMAND_SOURCE), owner);
  }
  EXPECT_EQ(Write16(7, {1, 100}).size(), 5u);
  EXPECT_EQ(Read(AXIS_OBJ_COMMAND_SOURCE), AXIS_COMMAND_SOURCE_MODBUS);
}

TEST_F(Modbus, TheRecorderHasACoil) {
  Own();
  EXPECT_EQ(Ask(5, {4, 0xFF00}), Exception(5, 3)) << "no channel yet";
  EXPECT_EQ(Write16(0x12A, {0x20, 0x2300}).size(), 5u);  // position
  EXPECT_EQ(Ask(Bytes{15, 0, 3, 0, 2, 1, 3}), Exception(15, 3)) << "store and recorder at once";
  EXPECT_EQ(Ask(5, {4, 0xFF00}).size(), 5u);
  EXPECT_EQ(Ask(1, {4, 1}), (Bytes{1, 1, 1}));
  EXPECT_EQ(Ask(5, {4, 0x0000}).size(), 5u);
  EXPECT_EQ(Ask(1, {4, 1}), (Bytes{1, 1, 0}));
}

TEST_F(Modbus, DiscreteInputsAreTheStatusword) {
  Tick();
  const auto status = static_cast<unsigned>(Read(AXIS_OBJ_STATUSWORD));
  EXPECT_NE(status, 0u);
  const Bytes all = Ask(2, {0, 19});
  ASSERT_EQ(all.size(), 5u);
  EXPECT_EQ(all[2] + 256u * all[3], status);
  EXPECT_EQ(all[4], 0);
  for (unsigned bit = 0; bit < 16; ++bit) {
    EXPECT_EQ(Ask(2, {bit, 1}), (Bytes{2, 1, static_cast<uint8_t>((status >> bit) & 1)}));
  }
  EXPECT_EQ(Ask(2, {0, 20}), Exception(2, 2));
  EXPECT_EQ(Ask(2, {19, 1}), Exception(2, 2));
}

struct Memory {
  Bytes bytes = Bytes(2 * STORE_SECTOR_MIN, 0xFF);
  store_memory_t memory{this, STORE_SECTOR_MIN,
                        [](void *c, uint32_t at, uint8_t *to, uint32_t n) {
                          std::copy_n(static_cast<Memory *>(c)->bytes.begin() + at, n, to);
                        },
                        [](void *c, uint32_t at, const uint8_t *from, uint32_t n) {
                          std::copy_n(from, n, static_cast<Memory *>(c)->bytes.begin() + at);
                          return true;
                        },
                        [](void *c, uint8_t sector) {
                          std::fill_n(
                              static_cast<Memory *>(c)->bytes.begin() + sector * STORE_SECTOR_MIN,
                              STORE_SECTOR_MIN, uint8_t{0xFF});
                          return true;
                        }};
};

TEST_F(Modbus, BusyWhileTheStoreIsAtWork) {
  Memory memory;
  fw_config_t config{};
  config.memory = &memory.memory;
  config.node_id = kUnit;
  config.buses = 1;
  fw_init(&fw_, &config);
  Own();
  EXPECT_EQ(Ask(6, {0x1F0, 1}), (Bytes{6, 1, 0xF0, 0, 1}));
  EXPECT_EQ(Ask(6, {0x1F0, 1}), Exception(6, 6));
  EXPECT_EQ(Ask(6, {0x010C, 1}), Exception(6, 6));
  EXPECT_EQ(Ask(5, {3, 0xFF00}), Exception(5, 6));
  EXPECT_EQ(Ask(1, {3, 1}), (Bytes{1, 1, 1}));
  EXPECT_EQ(Counter(17), 3u);
  Tick(600);
  EXPECT_EQ(Ask(1, {3, 1}), (Bytes{1, 1, 0}));
  EXPECT_EQ(ReadRegisters(4, 0x152, 1), (std::vector<unsigned>{AXIS_STORE_STATE_SAVED}));
  EXPECT_EQ(Ask(6, {0x010C, 1}).size(), 5u);
}

// While the store is busy the old controlword, which would enable, is refused; halt must be in the
// new one.
TEST_F(Modbus, HaltIsNotLostBesideStore) {
  Memory memory;
  fw_config_t config{};
  config.memory = &memory.memory;
  config.node_id = kUnit;
  config.buses = 1;
  fw_init(&fw_, &config);
  Own();
  Set(AXIS_OBJ_MODES_OF_OPERATION, 8);
  Tick();
  ASSERT_EQ(Ask(5, {0, 0xFF00}).size(), 5u);
  const axis_inputs_t broken{0, {0, 0}, AXIS_DIGITAL_INPUTS_ENABLE, 0, 0, 0, 0};
  fw_tick(&fw_, &broken, &outputs_);
  Tick(3);
  ASSERT_EQ(Read(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_FAULT);
  ASSERT_EQ(Read(AXIS_OBJ_CONTROLWORD), 0x000F);
  // Not enable, no fault reset, halt, store.
  EXPECT_EQ(Ask(Bytes{15, 0, 0, 0, 4, 1, 0b1100}), (Bytes{15, 0, 0, 0, 4}));
  EXPECT_EQ(Read(AXIS_OBJ_CONTROLWORD), 0x0106);
  EXPECT_EQ(Read(AXIS_OBJ_STORE_STATE), AXIS_STORE_STATE_SAVING);
}

std::string TextOf(const Bytes &answer, size_t at) {
  return {answer.begin() + static_cast<std::ptrdiff_t>(at) + 2,
          answer.begin() + static_cast<std::ptrdiff_t>(at) + 2 + answer[at + 1]};
}

TEST_F(Modbus, Identification) {
  const Bytes basic = Ask(Bytes{43, 14, 1, 0});
  ASSERT_GT(basic.size(), 7u);
  EXPECT_EQ(Bytes(basic.begin(), basic.begin() + 7), (Bytes{43, 14, 1, 0x83, 0, 0, 3}));
  EXPECT_EQ(basic[7], 0);
  EXPECT_EQ(TextOf(basic, 7), "forceaxis");
  EXPECT_EQ(Ask(Bytes{43, 14, 2, 0})[6], 5);
  EXPECT_EQ(Ask(Bytes{43, 14, 3, 0})[6], 6);
  const Bytes hash = Ask(Bytes{43, 14, 4, 0x80});
  EXPECT_EQ(hash[6], 1);
  EXPECT_EQ(TextOf(hash, 7), AXIS_OBJECTS_HASH_TEXT);
  EXPECT_EQ(Ask(Bytes{43, 14, 4, 0x70}), Exception(43, 2));
  EXPECT_EQ(Ask(Bytes{43, 14, 5, 0}), Exception(43, 3));
  EXPECT_EQ(Ask(Bytes{43, 13, 1, 0}), Exception(43, 1));
  const Bytes server = Ask(Bytes{17});
  EXPECT_EQ(server, (Bytes{17, 11, kUnit, 0, 'f', 'o', 'r', 'c', 'e', 'a', 'x', 'i', 's'}));
}

// In every unit, since the CRC of some of these frames ends in 0: it matches one byte early.
TEST_F(Modbus, AnUnknownFunctionIsAnsweredEachTime) {
  unsigned early = 0;
  for (uint8_t unit = 1; unit <= 31; ++unit) {
    fw_config_t config = NodeConfig();
    config.node_id = unit;
    fw_init(&fw_, &config);
    for (const int function : {120, 126}) {
      const auto code = static_cast<uint8_t>(function);
      for (int data = 0; data < 256; ++data) {
        const Bytes frame = RtuFrame(unit, {code, static_cast<uint8_t>(data)});
        early += frame.back() == 0 ? 1 : 0;
        for (int repeat = 0; repeat < 2; ++repeat) {
          Send(frame);
          Bytes answer = Fetch();
          for (int tick = 0; answer.empty() && tick < kSilence; ++tick) {
            Tick();
            answer = Fetch();
          }
          // The client sends again as soon as it is answered.
          ASSERT_EQ(answer, RtuFrame(unit, Exception(code, 1))) << function << ' ' << data;
        }
      }
    }
  }
  EXPECT_GT(early, 30u);
}

TEST_F(Modbus, UnknownFunctions) {
  for (int function = 1; function < 128; ++function) {
    const bool known = function <= 6 || function == 8 || (function >= 15 && function <= 17) ||
                       function == 22 || function == 23 || function == 43;
    if (known) continue;
    const auto code = static_cast<uint8_t>(function);
    for (uint8_t length = 1; length < 8; ++length) {
      Bytes pdu(length, 0);
      pdu[0] = code;
      for (int repeat = 0; repeat < 2; ++repeat) {
        // The next request follows the answer at once.
        Send(RtuFrame(kUnit, pdu));
        EXPECT_TRUE(Fetch().empty()) << "its length is not known";
        Tick(kSilence);
        EXPECT_EQ(Fetch(), RtuFrame(kUnit, Exception(code, 1))) << function << ' ' << int{length};
      }
    }
  }
  EXPECT_EQ(Ask(8, {1, 0}), Exception(8, 1));
  EXPECT_EQ(Ask(8, {19, 0}), Exception(8, 1));
}

const Bytes kRequest = Closed({kUnit, 4, 0, 0, 0, 1});

TEST_F(Modbus, OtherUnitsAndBroadcastsGetNoAnswer) {
  Own();
  for (int unit = 0; unit < 256; ++unit) {
    const auto id = static_cast<uint8_t>(unit);
    EXPECT_EQ(Ask(4, {0, 1}, id).empty(), id != kUnit) << unit;
    EXPECT_EQ(Ask(6, {0x010C, static_cast<unsigned>(unit) + 1}, id).empty(), id != kUnit) << unit;
    EXPECT_EQ(Read(AXIS_OBJ_FORCE_GAIN), unit < kUnit ? 1 : kUnit + 1) << unit;
    // Answers of others, which look like requests of another length.
    EXPECT_TRUE(id == kUnit || Ask(Bytes{3, 4, 1, 2, 3, 4}, id).empty());
    Tick(kSilence);
    EXPECT_TRUE(Fetch().empty());
  }
}

TEST_F(Modbus, ServedWithTheLastByteHoweverTheyCome) {
  for (size_t i = 0; i + 1 < kRequest.size(); ++i) {
    Send({kRequest[i]});
    EXPECT_TRUE(Fetch().empty());
    Tick(kSilence - 1);  // one more would end the frame
  }
  Send({kRequest.back()});
  EXPECT_EQ(Fetch().size(), 7u);
}

// 1.75 ms, 2.6 ticks, above 19200 baud; else 3.5 characters: 3.0078 ticks at 19200, 48.1 at 1200.
TEST_F(Modbus, ASilenceEndsAFrame) {
  const std::pair<uint32_t, int> cases[] = {{0, 3}, {115200, 3}, {19200, 4}, {1200, 49}};
  for (const auto &[baud, ticks] : cases) {
    PowerUp(baud);
    Send({kRequest.begin(), kRequest.begin() + 3});
    Tick(ticks);  // the bytes arrive in the first one
    Send({kRequest.begin() + 3, kRequest.end()});
    EXPECT_EQ(Fetch().size(), 7u) << baud;
    Send({kRequest.begin(), kRequest.begin() + 3});
    Tick(ticks + 1);
    Send(kRequest);
    EXPECT_EQ(Fetch().size(), 7u) << baud;
    EXPECT_EQ(Counter(12), 1u) << baud;
  }
}

TEST_F(Modbus, AFlippedBitIsSilentAndCounted) {
  unsigned expected = 0;
  for (size_t bit = 0; bit < 8 * kRequest.size(); ++bit) {
    Bytes frame = kRequest;
    frame[bit / 8] ^= static_cast<uint8_t>(1u << (bit % 8));
    Send(frame);
    EXPECT_TRUE(Fetch().empty()) << bit;
    Tick(kSilence);
    EXPECT_TRUE(Fetch().empty()) << bit;
    ++expected;
  }
  EXPECT_EQ(Counter(12), expected);
}

TEST_F(Modbus, CutAndOverlongFramesResynchronise) {
  for (size_t length = 1; length < kRequest.size(); ++length) {
    Send({kRequest.begin(), kRequest.begin() + static_cast<std::ptrdiff_t>(length)});
    Tick(kSilence);
    EXPECT_TRUE(Fetch().empty());
    Send(kRequest);
    EXPECT_EQ(Fetch().size(), 7u) << length;
  }
  for (size_t length : {9u, 255u, 256u, 257u, 1000u}) {
    Bytes frame(length, 0x11);
    frame[0] = kUnit;
    frame[1] = 16;
    Send(frame);
    Tick(kSilence);
    EXPECT_TRUE(Fetch().empty());
    Send(kRequest);
    EXPECT_EQ(Fetch().size(), 7u) << length;
  }
  // Whole, but not as long as its function says: an exception, after the silence.
  Send(Closed({kUnit, 3, 0, 0, 0, 1, 0, 0}));
  EXPECT_TRUE(Fetch().empty());
  Tick(kSilence);
  EXPECT_EQ(Fetch(), Closed({kUnit, 0x83, 3}));
  Send(Closed({kUnit, 16, 0, 0, 0, 1, 20, 0, 0}));
  Tick(kSilence);
  EXPECT_EQ(Fetch(), Closed({kUnit, 0x90, 3}));
}

// Frames of other units close by their CRC, so the next request needs no silence before it.
TEST_F(Modbus, BackToBackBehindOtherUnits) {
  Bytes line;
  for (const Bytes &frame : {Closed({9, 3, 0, 0, 0, 2}), Closed({9, 3, 4, 1, 2, 3, 4}), kRequest}) {
    line.insert(line.end(), frame.begin(), frame.end());
  }
  Send(line);
  EXPECT_EQ(Fetch().size(), 7u);
  EXPECT_EQ(Counter(11), 4u);
}

TEST_F(Modbus, BytesDuringAnAnswerAreLostAndCounted) {
  Send(kRequest);
  Send(kRequest);
  EXPECT_EQ(Fetch().size(), 7u);
  Tick(kSilence);
  Send(kRequest);
  EXPECT_EQ(Fetch().size(), 7u);
  EXPECT_EQ(Counter(18), 1u);
}

TEST_F(Modbus, Counters) {
  Own();
  Ask(4, {0, 1});
  Ask(4, {0, 1}, 9);
  Ask(4, {0x50, 1});
  Ask(6, {0x010C, 1}, 0);
  Send({1, 2, 3, 4, 5});
  Tick(kSilence);
  EXPECT_EQ(Counter(11), 5u);
  EXPECT_EQ(Counter(12), 1u);
  EXPECT_EQ(Counter(13), 1u);
  EXPECT_EQ(Counter(14), 7u);  // three, and the requests of this test
  EXPECT_EQ(Counter(15), 1u);
  EXPECT_EQ(Counter(16), 0u);
  EXPECT_EQ(Ask(8, {10, 0}), (Bytes{8, 0, 10, 0, 0}));
  EXPECT_EQ(Counter(13), 0u);
  EXPECT_EQ(Ask(8, {11, 1}), Exception(8, 3));
  EXPECT_EQ(Ask(Bytes{8, 0, 0, 1, 2, 3}).size(), 0u);  // an echo of any length ...
  Tick(kSilence);
  EXPECT_EQ(Fetch(), Closed({kUnit, 8, 0, 0, 1, 2, 3}));  // ... after the silence
}

// Only frames with a valid CRC are answered, and after a silence the next request is.
TEST_F(Modbus, RandomBytes) {
  std::minstd_rand random(3);
  for (int round = 0; round < 20000; ++round) {
    Bytes bytes(1 + random() % 40);
    for (auto &byte : bytes) byte = static_cast<uint8_t>(random());
    if (round % 2 == 0) bytes[0] = kUnit;
    if (round % 3 == 0 && bytes.size() > 1) bytes[1] = static_cast<uint8_t>(random() % 24);
    if (round % 5 == 0) bytes = Closed(bytes);
    Send(bytes);
    Tick(static_cast<int>(random() % 3));
    for (const Bytes answer = Fetch(); !answer.empty();) {
      EXPECT_EQ(Crc16(answer), 0);
      EXPECT_EQ(answer[0], kUnit);
      break;
    }
    if (round % 100 == 0) {
      Tick(kSilence);
      Fetch();
      Send(kRequest);
      EXPECT_EQ(Fetch().size(), 7u) << round;
    }
  }
}

}  // namespace
