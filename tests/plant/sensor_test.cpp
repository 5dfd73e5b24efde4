// Codes, rounding, wrap, saturation and the distance to the nearest code edge.
#include <cmath>
#include <limits>
#include <string>

#include "sim/model/elements/all.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

SensorCodes codes_at(const std::string &position, const std::string &more, double *margin) {
  Plant plant(make_model(
      "[[body]]\nname = \"b\"\nmass = 1\nposition = " + position +
      "\n[[damper]]\nname = \"d\"\nbetween = [\"b\", \"ground\"]\ndamping = 1\n" + more));
  const SensorCodes codes = plant.codes();
  *margin = plant.edge_margin();
  return codes;
}

const std::string kEncoder = "[encoder]\nbody = \"b\"\nscale = 1000\n";

TEST(Encoder, RoundsHalfUp) {
  double margin = 0.0;
  EXPECT_EQ(codes_at("0.0", kEncoder, &margin).encoder, 0);
  EXPECT_DOUBLE_EQ(margin, 0.5);
  EXPECT_EQ(codes_at("0.0125", kEncoder, &margin).encoder, 13);  // 12.5
  EXPECT_DOUBLE_EQ(margin, 0.0);
  EXPECT_EQ(codes_at("-0.0125", kEncoder, &margin).encoder, -12);  // -12.5
  EXPECT_EQ(codes_at("-0.01275", kEncoder, &margin).encoder, -13);
  EXPECT_NEAR(margin, 0.25, 1e-12);
  EXPECT_EQ(codes_at("0.01225", kEncoder, &margin).encoder, 12);
  EXPECT_NEAR(margin, 0.25, 1e-12);
}

TEST(Encoder, Wraps) {
  double margin = 0.0;
  EXPECT_EQ(codes_at("2147483.648", kEncoder, &margin).encoder,
            std::numeric_limits<std::int32_t>::min());
  EXPECT_EQ(codes_at("2147483.647", kEncoder, &margin).encoder,
            std::numeric_limits<std::int32_t>::max());
  EXPECT_EQ(codes_at("4294967.297", kEncoder, &margin).encoder, 1);
}

std::string adc(const std::string &more) {
  return "[[adc]]\nchannel = 1\nsignal = \"b.position\"\n" + more;
}

TEST(Adc, SignedEightBits) {
  double margin = 0.0;
  const std::string text = adc("per_count = 0.5\nzero_code = 128\n");
  EXPECT_EQ(codes_at("0.0", text, &margin).adc[1], 128);
  EXPECT_EQ(codes_at("0.0", text, &margin).adc[0], 0);
  EXPECT_EQ(codes_at("0.25", text, &margin).adc[1], 129);
  EXPECT_DOUBLE_EQ(margin, 0.0);
  EXPECT_EQ(codes_at("0.2", text, &margin).adc[1], 128);
  EXPECT_NEAR(margin, 0.1, 1e-12);
  EXPECT_EQ(codes_at("-3.0", text, &margin).adc[1], 122);
}

TEST(Adc, SaturatesAndCountsTheDistanceToTheLastEdge) {
  double margin = 0.0;
  const std::string text = adc("per_count = 0.5\nzero_code = 128\n");
  // The last edges are at counts 126.5 (to 255) and -127.5 (to 0).
  EXPECT_EQ(codes_at("1e9", text, &margin).adc[1], 255);
  EXPECT_DOUBLE_EQ(margin, 2e9 - 126.5);
  EXPECT_EQ(codes_at("63.5", text, &margin).adc[1], 255);
  EXPECT_DOUBLE_EQ(margin, 0.5);
  EXPECT_EQ(codes_at("-1e9", text, &margin).adc[1], 0);
  EXPECT_DOUBLE_EQ(margin, 2e9 - 127.5);
  EXPECT_EQ(codes_at("-64", text, &margin).adc[1], 0);
  EXPECT_DOUBLE_EQ(margin, 0.5);
  EXPECT_EQ(codes_at("-63.5", text, &margin).adc[1], 1);
}

TEST(Adc, NegativeScaleAndMoreBits) {
  double margin = 0.0;
  const std::string text = adc("per_count = -0.001\nzero_code = 2048\nbits = 12\n");
  EXPECT_EQ(codes_at("0.5", text, &margin).adc[1], 1548);
  EXPECT_EQ(codes_at("-3", text, &margin).adc[1], 4095);
  EXPECT_EQ(codes_at("3", text, &margin).adc[1], 0);
}

