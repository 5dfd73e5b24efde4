// Anyone may stop the axis, only its owner moves it: every stop from every source against every
// owner, every silence, what holds the axis afterwards, and who is warned.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <vector>

#include "tests/firmware/unit/fw_fixture.hpp"

namespace {

constexpr int kHalt = 0x0100;

class FwStop : public Fw {
 protected:
  struct Stop {
    std::string source;
    std::string name;
    int by;      // AXIS_STOPPED_BY_, where it is not the owner's own
    bool halts;  // the axis stands, and stays enabled
    std::function<void()> act;
  };

  static const char *NameOf(Way way) {
    static constexpr const char *kNames[] = {"CANopen", "Modbus TCP", "LCM", "Modbus RTU"};
    return kNames[way];
  }

  static int ByOf(Way way) { return SourceOf(way) + 1; }

  std::vector<Stop> Stops() {
    static const std::vector<std::pair<std::string, int>> kWords{{"disable voltage", 0x00},
                                                                 {"quick stop", 0x02},
                                                                 {"shutdown", 0x06},
                                                                 {"disable operation", 0x07},
                                                                 {"halt", 0x0F | kHalt}};
    std::vector<Stop> stops;
    for (const auto &[name, word] : kWords) {
      const bool halts = word > 0xFF;
      for (Way way : kWays) {
        stops.push_back({NameOf(way), name, ByOf(way), halts,
                         [=, this] { EXPECT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, word), 0u); }});
      }
      stops.push_back(
          {"CANopen RPDO", name, AXIS_STOPPED_BY_CANOPEN, halts, [=, this] {
             Send(0x205, {static_cast<uint8_t>(word), static_cast<uint8_t>(word >> 8), 0xFE});
           }});
      stops.push_back({"port", name, AXIS_STOPPED_BY_PORT, halts,
                       [=, this] { Set(AXIS_OBJ_CONTROLWORD, word); }});
    }
    for (Way way : kWays) {
      stops.push_back({NameOf(way), "native mode disabled", ByOf(way), false,
                       [=, this] { EXPECT_EQ(Write(way, AXIS_OBJ_MODE, 0), 0u); }});
    }
    const auto coil = [this](unsigned number, bool value) {
      EXPECT_FALSE(IsException(AskRtu(Pdu(5, {number, value ? 0xFF00u : 0u}))));
    };
    stops.push_back({"Modbus RTU", "coil enable 0", AXIS_STOPPED_BY_MODBUS, false,
                     [=] { coil(AXIS_COIL_ENABLE, false); }});
    stops.push_back({"Modbus RTU", "coil halt 1", AXIS_STOPPED_BY_MODBUS, true,
                     [=] { coil(AXIS_COIL_HALT, true); }});
    stops.push_back({"Modbus RTU", "broadcast of 0", AXIS_STOPPED_BY_MODBUS, false, [this] {
                       EXPECT_TRUE(SendRtu(RtuFrame(0, Pdu(6, {0, 0}))).empty());
                     }});
    for (const auto &[name, command] : std::vector<std::pair<std::string, int>>{
             {"NMT stop", 2}, {"NMT reset node", 129}, {"NMT reset communication", 130}}) {
      stops.push_back({"CANopen", name, AXIS_STOPPED_BY_CANOPEN, false, [=, this] {
                         Send(0, {static_cast<uint8_t>(command), kNode});
                       }});
    }
    stops.push_back(
        {"CANopen", "another node of the same id", 0, false, [this] { Send(0x700 + kNode, {5}); }});
    stops.push_back({"CANopen", "bus off", AXIS_STOPPED_BY_CANOPEN, false,
                     [this] { fw_can_bus(&fw_, CAN_BUS_OFF); }});
    stops.push_back({"port", "native mode disabled", AXIS_STOPPED_BY_PORT, false,
                     [this] { Set(AXIS_OBJ_MODE, 0); }});
    stops.push_back({"port", "enable chain open", 0, false,
                     [this] { inputs_.din &= static_cast<uint8_t>(~AXIS_DIGITAL_INPUTS_ENABLE); }});
    stops.push_back({"port", "sensors not valid", 0, false, [this] { inputs_.sensor_valid = 0; }});
    return stops;
  }

  // No option asks for a ramp.
  void AtOnce() {
    Set(AXIS_OBJ_QUICK_STOP_OPTION, 0);
    Set(AXIS_OBJ_DISABLE_OPERATION_OPTION, 0);
    Set(AXIS_OBJ_SHUTDOWN_OPTION, 0);
    Set(AXIS_OBJ_FAULT_REACTION_OPTION, 0);
  }

  void Prepare(
      Way owner, const std::function<void()> &before = [] {}) {
    PowerUp();
    Set(AXIS_OBJ_WATCHDOG, 60000);
    AtOnce();
    Send(0, {1, kNode});
    before();
    Drive(owner);
  }

  // Nobody stops the axis, but somebody is no longer heard.
  struct Silence {
    std::string name;
    std::string of;
    std::function<void()> before;      // it is watched, while CANopen owns the axis
    std::function<void(Way)> last;     // the last sign of life
    std::function<void(Way)> ongoing;  // whatever goes on, 20 times a second
    // Ticks from there, in the order of kWays; 0: this owner is not missed.
    std::array<int, 4> ticks;
  };

  std::vector<Silence> Silences() {
    const auto nothing = [](Way) {};
    const auto heartbeat = [this](Way) { Send(0x77F, {5}); };
    const auto write = [this](Way way) {
      if (way == kCanopen) return;
      EXPECT_EQ(Write(way, AXIS_OBJ_WATCHDOG, 1000), 0u);
    };
    return {
        {"nothing written, watchdog 1000 ms (default)",
         "client",
         [this] { Set(AXIS_OBJ_WATCHDOG, 1000); },
         write,
         nothing,
         {0, 1501, 1501, 1501}},
        {"heartbeat missed, 300 ms in 1016h",
         "node",
         [this] { WatchHeartbeat(300); },
         heartbeat,
         nothing,
         {452, 452, 452, 0}},
        {"boot-up message, node in 1016h",
         "node",
         [this] { WatchHeartbeat(300); },
         [this](Way) { Send(0x77F, {0}); },
         nothing,
         {1, 1, 1, 0}},
        {"RPDO missed, 100 ms in 1400h:5",
         "CANopen",
         [this] { ASSERT_EQ(Download(kCanopen, 0x1400, 5, 100, 2), 0u); },
         [this](Way) {
           Send(0x205, {0x0F, 0x00, 0xFE});
         },
         nothing,
         {152, 0, 0, 0}},
        {"gateway killed: heartbeat 300 ms, watchdog 1000 ms (defaults)",
         "gateway",
         [this] { WatchHeartbeat(300); },
         [=](Way owner) {
           write(owner);
           heartbeat(owner);
         },
         [=](Way owner) {
           if (owner == kRtu) write(owner);
         },
         {452, 452, 452, 0}},
    };
  }

  // As TicksTo(), to the axis off; 0: it is still on after two seconds.
  int TicksTo(const Silence &silence, Way owner) {
    silence.last(owner);
    for (int i = 1; i <= 3000; ++i) {
      Tick();
      Take();
      if (IsOff()) return i;
      EXPECT_TRUE(IsOn());
      if (i % 75 == 0) silence.ongoing(owner);
    }
    return 0;
  }

  static std::string Documented() {
    std::ifstream file(STOP_TIMES_FILE);
    std::stringstream text;
    text << file.rdbuf();
    return text.str();
  }

  // The last cell of the documented row of this event, which is kept, and the end of the row.
  static std::string WallTime(const std::string &event, const std::string &source) {
    std::istringstream lines(Documented());
    for (std::string line; std::getline(lines, line);) {
      if (!line.starts_with("| " + event + " | " + source + " |")) continue;
      line.resize(line.size() - 1);
      return line.substr(line.rfind('|') + 1) + "|\n";
    }
    return " |\n";
  }

  bool Halted() const {
    return outputs_.dac_code != kCode && outputs_.amp_enable == 1 &&
           Inner(AXIS_OBJ_ACTIVE_MODE) == AXIS_MODE_POSITION;
  }

  // Ticks from the stop to code 0 and amplifier off, or to the axis held; 0: more than 10.
  int TicksTo(const Stop &stop) {
    stop.act();
    for (int i = 1; i <= 10; ++i) {
      Tick();
      if (stop.halts ? Halted() : IsOff()) return i;
      EXPECT_TRUE(IsOn());
    }
    return 0;
  }
};

