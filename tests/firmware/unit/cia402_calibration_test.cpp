// Calibration: the line and its error against long double, every refusal by name, expiry.
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "tests/firmware/unit/firmware_fixture.hpp"

namespace {

struct Point {
  int reading_q8;
  int force_mN;
};

class Calibration : public FirmwareFixture {
 protected:
  Calibration() {
    const fw_config_t config{};
    fw_init(&fw_, &config);
  }

  void Give(const std::vector<Point> &points) {
    for (size_t i = 0; i < points.size(); ++i) {
      Set(static_cast<uint16_t>(AXIS_OBJ_CALIBRATION_READING_1 + i), points[i].reading_q8);
      Set(static_cast<uint16_t>(AXIS_OBJ_CALIBRATION_FORCE_1 + i), points[i].force_mN);
    }
    Set(AXIS_OBJ_CALIBRATION_POINTS, static_cast<int32_t>(points.size()));
  }

  int State() const { return fw_.drive.signals.calibration_state; }

  void ExpectRefused(int state) {
    const int32_t before = Read(AXIS_OBJ_FORCE_SCALE);
    const int32_t date = Read(AXIS_OBJ_CALIBRATION_DATE);
    EXPECT_EQ(Write(AXIS_OBJ_CALIBRATE, 1), FW_ERROR_RANGE);
    EXPECT_EQ(State(), state);
    EXPECT_EQ(Read(AXIS_OBJ_FORCE_SCALE), before);
    EXPECT_EQ(Read(AXIS_OBJ_CALIBRATION_DATE), date);
  }
};

TEST_F(Calibration, TwoPointsGiveTheScale) {
  // 0 N at 1 count, 250 N at 101 counts: 2.5 N a count.
  Give({{256, 0}, {101 * 256, 250000}});
  Set(AXIS_OBJ_FORCE_SCALE, 1);
  Set(AXIS_OBJ_CONFIGURATION_DATE, 5);
  Set(AXIS_OBJ_CALIBRATE, 1);
  EXPECT_EQ(State(), AXIS_CALIBRATION_STATE_DONE);
  EXPECT_EQ(Read(AXIS_OBJ_CONFIGURATION_DATE), 0) << "not the verified configuration any more";
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SCALE), 2500000);
  EXPECT_EQ(Read(AXIS_OBJ_CALIBRATION_LINEARITY), 0);
  // What is derived from the scale follows: 40 counts are 100 N, all of the rated force.
  Set(AXIS_OBJ_RATED_FORCE, 100000);
  inputs_.adc_code[0] = 40;
  Tick(2);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_ACTUAL), 1000);
}

TEST_F(Calibration, TheLinearityErrorIsTheWorstResidual) {
  // The line through 0, 100 + 6, 200 N at 0, 40, 80 counts has the offset 2 N: residuals -2, 4, -2.
  Give({{0, 0}, {40 * 256, 106000}, {80 * 256, 200000}});
  Set(AXIS_OBJ_CALIBRATION_LINEARITY_MAX, 2000);
  Set(AXIS_OBJ_CALIBRATE, 1);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SCALE), 2500000);
  EXPECT_EQ(Read(AXIS_OBJ_CALIBRATION_LINEARITY), 2000);  // 4 of 200 N, in 0.01 per mille
  Set(AXIS_OBJ_CALIBRATION_LINEARITY_MAX, 1999);
  ExpectRefused(AXIS_CALIBRATION_STATE_REFUSED_LINEARITY);
  EXPECT_EQ(Read(AXIS_OBJ_CALIBRATION_LINEARITY), 2000);
}

TEST_F(Calibration, AgreesWithLeastSquaresInLongDouble) {
  std::mt19937_64 random(7);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  Set(AXIS_OBJ_CALIBRATION_LINEARITY_MAX, 65535);
  int accepted = 0;
  for (int round = 0; round < 3000; ++round) {
    const int count = 2 + static_cast<int>(random() % 7);
    const double slope = std::exp(uniform(std::log(1e-3), std::log(5000.0)));  // mN per 1/256
    const double bend = uniform(0, 0.2);
    std::vector<Point> points;
    for (int i = 0; i < count; ++i) {
      const double x = std::floor(uniform(-131072, 131072));
      const double y = slope * (x + bend * uniform(-1e4, 1e4)) + uniform(-1, 1) * slope * 1e5;
      points.push_back({static_cast<int>(x), static_cast<int>(std::clamp(y, -1e9, 1e9))});
    }
    long double sx = 0, sy = 0, xx = 0, xy = 0;
    for (const Point &p : points) sx += p.reading_q8, sy += p.force_mN;
    for (const Point &p : points) {
      const long double x = p.reading_q8 - sx / count;
      xx += x * x;
      xy += x * (p.force_mN - sy / count);
    }
    const auto [low, high] =
        std::minmax_element(points.begin(), points.end(),
                            [](const Point &a, const Point &b) { return a.force_mN < b.force_mN; });
    const long double span = static_cast<long double>(high->force_mN) - low->force_mN;
    const auto [left, right] = std::minmax_element(
        points.begin(), points.end(),
        [](const Point &a, const Point &b) { return a.reading_q8 < b.reading_q8; });
    Give(points);
    const int refusal = Write(AXIS_OBJ_CALIBRATE, 1);
    if (right->reading_q8 - left->reading_q8 < 32 * 256 || span == 0) {
      ASSERT_EQ(State(), AXIS_CALIBRATION_STATE_REFUSED_SPREAD);
      continue;
    }
    const long double fitted = xy / xx;
    if (fitted * 256000 < 0.4L) {
      ASSERT_NE(refusal, FW_OK);
      continue;
    }
    if (fitted * 256000 > 2147483640.0L) continue;
    ASSERT_EQ(refusal, FW_OK) << round << " state " << State();
    ++accepted;
    const long double scale = fitted * 256000;
    ASSERT_NEAR(static_cast<double>(Read(AXIS_OBJ_FORCE_SCALE)), static_cast<double>(scale),
                0.51 + static_cast<double>(scale) * 2e-9)
        << round;
    long double worst = 0;
    for (const Point &p : points)
      worst = std::max(worst,
                       std::fabs(p.force_mN - sy / count - fitted * (p.reading_q8 - sx / count)));
    const double linearity = std::min(65535.0, static_cast<double>(worst / span * 100000));
    ASSERT_NEAR(Read(AXIS_OBJ_CALIBRATION_LINEARITY), linearity, 0.51) << round;
  }
  EXPECT_GT(accepted, 1500);
}

