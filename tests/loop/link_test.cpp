// The link below real transports: frames byte by byte, and stop-and-wait over a wire that this test
// makes lose, double and delay.
#include <gtest/gtest.h>

#include <deque>
#include <random>

#include "host/link/can_transport.hpp"
#include "host/link/exchange.hpp"
#include "host/link/inject.hpp"
#include "host/link/late_ticks.hpp"
#include "host/link/lcm_transport.hpp"
#include "host/link/linked_run.hpp"
#include "host/run/firmware_side.hpp"
#include "host/run/plant_side.hpp"
#include "host/run/run.hpp"

namespace forceaxis::host {
namespace {

using std::chrono::milliseconds;

const std::string kContact = SIM_DIR "/experiments/contact.toml";

// By hand: direction 0, axis 3 is 2 << 25 = 04000000h, tick 4097 is 1 mod 4096, 1 << 13 = 2000h,
// inputs 1001b << 9 = 1200h; encoder -2 = FFFFFFFEh, adc0 300 = 012Ch, adc1 4095 = 0FFFh.
TEST(Frames, InputsByHand) {
  const can_frame f = can_frame_of(LinkInputs{4097, -2, 300, 4095, 9, 1, 3});
  EXPECT_EQ(f.can_id, 0x04003200U | CAN_EFF_FLAG);
  const std::vector<int> bytes(f.data, f.data + f.can_dlc);
  EXPECT_EQ(bytes, (std::vector<int>{0xFE, 0xFF, 0xFF, 0xFF, 0x2C, 0x01, 0xFF, 0x0F}));
  const auto back = link_inputs_of(f);
  ASSERT_TRUE(back);
  EXPECT_EQ(back->tick, 1);
  EXPECT_EQ(back->encoder_cnt, -2);
  EXPECT_EQ(back->adc0_code, 300);
  EXPECT_EQ(back->adc1_code, 4095);
  EXPECT_EQ(back->din, 9);
  EXPECT_EQ(back->sensor_valid, 1);
  EXPECT_EQ(back->axis, 3);
}

// The home switch is input 4, bit 8 of the identifier: enable and home are 1 << 9 | 1 << 8 = 300h.
TEST(Frames, TheHomeSwitchIsAnInput) {
  const can_frame f = can_frame_of(LinkInputs{0, 0, 0, 0, 17, 1, 1});
  EXPECT_EQ(f.can_id, 0x300U | CAN_EFF_FLAG);
  ASSERT_TRUE(link_inputs_of(f));
  EXPECT_EQ(link_inputs_of(f)->din, 17);
}

// Direction 1 << 28, axis 6 is 5 << 25 = 0A000000h, tick 70000 mod 4096 = 368 = 170h, << 13 is
// 2E0000h; dac -2048 = F800h, tick 70000 mod 65536 = 4464 = 1170h.
TEST(Frames, OutputsByHand) {
  const can_frame f = can_frame_of(LinkOutputs{70000, -2048, 3, 7, 5, 6});
  EXPECT_EQ(f.can_id, 0x1A2E0000U | CAN_EFF_FLAG);
  const std::vector<int> bytes(f.data, f.data + f.can_dlc);
  EXPECT_EQ(bytes, (std::vector<int>{0x00, 0xF8, 0x03, 0x70, 0x11, 0x07, 0x05}));
  const auto back = link_outputs_of(f);
  ASSERT_TRUE(back);
  EXPECT_EQ(back->tick, 4464);
  EXPECT_EQ(back->dac_code, -2048);
  EXPECT_EQ(back->out, 3);
  EXPECT_EQ(back->fault, 7);
  EXPECT_EQ(back->limit_reason, 5);
  EXPECT_EQ(back->axis, 6);
}

TEST(Frames, SensorsThatAreNotValidHaveNoData) {
  const can_frame f = can_frame_of(LinkInputs{5, 1, 2, 3, 1, 0, 1});
  EXPECT_EQ(f.can_dlc, 0);
  ASSERT_TRUE(link_inputs_of(f));
  EXPECT_EQ(link_inputs_of(f)->sensor_valid, 0);
  EXPECT_EQ(link_inputs_of(f)->din, 1);
}

// A fitted drive that is on is 3. The status frame has bit 2 and the frame of the inputs bit 1, so
// axis 3 and tick 1 give 04002004h and 04003202h.
TEST(Frames, ADriveTakesAStatusFrameBeforeTheInputs) {
  const LinkInputs in{4097, -2, 300, 4095, 9, 1, 3, 3, 2, 255};
  const auto status = can_status_frame_of(in);
  ASSERT_TRUE(status);
  EXPECT_EQ(status->can_id, 0x04002004U | CAN_EFF_FLAG);
  const std::vector<int> bytes(status->data, status->data + status->can_dlc);
  EXPECT_EQ(bytes, (std::vector<int>{3, 2, 255}));
  const can_frame inputs = can_frame_of(in);
  EXPECT_EQ(inputs.can_id, 0x04003202U | CAN_EFF_FLAG);

  CanInputs decoder;
  EXPECT_FALSE(decoder.take(inputs)) << "no status frame yet";
  EXPECT_FALSE(decoder.take(*status));
  const auto back = decoder.take(inputs);
  ASSERT_TRUE(back);
  EXPECT_EQ(back->encoder_cnt, -2);
  EXPECT_EQ(back->drive, 3);
  EXPECT_EQ(back->position_age, 2);
  EXPECT_EQ(back->force_age, 255);
  EXPECT_EQ(decoder.foreign(), 0U);
  // The next tick and another axis need status frames of their own.
  EXPECT_FALSE(decoder.take(can_frame_of(LinkInputs{4098, -2, 300, 4095, 9, 1, 3, 3, 2, 255})));
  EXPECT_FALSE(decoder.take(can_frame_of(LinkInputs{4097, -2, 300, 4095, 9, 1, 2, 3, 2, 255})));
  EXPECT_FALSE(link_outputs_of(*status));
}

TEST(Frames, WithoutDriveAndAgesInputsAreOneFrame) {
  const LinkInputs in{5, 1, 2, 3, 1, 1, 1};
  EXPECT_FALSE(can_status_frame_of(in));
  CanInputs decoder;
  decoder.take(*can_status_frame_of(LinkInputs{5, 1, 2, 3, 1, 1, 1, 15, 1, 1}));
  const auto back = decoder.take(can_frame_of(in));
  ASSERT_TRUE(back);
  EXPECT_EQ(back->drive + back->position_age + back->force_age, 0);
}

TEST(Frames, EachFieldAloneNeedsTheStatusFrame) {
  for (int field = 0; field < 3; ++field) {
    LinkInputs in{5, 1, 2, 3, 1, 0, 1};
    (field == 0 ? in.drive : field == 1 ? in.position_age : in.force_age) = 1;
    CanInputs decoder;
    ASSERT_TRUE(can_status_frame_of(in));
    decoder.take(*can_status_frame_of(in));
    const auto back = decoder.take(can_frame_of(in));
    ASSERT_TRUE(back);
    EXPECT_EQ(back->drive, field == 0);
    EXPECT_EQ(back->position_age, field == 1);
    EXPECT_EQ(back->force_age, field == 2);
    EXPECT_EQ(back->sensor_valid, 0);
  }
}

TEST(Frames, AStatusFrameOfAnotherShapeIsForeign) {
  const can_frame status = *can_status_frame_of(LinkInputs{5, 1, 2, 3, 1, 1, 1, 3, 0, 0});
  std::uint64_t expected = 0;
  CanInputs decoder;
  for (const canid_t flip : {CAN_RTR_FLAG, 1U, 2U, 0x80U, 0x100U, 7U << 25, 1U << 28}) {
    can_frame f = status;
    f.can_id ^= flip;
    EXPECT_FALSE(decoder.take(f));
    EXPECT_EQ(decoder.foreign(), ++expected) << flip;
  }
  can_frame f = status;
  f.can_dlc = 4;
  EXPECT_FALSE(decoder.take(f));
  EXPECT_EQ(decoder.foreign(), ++expected);
}

TEST(Frames, WhatIsNoRecordIsRefused) {
  const can_frame in = can_frame_of(LinkInputs{5, 1, 2, 3, 1, 1, 1});
  const can_frame out = can_frame_of(LinkOutputs{5, 1, 2, 3, 4, 1});
  EXPECT_FALSE(link_inputs_of(out));
  EXPECT_FALSE(link_outputs_of(in));
  const auto with = [](can_frame f, auto change) {
    change(f);
    return f;
  };
  for (const canid_t flip : {CAN_EFF_FLAG, CAN_RTR_FLAG, CAN_ERR_FLAG, 1U, 0x80U, 7U << 25}) {
    EXPECT_FALSE(link_inputs_of(with(in, [&](can_frame &f) { f.can_id ^= flip; })));
    EXPECT_FALSE(link_outputs_of(with(out, [&](can_frame &f) { f.can_id ^= flip; })));
  }
  EXPECT_FALSE(link_inputs_of(with(in, [](can_frame &f) { f.can_dlc = 7; })));
  EXPECT_FALSE(link_outputs_of(with(out, [](can_frame &f) { f.can_dlc = 8; })));
  // Identifier and data of two ticks.
  EXPECT_FALSE(link_outputs_of(with(out, [](can_frame &f) { f.data[3] ^= 1; })));
}

// A wire in one thread: when the plant waits, the firmware's end serves what has arrived. `fate`
// is how often a record arrives.
struct Wire {
  std::deque<LinkInputs> to_axis;
  std::deque<LinkOutputs> to_plant;
  std::function<int()> fate = [] { return 1; };
  std::function<void()> serve = [] {};