// The test writes docs/stop_times.md itself, except the wall times and the text after the table,
// which tests/wire/stop_times_bench.py measures.
TEST_F(FwStop, EveryStopActsWhoeverOwns) {
  std::ostringstream table;
  table
      << R"(The four columns of owners give the ticks of 1/1500 s from an event to DAC code 0 with the amplifier
off. For a halt they give the ticks until the axis is controlled at standstill. Options that select a
ramp are off. "-": the event does not stop the axis.

| event | source |)";
  for (Way owner : kWays) table << " owner " << NameOf(owner) << " |";
  table << " wall clock, ms |\n|---|---|---|---|---|---|---|\n";
  for (size_t k = 0; k < Stops().size(); ++k) {
    const Stop stop = Stops()[k];
    table << "| " << stop.name << (stop.halts ? " (controlled)" : "") << " | " << stop.source
          << " |";
    for (Way owner : kWays) {
      Prepare(owner);
      const int ticks = TicksTo(stop);
      EXPECT_GE(ticks, 1) << stop.name << " from " << stop.source << ", owner " << NameOf(owner);
      EXPECT_LE(ticks, 2) << stop.name << " from " << stop.source << ", owner " << NameOf(owner);
      table << ' ' << ticks << " |";
    }
    table << WallTime(stop.name + (stop.halts ? " (controlled)" : ""), stop.source);
  }
  for (size_t k = 0; k < Silences().size(); ++k) {
    const Silence silence = Silences()[k];
    table << "| " << silence.name << " | " << silence.of << " |";
    for (size_t i = 0; i < kWays.size(); ++i) {
      Prepare(kWays[i], silence.before);
      const int ticks = TicksTo(silence, kWays[i]);
      EXPECT_EQ(ticks, silence.ticks[i]) << silence.name << ", owner " << NameOf(kWays[i]);
      table << ' ' << (ticks == 0 ? "-" : std::to_string(ticks)) << " |";
    }
    table << WallTime(silence.name, silence.of);
  }
  const std::string kept = Documented();
  table << kept.substr(std::min(kept.rfind("|\n") + 2, kept.size()));
  if (const char *path = std::getenv("STOP_TIMES")) std::ofstream(path) << table.str();
  EXPECT_EQ(kept, table.str())
      << "docs/stop_times.md is made by STOP_TIMES=docs/stop_times.md fw_unit "
         "--gtest_filter=FwStop.EveryStopActsWhoeverOwns";
}

