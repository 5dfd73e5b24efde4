// State space of a mode, and the frequency response kernel, against closed forms and dense solves.
#include "sim/linear/linear.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <complex>
#include <random>
#include <string>
#include <vector>

#include "sim/matrix/hessenberg.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

using Complex = std::complex<double>;

// 2 kg on 100 N/m and 3 N s/m, 5 N a volt; the reading is the spring's force.
const char *const kOscillator = R"(
[[body]]
name = "m"
mass = 2
[[contact]]
name = "s"
between = ["m", "ground"]
stiffness = 100
damping = 3
[drive]
type = "perfect"
body = "m"
force_per_volt = 5
[[adc]]
channel = 0
signal = "s.spring_force"
per_count = 0.25
bits = 10
)";

TEST(Linear, OscillatorInAndOutOfContact) {
  const auto model = make_model(kOscillator);
  const std::vector<std::string> inputs = {"drive.command", "m.force", "drive.force"};
  const std::vector<std::string> outputs = {"reading", "adc0", "m.acceleration"};
  const Linear pressed = linearise(*model, {}, inputs, outputs);
  EXPECT_EQ(pressed.states, (std::vector<std::string>{"m.position", "m.velocity"}));
  EXPECT_DOUBLE_EQ(pressed.A(1, 0), -50.0);
  EXPECT_DOUBLE_EQ(pressed.A(1, 1), -1.5);
  EXPECT_DOUBLE_EQ(pressed.B(1, 0), 2.5);
  EXPECT_DOUBLE_EQ(pressed.B(1, 1), 0.5);
  EXPECT_DOUBLE_EQ(pressed.B(1, 2), 0.5);
  EXPECT_DOUBLE_EQ(pressed.C(0, 0), 100.0);
  EXPECT_DOUBLE_EQ(pressed.C(1, 0), 100.0);  // 0.25 N a code of 10 bits, 1 N an 8-bit count
  EXPECT_DOUBLE_EQ(pressed.D(2, 1), 0.5);

  const Linear free = linearise(*model, {{}, true, true}, inputs, outputs);
  EXPECT_DOUBLE_EQ(free.A(1, 0), 0.0);
  EXPECT_DOUBLE_EQ(free.C(0, 0), 0.0);
  const Linear overlap = linearise(*model, {{{"s", "overlap"}}, false, true}, inputs, outputs);
  EXPECT_DOUBLE_EQ(overlap.A(1, 1), 0.0);
}

TEST(Linear, RefusesWhatIsNotThere) {
  const auto model = make_model(kOscillator);
  const std::vector<std::string> command = {"drive.command"};
  const std::vector<std::string> reading = {"reading"};
  const std::vector<std::string> wrong = {"m.speed"};
  EXPECT_THROW(linearise(*model, {}, command, wrong), InputError);
  EXPECT_THROW(linearise(*model, {}, wrong, reading), InputError);
  EXPECT_THROW(linearise(*model, {{{"s", "gone"}}, false, true}, command, reading), InputError);
  EXPECT_THROW(linearise(*model, {{{"t", "apart"}}, false, true}, command, reading), InputError);
  EXPECT_THROW(linearise(*model, {{}, false, false}, command, reading), InputError);
}

TEST(HessenbergResponse, EqualsDenseSolves) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (const int n : {0, 1, 2, 7, 20}) {
    const auto filled = [&](int rows, int columns) {
      return Eigen::MatrixXd(Eigen::MatrixXd::NullaryExpr(
          rows, columns, [&](Eigen::Index, Eigen::Index) { return normal(random); }));
    };
    Eigen::MatrixXd H = filled(n, n);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j + 1 < i; ++j) H(i, j) = 0.0;
    if (n == 7) H(3, 2) = 0.0;  // falls apart into two blocks
    const Eigen::MatrixXd B = filled(n, 2);
    const Eigen::MatrixXd C = filled(3, n);
    const Eigen::MatrixXd D = filled(3, 2);
    std::vector<Complex> points;
    for (int k = 0; k < 50; ++k) points.emplace_back(normal(random), 3 * normal(random));
    std::vector<Complex> values(points.size() * 6);
    hessenberg_response(H, B, C, D, points, values);
    for (std::size_t k = 0; k < points.size(); ++k) {
      Eigen::MatrixXcd expected = D.cast<Complex>();
      if (n > 0) {
        const Eigen::MatrixXcd left = points[k] * Eigen::MatrixXcd::Identity(n, n) - H;
        expected += C.cast<Complex>() * left.fullPivLu().solve(B.cast<Complex>());
      }
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 2; ++c)
          EXPECT_LT(
              std::abs(
                  values[(k * 3 + static_cast<std::size_t>(r)) * 2 + static_cast<std::size_t>(c)] -
                  expected(r, c)),
              1e-11 * (1 + std::abs(expected(r, c))))
              << n;
    }
  }
}

}  // namespace
}  // namespace forceaxis::sim::test