  struct PlantEnd : PlantTransport {
    explicit PlantEnd(Wire &w) : wire(w) {}
    void send(std::span<const LinkInputs> records) override {
      for (const auto &r : records)
        for (int n = wire.fate(); n > 0; --n) wire.to_axis.push_back(r);
    }
    std::size_t receive(std::span<LinkOutputs> records, milliseconds) override {
      wire.serve();
      std::size_t n = 0;
      for (; n < records.size() && !wire.to_plant.empty(); ++n) {
        records[n] = wire.to_plant.front();
        wire.to_plant.pop_front();
      }
      return n;
    }
    std::uint64_t foreign() const override { return 0; }
    Wire &wire;
  };

  struct AxisEnd : AxisTransport {
    explicit AxisEnd(Wire &w) : wire(w) {}
    void send(std::span<const LinkOutputs> records) override {
      for (const auto &r : records)
        for (int n = wire.fate(); n > 0; --n) wire.to_plant.push_back(r);
    }
    std::size_t receive(std::span<LinkInputs> records, milliseconds) override {
      std::size_t n = 0;
      for (; n < records.size() && !wire.to_axis.empty(); ++n) {
        records[n] = wire.to_axis.front();
        wire.to_axis.pop_front();
      }
      return n;
    }
    std::uint64_t foreign() const override { return 0; }
    Wire &wire;
  };
};

// Two axes over this wire against themselves in process.
void expect_same_trace(Wire &wire, std::uint64_t &repeated) {
  std::vector<Experiment> experiments;
  std::vector<PlantSide> plants;
  std::vector<FirmwareSide> firmwares;
  experiments.reserve(2);
  for (const char *gain : {"firmware.force_gain=5", "firmware.force_gain=9"}) {
    experiments.push_back(load_experiment(
        kContact,
        std::vector<std::string>{gain, "experiment.duration_s=0.5", "verdict.window_s=0.1"}));
    plants.emplace_back(experiments.back(), RunOptions{.trace = false, .audit = false});
    firmwares.emplace_back(experiments.back(), FirmwareOptions{.hash = true});
  }
  Wire::PlantEnd plant_end(wire);
  Wire::AxisEnd axis_end(wire);
  const std::uint8_t axes[] = {1, 2};
  const std::int64_t last[] = {750, 750};
  AxisExchange axis(axis_end, {}, axes, last, [&firmwares](const LinkInputs &in) {
    EXPECT_EQ(firmwares[in.axis - 1U].next_tick(), in.tick);
    return firmwares[in.axis - 1U].tick(in);
  });
  wire.serve = [&axis] { axis.serve(milliseconds{0}); };
  PlantExchange exchange(plant_end, {});
  while (plants[0].running()) {
    LinkInputs in[] = {plants[0].sense(), plants[1].sense()};
    in[1].axis = 2;
    LinkOutputs out[2];
    exchange.exchange(in, out);
    for (int i = 0; i < 2; ++i) plants[static_cast<std::size_t>(i)].act(out[i]);
  }
  EXPECT_TRUE(axis.finished());
  for (std::size_t i = 0; i < 2; ++i) {
    const std::string expected = run(experiments[i]).trace_hash;
    EXPECT_EQ(plants[i].finish().trace_hash, expected);
    EXPECT_EQ(firmwares[i].hash(), expected);
  }
  repeated = exchange.statistics().repeated;
  EXPECT_EQ(exchange.statistics().sent, 2U * 751U + repeated);
}

TEST(Exchange, APerfectWireNeedsNoRepeat) {
  Wire wire;
  std::uint64_t repeated = 0;
  expect_same_trace(wire, repeated);
  EXPECT_EQ(repeated, 0U);
}

TEST(Exchange, LossAndDoublingLeaveTheTraceEqual) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    std::mt19937 random(seed);
    Wire wire;
    wire.fate = [&random] {
      const unsigned die = random() % 10;
      return die < 2 ? 0 : die < 4 ? 2 : die < 5 ? 3 : 1;
    };
    std::uint64_t repeated = 0;
    expect_same_trace(wire, repeated);
    EXPECT_GT(repeated, 100U) << "seed " << seed;
  }
}