// The owner goes on sending what it sent before: it never restarts the axis. One controlword that
// does not enable, then one that does, and the axis is the owner's again.
TEST_F(FwStop, TheOwnersUnchangedStreamNeverRestarts) {
  for (const Stop &stop : Stops()) {
    for (Way owner : kWays) {
      if (stop.by == 0 || stop.by == ByOf(owner) || stop.name.starts_with("NMT") ||
          stop.name == "bus off") {
        continue;  // its own; or the bus itself, below
      }
      Prepare(owner);
      ASSERT_GT(TicksTo(stop), 0);
      const std::string what = stop.name + " from " + stop.source + ", owner " + NameOf(owner);
      EXPECT_EQ(Inner(AXIS_OBJ_STOPPED_BY), stop.by) << what;
      EXPECT_EQ(Owner(), SourceOf(owner)) << what;
      Tick();
      EXPECT_NE(Read(kLcm, AXIS_OBJ_STATUSWORD) & 0x4000u, 0u) << what;
      EXPECT_EQ(Emergencies(), (std::vector<int>{0xFF08 | stop.by << 16}))
          << what << ": named once";
      for (int i = 0; i < 100; ++i) {
        EXPECT_NE(Write(owner, AXIS_OBJ_CONTROLWORD, 0x0F), 0u) << what << ": refused, not ignored";
        if (owner == kCanopen) Send(0x205, {0x0F, 0x00, 0xFE});
        Tick();
        ASSERT_TRUE(stop.halts ? Halted() : IsOff()) << what << ", tick " << i;
      }
      ASSERT_EQ(Write(owner, AXIS_OBJ_CONTROLWORD, 0x06), 0u) << what;
      EXPECT_EQ(Inner(AXIS_OBJ_STOPPED_BY), 0) << what;
      Tick(2);
      ASSERT_TRUE(IsOff()) << what;
      ASSERT_EQ(Write(owner, AXIS_OBJ_CONTROLWORD, 0x0F), 0u) << what;
      Tick(2);
      EXPECT_TRUE(IsOn()) << what;
      EXPECT_EQ(Read(kLcm, AXIS_OBJ_STATUSWORD) & 0x4000u, 0u) << what;
    }
  }
}

