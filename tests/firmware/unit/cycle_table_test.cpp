// Curves of points (firmware/cycle/table.h) against rational arithmetic, equal to the last count.
#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <vector>

#include "firmware/port/host/firmware.hpp"

namespace {

using Points = std::vector<cycle_point_t>;
__extension__ using Wide = __int128;

// floor(a / b), b > 0.
Wide Floor(Wide a, Wide b) { return a / b - (a % b < 0 ? 1 : 0); }

// y at x, from the definition: the line of the two points around x, rounded half up.
std::int64_t Exact(const Points &points, std::int64_t x) {
  if (x <= points.front().x) return points.front().y;
  for (std::size_t i = 1; i < points.size(); ++i) {
    const Wide x0 = points[i - 1].x, y0 = points[i - 1].y, x1 = points[i].x, y1 = points[i].y;
    if (x <= x1)
      return static_cast<std::int64_t>(
          Floor(2 * (y0 * (x1 - x0) + (y1 - y0) * (x - x0)) + (x1 - x0), 2 * (x1 - x0)));
  }
  return points.back().y;
}

Points RandomTable(std::mt19937_64 &random) {
  const auto pick = [&](std::int64_t low, std::int64_t high) {
    return std::uniform_int_distribution<std::int64_t>(low, high)(random);
  };
  const std::int64_t step = pick(0, 2) == 0 ? CYCLE_TABLE_STEP_MAX : pick(1, 3000);
  const std::int64_t y_most = pick(0, 1) == 0 ? CYCLE_TABLE_Y_MAX : pick(1, 5000);
  Points points(static_cast<std::size_t>(pick(0, 9) == 0 ? 255 : pick(2, 12)));
  std::int64_t x = pick(-300000, 300000);
  for (cycle_point_t &point : points) {
    const std::int64_t ends[] = {-y_most, y_most, 0};
    const std::int64_t y = pick(0, 2) == 0 ? ends[pick(0, 2)] : pick(-y_most, y_most);
    point = {static_cast<std::int32_t>(x), static_cast<std::int32_t>(y)};
    x += pick(0, 3) == 0 ? step : pick(1, step);
  }
  return points;
}

TEST(CycleTable, EqualsRationalArithmeticToTheLastCount) {
  std::mt19937_64 random(1);
  for (int n = 0; n < 2000; ++n) {
    const Points points = RandomTable(random);
    const auto count = static_cast<std::uint8_t>(points.size());
    ASSERT_TRUE(cycle_table_is_valid(points.data(), count));
    const auto check = [&](std::int64_t x) {
      ASSERT_EQ(cycle_table_at(points.data(), count, static_cast<std::int32_t>(x)),
                Exact(points, x))
          << n << " at " << x;
    };
    for (const std::int64_t x : {std::int64_t{INT32_MIN}, std::int64_t{INT32_MAX}}) check(x);
    for (const cycle_point_t &point : points)
      for (int beside = -2; beside <= 2; ++beside) check(std::int64_t{point.x} + beside);
    std::uniform_int_distribution<std::int64_t> inside(points.front().x - 9, points.back().x + 9);
    for (int i = 0; i < 300; ++i) check(inside(random));
  }
}

TEST(CycleTable, TheLongestAndSteepestLineIsExact) {
  const Points rises{{-262144, -CYCLE_TABLE_Y_MAX}, {262143, CYCLE_TABLE_Y_MAX}};
  const Points falls{{-262144, CYCLE_TABLE_Y_MAX}, {262143, -CYCLE_TABLE_Y_MAX}};
  for (std::int32_t x = -262144; x <= 262143; ++x) {
    ASSERT_EQ(cycle_table_at(rises.data(), 2, x), Exact(rises, x)) << x;
    ASSERT_EQ(cycle_table_at(falls.data(), 2, x), Exact(falls, x)) << x;
  }
}

TEST(CycleTable, OnlyTablesWithinTheBoundsAreValid) {
  const auto valid = [](const Points &points) {
    return cycle_table_is_valid(points.data(), static_cast<std::uint8_t>(points.size()));
  };
  EXPECT_TRUE(valid({{0, 0}, {1, 0}}));
  EXPECT_FALSE(valid({{0, 0}})) << "one point";
  EXPECT_FALSE(valid({{0, 0}, {0, 1}})) << "x does not rise";
  EXPECT_FALSE(valid({{1, 0}, {0, 1}}));
  EXPECT_TRUE(valid({{0, 0}, {524287, 0}}));
  EXPECT_FALSE(valid({{0, 0}, {524288, 0}}));
  EXPECT_TRUE(valid({{0, 8388096}, {1, -8388096}}));
  EXPECT_FALSE(valid({{0, 8388097}, {1, 0}}));
  EXPECT_FALSE(valid({{0, 0}, {1, -8388097}}));
  EXPECT_TRUE(valid({{1073741822, 0}, {1073741823, 0}}));
  EXPECT_FALSE(valid({{1073741823, 0}, {1073741824, 0}}));
}

}  // namespace