// A record of an earlier tick, or of a later one, is not computed.
TEST(Exchange, OnlyTheComingTickIsComputed) {
  Wire wire;
  Wire::AxisEnd end(wire);
  const std::uint8_t axes[] = {1};
  const std::int64_t last[] = {10};
  std::vector<std::int64_t> computed;
  AxisExchange axis(end, {}, axes, last, [&computed](const LinkInputs &in) {
    computed.push_back(in.tick);
    return LinkOutputs{in.tick, static_cast<std::int16_t>(100 + in.tick), 1, 0, 0, in.axis};
  });
  const auto ask = [&](std::int64_t tick, std::uint8_t number) {
    wire.to_axis.push_back({tick, 0, 0, 0, 1, 1, number});
    axis.serve(milliseconds{0});
    const auto answers = wire.to_plant;
    wire.to_plant.clear();
    return answers;
  };
  EXPECT_TRUE(ask(1, 1).empty());  // ahead
  EXPECT_EQ(ask(0, 1).at(0).dac_code, 100);
  EXPECT_EQ(ask(0, 1).at(0).dac_code, 100);  // from memory
  EXPECT_EQ(ask(1, 1).at(0).dac_code, 101);
  EXPECT_TRUE(ask(0, 1).empty());  // old
  EXPECT_TRUE(ask(2, 2).empty());  // not hosted here
  EXPECT_EQ(computed, (std::vector<std::int64_t>{0, 1}));
  EXPECT_EQ(axis.statistics().duplicates, 3U);
  EXPECT_EQ(axis.statistics().repeated, 1U);
}