// A master that sends its controlword with every SYNC, and another that stops the axis between.
TEST_F(FwStop, ACyclicRpdoMasterIsHeldToo) {
  Prepare(kCanopen);
  ASSERT_EQ(Download(kCanopen, 0x1400, 1, 0x80000205u, 4), 0u);
  ASSERT_EQ(Download(kCanopen, 0x1400, 2, 1, 1), 0u);
  ASSERT_EQ(Download(kCanopen, 0x1400, 1, 0x00000205u, 4), 0u);
  const auto cycle = [this](int word) {
    Send(0x205, {static_cast<uint8_t>(word), 0x00, 0xFE});
    Send(0x80, {});
    Tick();
    Take();
  };
  for (int i = 0; i < 20; ++i) cycle(0x0F);
  ASSERT_TRUE(IsOn());
  ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x07), 0u);
  for (int i = 0; i < 500; ++i) {
    cycle(0x0F);
    ASSERT_TRUE(IsOff()) << i;
  }
  EXPECT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_SWITCHED_ON);
  cycle(0x07);
  cycle(0x0F);
  cycle(0x0F);
  EXPECT_TRUE(IsOn());
}

// The bus that stopped it names itself; so does the fault, where the option asks for one.
TEST_F(FwStop, NmtAndBusOffStopAnotherOnesAxis) {
  for (int option : {1, 2, 3}) {
    for (int how = 0; how < 3; ++how) {
      Prepare(kRtu);
      Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, option);
      if (how == 0) Send(0, {2, kNode});
      if (how == 1) Send(0, {130, kNode});
      if (how == 2) fw_can_bus(&fw_, CAN_BUS_OFF);
      EXPECT_LE(TicksToOff(10), 2);
      EXPECT_EQ(Owner(), AXIS_COMMAND_SOURCE_MODBUS) << "it is not taken from its owner";
      EXPECT_EQ(Inner(AXIS_OBJ_STOPPED_BY), AXIS_STOPPED_BY_CANOPEN);
      const int fault = how == 2 ? AXIS_FAULT_CAN_OFF : AXIS_FAULT_SOURCE_LOST;
      EXPECT_EQ(Inner(AXIS_OBJ_FAULT), option == 1 ? fault : 0);
      for (int i = 0; i < 50; ++i) {
        (void)Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x0F);
        Tick();
        ASSERT_TRUE(IsOff()) << option << how;
      }
      if (how == 2) fw_can_bus(&fw_, CAN_BUS_ACTIVE);
      ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x80), 0u);
      ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x00), 0u);
      ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
      ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
      Tick(2);
      EXPECT_EQ(outputs_.amp_enable, 1) << option << how;
    }
  }
}

// abort_connection_option 0: the axis goes on, and it is shown as stopped by nobody.
TEST_F(FwStop, AnAxisThatIsToGoOnIsNotHeld) {
  for (int how = 0; how < 2; ++how) {
    Prepare(kRtu);
    Set(AXIS_OBJ_ABORT_CONNECTION_OPTION, 0);
    if (how == 0) Send(0, {2, kNode});
    if (how == 1) fw_can_bus(&fw_, CAN_BUS_OFF);
    for (int i = 0; i < 50; ++i) {
      Tick();
      ASSERT_TRUE(IsOn()) << how;
    }
    EXPECT_EQ(Inner(AXIS_OBJ_STOPPED_BY), AXIS_STOPPED_BY_NOBODY) << how;
    EXPECT_EQ(Inner(AXIS_OBJ_STATUSWORD) & 0x4000, 0) << how;
    if (how == 0) Send(0, {1, kNode});
    if (how == 1) fw_can_bus(&fw_, CAN_BUS_ACTIVE);
    EXPECT_EQ(CountEmergencies(0xFF08), 0) << how;
  }
}

