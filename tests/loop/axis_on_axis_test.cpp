// An axis that presses by another one: the firmware of the first has a drive on CANopen, and this
// drive is the firmware of the second in cyclic synchronous velocity, with the amplifier for
// +-10 V, motor and workpiece of the laboratory. The load cell is a TPDO of the second axis.
// tests/wire/test_axis_on_axis.py has the same in real time on real CAN.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "firmware/port/host/firmware.hpp"
extern "C" {
#include "firmware/port/bus_drive.h"
}
#include "firmware/port/linux/load_cell.h"
#include "host/run/firmware_side.hpp"
#include "host/run/plant_side.hpp"

namespace forceaxis::host {
namespace {

constexpr std::uint8_t kDrive = 9;
constexpr std::uint32_t kLoadCell = 0x380 + kDrive;
constexpr int kCycleMs = 20;
constexpr double kNewtonsPerCode = 2.5;  // force_per_count of the laboratory
constexpr double kSetpointN = 75.0;

// Objects of the drive: the master owns it, gains of its position law, and its fault (0, 2021h)
// and the ADC code of its force (2026h) in the third TPDO at each SYNC.
const std::vector<drive402_entry_t> kObjects{
    {0x2301, 0, 1, AXIS_COMMAND_SOURCE_CANOPEN},
    {0x2010, 0, 2, 4 * 256},
    {0x2011, 0, 2, 20 * 256},
    {0x1802, 1, 4, 0xC0000000 | kLoadCell},
    {0x1802, 2, 1, 1},
    {0x1A02, 0, 1, 0},
    {0x1A02, 1, 4, 0x20210008},
    {0x1A02, 2, 4, 0x20260010},
    {0x1A02, 0, 1, 2},
    {0x1802, 1, 4, 0x40000000 | kLoadCell},
};

struct Pressed {
  double peak_N = 0.0;
  double settle_s = 0.0;  // from the contact to the last force outside 75 N +- 5 %
  double ripple_N = 0.0;  // peak to peak in the last second
  double last_N = 0.0;
  std::uint8_t fault = 0;
};

Pressed press(double approach_mm) {
  const std::vector<std::string> overrides{"approach=" + std::to_string(approach_mm * 1e-3)};
  const Experiment experiment = load_experiment(LOOP_DIR "/axis_on_axis.toml", overrides);
  PlantSide plant(experiment, {.trace = false, .audit = false});
  FirmwareSide axis(experiment, {});

  fw_config_t node{};
  node.node_id = kDrive;
  node.buses = 1;
  const std::unique_ptr<fw_t, void (*)(fw_t *)> drive(axis_host_create_with(&node),
                                                      axis_host_destroy);
  drive402_config_t config{};
  config.extra = kObjects.data();
  config.extra_count = static_cast<std::uint8_t>(kObjects.size());
  config.scale_num = 64;  // count/s for a DAC code
  config.scale_den = 1;
  config.target_max = 130000;
  config.heartbeat_ms = 50;
  config.heartbeat_timeout_ms = 200;
  config.sdo_timeout_ms = 100;
  config.wait_ms = 500;
  config.quick_stop_ms = 100;
  config.abort_option = 3;
  config.cycle_ms = kCycleMs;
  config.mode = DRIVE402_CSV;
  config.rpdo_type = 255;
  config.node_id = kDrive;
  config.own_node_id = 1;
  config.without = DRIVE402_WITHOUT_SYNC_PERIOD;
  bus_drive_t bus{};
  EXPECT_EQ(bus_drive_init(&bus, &config), DRIVE402_NONE);
  const load_cell_t cell{kLoadCell, 1, 2, 0, false};

  Pressed pressed;
  std::uint16_t force_code = 0;
  std::uint32_t force_age = 255;
  std::vector<double> forces;
  const auto exchange = [&](const axis_outputs_t &outputs) {
    bus_drive_act(&bus, &outputs);
    for (can_frame_t f{}; drive402_transmit(&bus.master, &f);) fw_can_receive(drive.get(), &f);
  };
  while (plant.running()) {
    const LinkInputs in = plant.sense();
    force_age++;
    for (can_frame_t f{}; fw_can_transmit(drive.get(), &f);) {
      drive402_receive(&bus.master, &f);
      if (load_cell_take(&cell, &f, &force_code)) {
        force_age = 0;
        forces.push_back(kNewtonsPerCode * force_code);
      }
    }
    axis_inputs_t said{};
    bus_drive_sample(&bus, &said);
    LinkInputs to_axis = in;
    to_axis.encoder_cnt = said.encoder_cnt;
    to_axis.position_age = said.position_age;
    to_axis.drive = said.drive;
    to_axis.adc0_code = force_code;
    to_axis.force_age = static_cast<std::uint8_t>(std::min<std::uint32_t>(force_age, 255));
    const LinkOutputs out = axis.tick(to_axis);
    if (pressed.fault == 0) pressed.fault = out.fault;
    exchange({out.dac_code, static_cast<std::uint8_t>(out.out & 1),
              static_cast<std::uint8_t>(out.out >> 1), 0, 0});

    const axis_inputs_t inputs{
        in.encoder_cnt, {in.adc0_code, in.adc1_code}, in.din, in.sensor_valid, 0, 0, 0};
    axis_outputs_t outputs{};
    fw_tick(drive.get(), &inputs, &outputs);
    plant.act(
        {in.tick, outputs.dac_code,
         static_cast<std::uint8_t>((outputs.amp_enable ? 1 : 0) | (outputs.brake_release ? 2 : 0)),
         0, 0, 1});
  }
  const auto touch = std::find_if(forces.begin(), forces.end(), [](double f) { return f > 0; });
  EXPECT_NE(touch, forces.end()) << drive402_reason_text(drive402_feedback(&bus.master).reason)
                                 << std::hex << drive402_feedback(&bus.master).failed_index;
  for (auto at = touch; at != forces.end(); ++at) {
    pressed.peak_N = std::max(pressed.peak_N, *at);
    if (std::abs(*at - kSetpointN) > 0.05 * kSetpointN)
      pressed.settle_s = 1e-3 * kCycleMs * static_cast<double>(at - touch + 1);
  }
  const auto last = std::minmax_element(forces.end() - 50, forces.end());
  pressed.last_N = forces.back();
  pressed.ripple_N = *last.second - *last.first;
  return pressed;
}

// The approach of 5 mm/s takes 0.1 mm in a cycle of 20 ms, so the contact comes at each of its 30
// ticks. tests/wire/test_axis_on_axis.py holds the same bands in real time.
TEST(AxisOnAxis, PressesWith75N) {
  for (int phase = 0; phase < 30; ++phase) {
    const Pressed pressed = press(4.0 + 0.1 * phase / 30);
    EXPECT_EQ(pressed.peak_N, kSetpointN) << phase;
    EXPECT_LE(pressed.settle_s, 0.26) << phase;
    EXPECT_EQ(pressed.ripple_N, 0.0) << phase;
    EXPECT_EQ(pressed.last_N, kSetpointN) << phase;
    EXPECT_EQ(pressed.fault, AXIS_FAULT_NONE) << phase;
  }
}

}  // namespace
}  // namespace forceaxis::host