TEST(Exchange, ASilentPartnerIsNamed) {
  Wire wire;
  wire.fate = [] { return 0; };
  Wire::PlantEnd end(wire);
  PlantExchange exchange(end, {.start = milliseconds{20}, .running = milliseconds{20}});
  const LinkInputs in[] = {{0, 0, 0, 0, 1, 1, 2}, {0, 0, 0, 0, 1, 1, 5}};
  LinkOutputs out[2];
  try {
    exchange.exchange(in, out);
    FAIL();
  } catch (const LinkSilent &error) {
    EXPECT_EQ(std::string(error.what()).find("axis_node (axes 2, 5) silent for 0.02 s at tick 0"),
              0U)
        << error.what();
  }
  EXPECT_GT(exchange.statistics().repeated, 2U);
}

// The tick after the silence: whatever the axis was doing, code 0 and disabled.
TEST(Exchange, WithoutThePlantTheAxisIsDisabledInOneTick) {
  const Experiment e = load_experiment(kContact);
  FirmwareSide firmware(e, {.hash = true});
  EXPECT_EQ(firmware.tick({0, 0, 0, 0, 1, 1, 1}).dac_code, 150);
  const LinkOutputs lost = firmware.lose_sensors(1);
  EXPECT_EQ(lost.tick, 1);
  EXPECT_EQ(lost.dac_code, 0);
  EXPECT_EQ(lost.out, 0);
  EXPECT_EQ(lost.fault, AXIS_FAULT_SENSOR_INVALID);
  EXPECT_EQ(firmware.next_tick(), 1);
}