// A stop is carried out once: whatever else the node reports later repeats none.
TEST_F(FwStop, AStopOfTheBusIsNotRepeated) {
  Prepare(kRtu);
  Send(0, {2, kNode});
  EXPECT_EQ(TicksToOff(10), 1);
  Send(0, {1, kNode});
  for (int word : {0x80, 0x00}) ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, word), 0u);
  Drive(kRtu);
  fw_can_lost(&fw_, 1);
  Tick(10);
  EXPECT_TRUE(IsOn());
  EXPECT_EQ(Inner(AXIS_OBJ_STOPPED_BY), 0);
}

// Ramps, where the options ask for them, are not cut short by the owner either.
TEST_F(FwStop, ARampOfAnothersStopIsFinished) {
  PowerUp();
  Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
  Set(AXIS_OBJ_WATCHDOG, 60000);
  Set(AXIS_OBJ_QUICK_STOP_OPTION, 6);
  ASSERT_TRUE(Acquires(kLcm));
  ASSERT_EQ(Write(kLcm, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_PROFILE_VELOCITY), 0u);
  ASSERT_EQ(Write(kLcm, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  ASSERT_EQ(Write(kLcm, AXIS_OBJ_TARGET_VELOCITY, 30000), 0u);
  ASSERT_EQ(Write(kLcm, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  Tick(300);
  ASSERT_GT(Inner(AXIS_OBJ_VELOCITY_DEMAND), 0);
  ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x02), 0u);
  for (int i = 0; i < 3000; ++i) {
    EXPECT_NE(Write(kLcm, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    Tick();
    ASSERT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE) << i;
  }
  EXPECT_EQ(Inner(AXIS_OBJ_VELOCITY_DEMAND), 0);
  ASSERT_EQ(Write(kLcm, AXIS_OBJ_CONTROLWORD, 0x00), 0u);
}

// Every controlword of a source that does not own the axis, in every state: it may lower the state,
// never raise it, never reset a fault, never start a set-point.
TEST_F(FwStop, NoControlwordOfAnotherSourceStartsAnything) {
  const auto reach = [this](int state) {
    Prepare(kRtu);
    Set(AXIS_OBJ_QUICK_STOP_OPTION, 6);
    Set(AXIS_OBJ_FAULT_REACTION_OPTION, 1);
    switch (state) {
      case AXIS_DRIVE_STATE_SWITCH_ON_DISABLED:
        (void)Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x00);
        break;
      case AXIS_DRIVE_STATE_READY_TO_SWITCH_ON:
        (void)Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x06);
        break;
      case AXIS_DRIVE_STATE_SWITCHED_ON:
        (void)Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x07);
        break;
      case AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE:
        (void)Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x02);
        break;
      case AXIS_DRIVE_STATE_FAULT:
        inputs_.sensor_valid = 0;
        Tick();
        inputs_.sensor_valid = 1;
        break;
      default:
        break;
    }
    fw_.drive.signals.drive_state = static_cast<uint8_t>(
        state == AXIS_DRIVE_STATE_NOT_READY || state == AXIS_DRIVE_STATE_FAULT_REACTION_ACTIVE
            ? state
            : Inner(AXIS_OBJ_DRIVE_STATE));
    ASSERT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), state);
  };
  for (int state = 0; state < AXIS_DRIVE_STATE_COUNT; ++state) {
    reach(state);
    const fw_t reached = fw_;
    for (int word = 0; word < 65536; ++word) {
      fw_ = reached;
      const bool halts = (word & kHalt) != 0;
      const bool asks = halts || ((word & 0x80) == 0 && (word & 0x0F) != 0x0F);
      const int answer = fw_object_write(&fw_, FW_SOURCE_LCM, AXIS_OBJ_CONTROLWORD, word);
      ASSERT_EQ(answer, asks ? FW_OK : FW_ERROR_LOCKED) << state << ' ' << word;
      const int now = Inner(AXIS_OBJ_DRIVE_STATE);
      const bool lower = now < state || (now == AXIS_DRIVE_STATE_QUICK_STOP_ACTIVE &&
                                         state == AXIS_DRIVE_STATE_OPERATION_ENABLED);
      ASSERT_TRUE(now == state || lower) << state << ' ' << word;
      ASSERT_EQ(fw_.drive.acknowledged, reached.drive.acknowledged);
      ASSERT_EQ(fw_.drive.homing.state, reached.drive.homing.state);
      const int word_before = reached.drive.params.controlword;
      ASSERT_TRUE(fw_.drive.params.controlword == word_before ||
                  (halts && fw_.drive.params.controlword == (word_before | kHalt)));
      if (state == AXIS_DRIVE_STATE_OPERATION_ENABLED && asks && !halts) {
        ASSERT_TRUE(lower || fw_.drive.leaving != 0) << word;
      }
    }
  }
}

