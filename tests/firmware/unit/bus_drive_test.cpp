// A drive on CANopen in place of DAC and encoder, and the force of a load cell in a frame.
#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

extern "C" {
#include "firmware/port/bus_drive.h"
}
#include "firmware/port/linux/load_cell.h"

namespace {

drive402_config_t settings() {
  drive402_config_t config{};
  config.scale_num = 10;
  config.scale_den = 1;
  config.target_max = 20000;
  config.heartbeat_ms = 50;
  config.heartbeat_timeout_ms = 200;
  config.sdo_timeout_ms = 100;
  config.wait_ms = 100;
  config.cycle_ms = 2;
  config.mode = DRIVE402_CSV;
  config.rpdo_type = 255;
  config.node_id = 9;
  config.own_node_id = 1;
  return config;
}

TEST(BusDrive, IsFittedBeforeItAnswersAndFailsWithoutADrive) {
  const drive402_config_t config = settings();
  bus_drive_t drive{};
  ASSERT_EQ(bus_drive_init(&drive, &config), DRIVE402_NONE);
  axis_inputs_t inputs{};
  bus_drive_sample(&drive, &inputs);
  EXPECT_EQ(inputs.drive, AXIS_DRIVE_REPORT_FITTED);
  EXPECT_EQ(inputs.position_age, 0) << "no law uses the position before the drive is on";
  const axis_outputs_t off{};
  can_frame_t frame;
  const axis_outputs_t on{0, 1, 0, 0, 0};
  for (const auto &outputs : {off, on}) {
    for (int tick = 0; tick < 400; ++tick) {
      bus_drive_act(&drive, &outputs);
      while (drive402_transmit(&drive.master, &frame)) continue;
    }
    bus_drive_sample(&drive, &inputs);
    const int fault = outputs.amp_enable != 0 ? AXIS_DRIVE_REPORT_FAULT : 0;
    EXPECT_EQ(inputs.drive, AXIS_DRIVE_REPORT_FITTED | fault) << "no boot-up within 100 ms";
  }
}

TEST(BusDrive, EnablingResetsWhatHasFailed) {
  const drive402_config_t config = settings();
  bus_drive_t drive{};
  ASSERT_EQ(bus_drive_init(&drive, &config), DRIVE402_NONE);
  axis_outputs_t outputs{};
  axis_inputs_t inputs{};
  can_frame_t frame;
  const auto tick = [&] {
    bus_drive_act(&drive, &outputs);
    while (drive402_transmit(&drive.master, &frame)) continue;
    bus_drive_sample(&drive, &inputs);
    return (inputs.drive & AXIS_DRIVE_REPORT_FAULT) != 0;
  };
  for (int i = 0; i < 400; ++i) tick();
  ASSERT_FALSE(tick()) << "a fault of a disabled axis would forbid every enabling";
  outputs.amp_enable = 1;
  EXPECT_FALSE(tick());
  for (int i = 0; i < 400; ++i) tick();
  EXPECT_TRUE(tick()) << "it failed again, and one enabling is one reset";
  outputs.amp_enable = 0;
  tick();
  outputs.amp_enable = 1;
  EXPECT_FALSE(tick());
}

TEST(BusDrive, ARefusedConfigurationIsAFault) {
  drive402_config_t config = settings();
  config.cycle_ms = 3;
  bus_drive_t drive{};
  EXPECT_NE(bus_drive_init(&drive, &config), DRIVE402_NONE);
  axis_inputs_t inputs{};
  bus_drive_sample(&drive, &inputs);
  EXPECT_EQ(inputs.drive, AXIS_DRIVE_REPORT_FITTED);
  const axis_outputs_t on{0, 1, 0, 0, 0};
  bus_drive_act(&drive, &on);
  bus_drive_sample(&drive, &inputs);
  EXPECT_EQ(inputs.drive, AXIS_DRIVE_REPORT_FITTED | AXIS_DRIVE_REPORT_FAULT);
}

TEST(BusDrive, ItsObjectsAreItsConfiguration) {
  device_params_t params{};
  drive402_config_t config;
  EXPECT_FALSE(bus_drive_config(&params, &config)) << "node id 0 is no drive";
  params.drive_node_id = 9;
  params.drive_mode = 10;
  params.drive_cycle = 5;
  params.drive_target_num = 3;
  params.drive_target_den = 2;
  params.drive_target_max = 1000;
  params.drive_target_acts = AXIS_DRIVE_TARGET_ACTS_AT_NEXT_SYNC;
  params.drive_lacks = DRIVE402_WITHOUT_SYNC_PERIOD | DRIVE402_WITHOUT_FOLLOWS;
  params.drive_differs = DRIVE402_WITHOUT_MODE;
  params.drive_wait = 65535;
  params.drive_sdo_timeout = 700;
  params.drive_quick_stop = 400;
  params.drive_heartbeat = 100;
  params.drive_heartbeat_timeout = 300;
  params.drive_abort_option = -1;
  ASSERT_TRUE(bus_drive_config(&params, &config));
  EXPECT_EQ(config.node_id, 9);
  EXPECT_EQ(config.mode, DRIVE402_CST);
  EXPECT_EQ(config.cycle_ms, 10);
  EXPECT_EQ(config.scale_num, 3u);
  EXPECT_EQ(config.scale_den, 2u);
  EXPECT_EQ(config.target_max, 1000);
  EXPECT_EQ(config.rpdo_type, 1);
  EXPECT_EQ(config.without, 0x4002);
  EXPECT_EQ(config.differs, 0x0400);
  EXPECT_EQ(config.wait_ms, 65535);
  EXPECT_EQ(config.sdo_timeout_ms, 700);
  EXPECT_EQ(config.quick_stop_ms, 400);
  EXPECT_EQ(config.heartbeat_ms, 100);
  EXPECT_EQ(config.heartbeat_timeout_ms, 300);
  EXPECT_EQ(config.abort_option, -1);
  EXPECT_EQ(config.scale_shift, 4) << "the drive gets the fraction of the code";
  for (const int node : {1, 126, 127}) {
    params.drive_node_id = static_cast<std::uint8_t>(node);
    ASSERT_TRUE(bus_drive_config(&params, &config));
    bus_drive_t drive{};
    EXPECT_EQ(bus_drive_init(&drive, &config), DRIVE402_NONE) << node;
  }
}

// The ADC code of some bytes from byte 2 of the frame on; -1 if the frame is not taken.
int code_of(std::vector<std::uint8_t> bytes, int shift, bool is_signed) {
  const load_cell_t cell{0x301, 2, static_cast<std::uint8_t>(bytes.size()),
                         static_cast<std::uint8_t>(shift), is_signed};
  can_frame_t frame{0x301, static_cast<std::uint8_t>(2 + bytes.size()), 0, {0xEE, 0xEE}};
  for (std::size_t i = 0; i < bytes.size(); ++i) frame.data[2 + i] = bytes[i];
  std::uint16_t code = 0;
  return load_cell_take(&cell, &frame, &code) ? code : -1;
}

TEST(LoadCell, ItsIntegerBecomesACode) {
  EXPECT_EQ(code_of({0x34, 0x12}, 0, false), 0x1234);
  EXPECT_EQ(code_of({0x34, 0x12}, 0, true), 0x1234 + 32768);
  EXPECT_EQ(code_of({0xFF, 0xFF}, 0, true), 32767);
  EXPECT_EQ(code_of({0xFF, 0xFF, 0xFF, 0xFF}, 8, true), 32767) << "-1 / 256 rounds down";
  EXPECT_EQ(code_of({0x00, 0x01, 0x00, 0x00}, 8, true), 32769);
  EXPECT_EQ(code_of({0xFF}, 0, false), 255);
  EXPECT_EQ(code_of({0xFF, 0xFF, 0x7F}, 0, true), 65535) << "beyond the range: the end of it";
  EXPECT_EQ(code_of({0x00, 0x00, 0x80}, 0, true), 0);
  EXPECT_EQ(code_of({0xFF, 0xFF, 0xFF, 0xFF}, 0, false), 65535);
  EXPECT_EQ(code_of({0xFF, 0xFF, 0xFF, 0xFF}, 31, false), 1);
}

TEST(LoadCell, OtherFramesAreNotTaken) {
  const load_cell_t cell{0x301, 0, 4, 0, true};
  std::uint16_t code = 7;
  for (const can_frame_t &frame :
       {can_frame_t{0x302, 8, 0, {}}, can_frame_t{0x301, 8, 1, {}}, can_frame_t{0x301, 3, 0, {}}})
    EXPECT_FALSE(load_cell_take(&cell, &frame, &code));
  EXPECT_EQ(code, 7);
}

}  // namespace