// How many of `ticks` come too late when tick k comes at when(k), in ticks.
template <class When>
int late_ticks(int ticks, When when) {
  LateTicks watch;
  int late = 0;
  for (int k = 0; k < ticks; ++k) {
    if (watch.late(std::int64_t{1} << 40 | static_cast<std::int64_t>(when(k) * 2e6 / 3))) ++late;
  }
  return late;
}

TEST(LateTicks, ComeMoreThanATickAfterTheirTime) {
  EXPECT_EQ(late_ticks(15000, [](int k) { return 1.0 * k; }), 0);
  EXPECT_EQ(late_ticks(15000, [](int k) { return k + 0.9 * (k % 2); }), 0);
  // One that stands still for 15 ticks, and then catches up.
  const auto still = [](int k) {
    return k < 1000 || k > 1015 ? 1.0 * k : 1015 + 0.01 * (k - 1000);
  };
  EXPECT_EQ(late_ticks(15000, still), 1);
  // So twice; the first tick of all may be late too.
  EXPECT_EQ(late_ticks(15000, [&](int k) { return k == 0 ? 5.0 : still(k) + 3 * (k == 3000); }), 2);
  // Half as fast as it is to be: each is one late.
  EXPECT_NEAR(late_ticks(3000, [](int k) { return 2.0 * k; }), 1500, 10);
  // As fast as it can.
  EXPECT_EQ(late_ticks(15000, [](int k) { return 0.05 * k; }), 0);
  // Ten minutes of a plant whose clock is 100 ppm slow.
  EXPECT_EQ(late_ticks(900000, [](int k) { return 1.0001 * k; }), 0);
}

TEST(Injection, IsReadAndRefused) {
  const Injection i = injection_of("drop=0.05,double=0.1,seed=7,flip=12,bit=33");
  EXPECT_EQ(i.drop, 0.05);
  EXPECT_EQ(i.duplicate, 0.1);
  EXPECT_EQ(i.seed, 7U);
  EXPECT_EQ(i.flip_tick, 12);
  EXPECT_EQ(i.flip_bit, 33);
  for (const char *bad : {"", "drop", "drop=", "drop=1.5", "drop=nan", "flip=-1", "bit=64", "x=1",
                          "drop=0.1,", "drop=0.1;double=0.1"}) {
    EXPECT_THROW(injection_of(bad), std::invalid_argument) << bad;
  }
}

TEST(Injection, FlipsOneBitOfOneRecord) {
  Wire wire;
  InjectionCounts counts;
  const auto end = injecting<LinkInputs, LinkOutputs>(std::make_unique<Wire::PlantEnd>(wire),
                                                      injection_of("flip=3,bit=33"), counts);
  for (const std::int64_t tick : {2, 3, 3, 4}) {
    const LinkInputs in{tick, 0, 0, 0, 1, 1, 1};
    end->send({&in, 1});
  }
  ASSERT_EQ(wire.to_axis.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(wire.to_axis[i].adc0_code, i == 1 ? 2 : 0);
  EXPECT_EQ(counts.flipped, 1U);
}

TEST(Lcm, RunsHavePortsOfTheirOwn) {
  EXPECT_EQ(lcm_url_of(7), "udpm://239.255.76.67:20007?ttl=0");
  EXPECT_EQ(lcm_url_of(40007), lcm_url_of(7));
  EXPECT_EQ(lcm_url_of(-1), "udpm://239.255.76.67:59999?ttl=0");
}

}  // namespace
}  // namespace forceaxis::host