// It is not held by its own stops, and it releases the axis from one of its own or of a bus.
TEST_F(FwStop, ThePortIsNotHeld) {
  Prepare(kCanopen);
  Set(AXIS_OBJ_CONTROLWORD, 0x07);
  EXPECT_EQ(Inner(AXIS_OBJ_STOPPED_BY), AXIS_STOPPED_BY_PORT);
  Set(AXIS_OBJ_CONTROLWORD, 0x0F);
  EXPECT_EQ(Inner(AXIS_OBJ_STOPPED_BY), 0);
  Tick(2);
  EXPECT_TRUE(IsOn());
  ASSERT_EQ(Write(kLcm, AXIS_OBJ_CONTROLWORD, 0x07), 0u);
  Set(AXIS_OBJ_CONTROLWORD, 0x0F);
  Tick(2);
  EXPECT_TRUE(IsOn());
}

// While the axis is held its owner may stop it further, and halt.
TEST_F(FwStop, AHeldAxisIsStoppedFurtherByItsOwner) {
  Prepare(kRtu);
  ASSERT_EQ(Write(kLcm, AXIS_OBJ_CONTROLWORD, 0x07), 0u);
  EXPECT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x0F | kHalt), 0u) << "a halt is a stop";
  EXPECT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_SWITCHED_ON) << "and enables nothing";
  EXPECT_EQ(Inner(AXIS_OBJ_STOPPED_BY), AXIS_STOPPED_BY_LCM);
  EXPECT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x00), 0u);
  EXPECT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_SWITCH_ON_DISABLED);
}

// A stop does not wait for the store, which refuses what would enable the axis.
TEST_F(FwStop, AStopIsNotRefusedByABusyStore) {
  Prepare(kCanopen);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x07), 0u);
  fw_.store.step = 1;
  for (int word : {0x0F | kHalt, 0x07, 0x02}) {
    EXPECT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, word), 0u);
  }
  EXPECT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_SWITCH_ON_DISABLED);
}

// Who is not the owner feeds nobody's watchdog with its stops.
TEST_F(FwStop, AStopFeedsNoWatchdog) {
  Prepare(kLcm);
  ASSERT_EQ(Write(kLcm, AXIS_OBJ_WATCHDOG, 20), 0u);
  int ticks = 0;
  while (Owner() == AXIS_COMMAND_SOURCE_LCM && ticks < 100) {
    ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x00), 0u);
    Tick();
    ++ticks;
  }
  EXPECT_EQ(ticks, TicksOf(20) + 1);
}

// What is watched.