TEST(EdgeMargin, KeepsTheClosestApproach) {
  Plant plant(
      make_model("[[body]]\nname = \"b\"\nmass = 1\nvelocity = 0.15\n[[damper]]\n"
                 "name = \"d\"\nbetween = [\"b\", \"ground\"]\ndamping = 0\n" +
                 kEncoder));
  EXPECT_EQ(plant.edge_margin(), std::numeric_limits<double>::infinity());
  double least = 0.5;
  for (int k = 0; k < 4; ++k) {  // 0.1 counts a tick
    EXPECT_EQ(plant.codes().encoder, 0);
    least = 0.5 - 0.1 * k;
    EXPECT_NEAR(plant.edge_margin(), least, 1e-12);
    plant.step(0, false);
  }
  plant.step(0, false);
  plant.step(0, false);
  EXPECT_EQ(plant.codes().encoder, 1);  // 0.6 counts: 0.1 from the edge, as before
  EXPECT_NEAR(plant.edge_margin(), 0.1, 1e-12);
}

// A body at 0.1 m a tick, from -0.45: a switch is on where the body is, an index in the tick after
// which it was passed.
TEST(Switches, FollowTheBody) {
  Plant plant(
      make_model("[[body]]\nname = \"b\"\nmass = 1\nposition = -0.45\nvelocity = 150\n"
                 "[[damper]]\nname = \"d\"\nbetween = [\"b\", \"ground\"]\ndamping = 0\n" +
                 kEncoder +
                 "[switches]\nlimit_neg = -0.4\nlimit_pos = 0.5\nhome_from = 0\nhome_to = 0.2\n"
                 "index = 0\nindex_every = 0.3\n"));
  const std::vector<int> expected = {
      kLimitNeg,  // -0.45
      0,
      kIndex,
      0,
      0,               // -0.35, -0.25 past -0.3, ...
      kHome | kIndex,  // 0.05
      kHome,           // 0.15
      0,               // 0.25
      kIndex,
      0,                   // 0.35, 0.45
      kLimitPos,           // 0.55
      kLimitPos | kIndex,  // 0.65
  };
  for (std::size_t k = 0; k < expected.size(); ++k) {
    EXPECT_EQ(int{plant.codes().switches}, expected[k]) << k;
    plant.step(0, false);
  }
}

TEST(Switches, AHomeSwitchWithoutAnEndAndASingleIndex) {
  double margin = 0.0;
  const std::string to = kEncoder + "[switches]\nhome_to = 0.1\nindex = 5\n";
  EXPECT_EQ(codes_at("-100", to, &margin).switches, kHome);
  EXPECT_EQ(codes_at("0.1", to, &margin).switches, 0);
  const std::string from = kEncoder + "[switches]\nhome_from = 0.1\n";
  EXPECT_EQ(codes_at("100", from, &margin).switches, kHome);
  EXPECT_EQ(codes_at("0.0999", from, &margin).switches, 0);
  EXPECT_EQ(codes_at("100", kEncoder, &margin).switches, 0);
}

TEST(Signals, NamesAndValuesAgree) {
  Plant plant(
      make_model("[[body]]\nname = \"b\"\nmass = 1\nposition = 2\nvelocity = 3\n[[spring]]\n"
                 "name = \"s\"\nbetween = [\"ground\", \"b\"]\nstiffness = 10\n"
                 "damping = 100\n"));
  const std::vector<std::string> names = {"b.position",  "b.velocity",     "b.acceleration",
                                          "s.force",     "s.spring_force", "s.spring_force_rate",
                                          "s.deflection"};
  EXPECT_EQ(plant.signal_names(), names);
  std::vector<double> values(7);
  plant.signals(values);
  EXPECT_EQ(values, (std::vector<double>{2, 3, -320, -320, -20, -30, -2}));
  for (std::size_t i = 0; i < names.size(); ++i) EXPECT_EQ(plant.signal(names[i]), values[i]);
  EXPECT_THROW(plant.signal("s.farce"), std::invalid_argument);
  values.resize(6);
  EXPECT_THROW(plant.signals(values), std::invalid_argument);
}

}  // namespace
}  // namespace forceaxis::sim::test