TEST_F(Calibration, IsRefusedByName) {
  Give({{0, 0}});
  ExpectRefused(AXIS_CALIBRATION_STATE_REFUSED_POINTS);
  Set(AXIS_OBJ_CALIBRATION_POINTS, 0);
  ExpectRefused(AXIS_CALIBRATION_STATE_REFUSED_POINTS);
  Give({{0, 0}, {32 * 256 - 1, 80000}});
  ExpectRefused(AXIS_CALIBRATION_STATE_REFUSED_SPREAD);
  Give({{0, 5000}, {64 * 256, 5000}});
  ExpectRefused(AXIS_CALIBRATION_STATE_REFUSED_SPREAD);
  Give({{0, 80000}, {32 * 256, 0}});
  ExpectRefused(AXIS_CALIBRATION_STATE_REFUSED_SIGN);
  Give({{-131072, -1000000000}, {-131072 + 8192, 1000000000}});  // 244 kN in 1/256 count
  ExpectRefused(AXIS_CALIBRATION_STATE_REFUSED_RANGE);
  Give({{-131072, 0}, {131072, 0}, {0, 0}});
  Set(AXIS_OBJ_CALIBRATION_FORCE_2, 1);  // 1 mN in 1024 counts is a uN in a count
  Set(AXIS_OBJ_CALIBRATION_LINEARITY_MAX, 65535);
  EXPECT_EQ(Write(AXIS_OBJ_CALIBRATE, 1), FW_OK);
  EXPECT_EQ(Read(AXIS_OBJ_FORCE_SCALE), 1);
  Give({{0, 0}, {32 * 256, 80000}});
  Set(AXIS_OBJ_CALIBRATION_VALIDITY, 365);
  ExpectRefused(AXIS_CALIBRATION_STATE_REFUSED_DATE);
  Set(AXIS_OBJ_MODE, AXIS_MODE_OPEN_LOOP);
  Tick();
  EXPECT_EQ(Write(AXIS_OBJ_CALIBRATE, 1), FW_ERROR_STATE);
}

TEST_F(Calibration, ExpiresOnTheDayAfterItsLast) {
  Give({{0, 0}, {100 * 256, 250000}});
  Set(AXIS_OBJ_CALIBRATION_VALIDITY, 365);
  EXPECT_EQ(Read(AXIS_OBJ_CALIBRATION_EXPIRED), 0);  // the date is not known
  Set(AXIS_OBJ_DATE, 15660);
  EXPECT_EQ(Read(AXIS_OBJ_CALIBRATION_EXPIRED), 1);  // never calibrated
  EXPECT_NE(Read(AXIS_OBJ_STATUSWORD) & 0x80, 0);
  Set(AXIS_OBJ_CALIBRATE, 1);
  EXPECT_EQ(Read(AXIS_OBJ_CALIBRATION_DATE), 15660);
  EXPECT_EQ(Read(AXIS_OBJ_CALIBRATION_EXPIRED), 0);
  EXPECT_EQ(Read(AXIS_OBJ_STATUSWORD) & 0x80, 0);
  Set(AXIS_OBJ_DATE, 15660 + 365);
  EXPECT_EQ(Read(AXIS_OBJ_CALIBRATION_EXPIRED), 0);
  Set(AXIS_OBJ_DATE, 15660 + 366);
  EXPECT_EQ(Read(AXIS_OBJ_CALIBRATION_EXPIRED), 1);
  Set(AXIS_OBJ_CALIBRATION_DATE, 65535);  // the sum has more than 16 bits
  EXPECT_EQ(Read(AXIS_OBJ_CALIBRATION_EXPIRED), 0);
  Set(AXIS_OBJ_CALIBRATION_DATE, 0);
  Set(AXIS_OBJ_CALIBRATION_VALIDITY, 0);
  EXPECT_EQ(Read(AXIS_OBJ_CALIBRATION_EXPIRED), 0);
  Set(AXIS_OBJ_CALIBRATE, 1);
  EXPECT_EQ(Read(AXIS_OBJ_CALIBRATION_DATE), 16026);
}

}  // namespace