TEST_F(FwStop, AnOwnerThatNobodyWatchesIsReportedAtEnabling) {
  const auto warned = [this] { return (Inner(AXIS_OBJ_STATUSWORD) & 0x80) != 0; };
  const auto enable = [this](Way way) {
    ASSERT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
    ASSERT_EQ(Write(way, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
    Tick(2);
  };
  enable(kCanopen);
  EXPECT_TRUE(warned());
  EXPECT_EQ(Emergencies(), std::vector<int>{0xFF09});
  WatchHeartbeat(1000);
  Tick(2);
  EXPECT_TRUE(warned()) << "nobody was heard yet";
  Send(0x77F, {5});
  Tick(2);
  EXPECT_FALSE(warned()) << "watched from its first heartbeat on";
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  Tick(2);
  Emergencies();
  enable(kCanopen);
  EXPECT_FALSE(warned());
  EXPECT_TRUE(Emergencies().empty());
  PowerUp();
  ASSERT_TRUE(Acquires(kRtu));
  enable(kRtu);
  EXPECT_FALSE(warned()) << "others have their watchdog";
  EXPECT_TRUE(Emergencies().empty());
}

TEST_F(FwStop, AnOwnerThatNobodyWatchesIsRefusedWhereThatIsAsked) {
  Set(AXIS_OBJ_UNSUPERVISED_OWNER, AXIS_UNSUPERVISED_OWNER_REFUSED);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0x08000022u);
  EXPECT_EQ(Inner(AXIS_OBJ_DRIVE_STATE), AXIS_DRIVE_STATE_READY_TO_SWITCH_ON);
  WatchHeartbeat(1000);
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0x08000022u) << "never heard";
  Send(0x77F, {5});
  EXPECT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
  ASSERT_EQ(Write(kCanopen, AXIS_OBJ_CONTROLWORD, 0x00), 0u);
  ASSERT_TRUE(Acquires(kRtu));
  ASSERT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
  EXPECT_EQ(Write(kRtu, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
}

// A halt by another client: one controlword of the owner does not lift it, whatever it is; one that
// does not enable and then one that does, do.
TEST_F(Fw, AHaltByAnotherIsLiftedByTwoControlwords) {
  for (Way owner : {kCanopen, kLcm, kRtu}) {
    for (Way other : kWays) {
      if (SourceOf(other) == SourceOf(owner)) continue;
      for (int word : {0x80, 0x8F, 0x87, 0x0F}) {
        PowerUp();
        Set(AXIS_OBJ_POSITION_GAIN, 5 * 256);
        ASSERT_TRUE(Acquires(owner));
        ASSERT_EQ(
            Write(owner, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_PROFILE_VELOCITY),
            0u);
        ASSERT_EQ(Write(owner, AXIS_OBJ_TARGET_VELOCITY, 3000), 0u);
        ASSERT_EQ(Write(owner, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
        ASSERT_EQ(Write(owner, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
        Tick(100);
        ASSERT_NE(Inner(AXIS_OBJ_VELOCITY_DEMAND), 0);
        ASSERT_EQ(Write(other, AXIS_OBJ_CONTROLWORD, 0x10F), 0u);
        Tick(200);
        ASSERT_EQ(Inner(AXIS_OBJ_VELOCITY_DEMAND), 0);
        (void)Write(owner, AXIS_OBJ_CONTROLWORD, word);
        (void)Write(owner, AXIS_OBJ_CONTROLWORD, word);  // not by its repetition either
        for (int i = 0; i < 100; ++i) {
          Tick();
          ASSERT_EQ(Inner(AXIS_OBJ_VELOCITY_DEMAND), 0) << std::hex << word;
        }
        EXPECT_EQ(Write(owner, AXIS_OBJ_CONTROLWORD, 0x80), 0u);
        EXPECT_EQ(Write(owner, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
        Tick(100);
        EXPECT_NE(Inner(AXIS_OBJ_VELOCITY_DEMAND), 0) << std::hex << word;
      }
    }
  }
}

// Enabled by its owner and stopped by another in the same gap: never powered, by any kind of stop.
TEST_F(Fw, AStopInTheGapOfTheEnablingPowersNothing) {
  for (Way owner : kWays) {
    for (Way other : kWays) {
      for (int word : {0x02, 0x00, 0x06, 0x07}) {
        PowerUp();
        Set(AXIS_OBJ_QUICK_STOP_OPTION, 2);
        Set(AXIS_OBJ_SHUTDOWN_OPTION, 1);
        Set(AXIS_OBJ_DISABLE_OPERATION_OPTION, 1);
        ASSERT_TRUE(Acquires(owner));
        ASSERT_EQ(Write(owner, AXIS_OBJ_MODES_OF_OPERATION, AXIS_MODES_OF_OPERATION_OPEN_LOOP), 0u);
        ASSERT_EQ(Write(owner, AXIS_OBJ_CONTROLWORD, 0x06), 0u);
        Tick();
        ASSERT_EQ(Write(owner, AXIS_OBJ_CONTROLWORD, 0x0F), 0u);
        ASSERT_EQ(Write(other, AXIS_OBJ_CONTROLWORD, word), 0u);
        for (int i = 0; i < 5; ++i) {
          Tick();
          ASSERT_EQ(outputs_.amp_enable, 0) << word;
        }
      }
    }
  }
}

}  // namespace
