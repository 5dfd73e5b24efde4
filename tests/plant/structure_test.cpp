// Structures that are given by their modes: the same plant as bodies and springs, closed forms of
// an oscillator and of a beam, and frictions on ports.
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <string>
#include <vector>

#include "sim/linear/linear.hpp"
#include "sim/model/elements/all.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

using Wide = long double;
using Matrix = Eigen::Matrix<Wide, Eigen::Dynamic, Eigen::Dynamic>;

constexpr Wide kPi = std::numbers::pi_v<Wide>;

std::string mode_text(Wide frequency_hz, Wide damping_ratio, Wide mass,
                      const std::vector<Wide> &shape) {
  std::string text =
      "[[structure.mode]]\nfrequency = " + number(static_cast<double>(frequency_hz)) +
      "\ndamping_ratio = " + number(static_cast<double>(damping_ratio)) +
      "\nmodal_mass = " + number(static_cast<double>(mass)) + "\nshape = [";
  for (std::size_t i = 0; i < shape.size(); ++i)
    text += (i ? ", " : "") + number(static_cast<double>(shape[i]));
  return text + "]\n";
}

// Three bodies a, b, c in a row. The dampers of the springs, beta k, damp each mode by beta w / 2.
struct Chain {
  double mass[3] = {40, 15, 6};
  double stiffness[2] = {9e5, 4e5};  // between a and b, b and c
  double base = 0;                   // between a and ground
  double beta = 3e-4;

  std::string as_bodies() const {
    std::string text;
    const char *const names[] = {"a", "b", "c"};
    for (int i = 0; i < 3; ++i)
      text +=
          std::string("[[body]]\nname = \"") + names[i] + "\"\nmass = " + number(mass[i]) + "\n";
    const auto spring = [&](const std::string &name, const std::string &ends, double k) {
      text += "[[spring]]\nname = \"" + name + "\"\nbetween = [" + ends +
              "]\nstiffness = " + number(k) + "\ndamping = " + number(beta * k) + "\n";
    };
    spring("ab", R"("a", "b")", stiffness[0]);
    spring("bc", R"("b", "c")", stiffness[1]);
    if (base > 0) spring("base", R"("a", "ground")", base);
    return text;
  }

  // `scale`: factor of all shapes, which the modal masses take back.
  std::string as_modes(Wide scale) const {
    Matrix k = Matrix::Zero(3, 3);
    k(0, 0) = static_cast<Wide>(base);
    for (int i = 0; i < 2; ++i) {
      k(i, i) += stiffness[i];
      k(i + 1, i + 1) += stiffness[i];
      k(i, i + 1) -= stiffness[i];
      k(i + 1, i) -= stiffness[i];
    }
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) k(i, j) /= std::sqrt(Wide(mass[i]) * Wide(mass[j]));
    const Eigen::SelfAdjointEigenSolver<Matrix> solver(k);
    std::string text = "[[structure]]\nname = \"frame\"\nports = [\"a\", \"b\", \"c\"]\n";
    for (int n = 0; n < 3; ++n) {
      const bool rigid = base == 0 && n == 0;
      const Wide w = rigid ? 0 : std::sqrt(solver.eigenvalues()(n));
      std::vector<Wide> shape;
      for (int i = 0; i < 3; ++i)
        shape.push_back(scale * solver.eigenvectors()(i, n) / std::sqrt(Wide(mass[i])));
      text += mode_text(w / (2 * kPi), beta * w / 2, scale * scale, shape);
    }
    return text;
  }
};

const std::string kRest =
    "[[body]]\nname = \"work\"\nmass = 30\nposition = 0.0004\n"
    "[[spring]]\nname = \"support\"\nbetween = [\"work\", \"ground\"]\nstiffness = 2e6\n"
    "damping = 900\n"
    "[[contact]]\nname = \"tip\"\nbetween = [\"c\", \"work\"]\nstiffness = 8e5\ndamping = 60\n"
    "gap = 0.0002\n"
    "[[damper]]\nname = \"guide\"\nbetween = [\"a\", \"ground\"]\ndamping = 300\n"
    "[drive]\ntype = \"first_order\"\nbody = \"a\"\nk_act = 2000\na_act = 600\n"
    "velocity_per_volt = 0.02\n"
    "[encoder]\nbody = \"b\"\nreference = \"work\"\nscale = 1e6\n"
    "[[adc]]\nchannel = 0\nsignal = \"tip.force\"\nper_count = 0.5\nbits = 12\nzero_code = 2048\n";

double residual(const Plant &plant) {
  const EnergyAudit energy = plant.energy();
  double turned = energy.initial + std::fabs(energy.supplied) + energy.kinetic;
  for (const auto &damper : energy.dissipated) turned += damper.energy;
  return std::fabs(energy.residual) / turned;
}

double dissipated(const Plant &plant) {
  double sum = 0.0;
  for (const auto &damper : plant.energy().dissipated) sum += damper.energy;
  return sum;
}

// Runs the two plants with equal codes and impulses; all signals of the second must be those of the
// first. Returns the number of contact losses.
std::int64_t expect_equal_motion(Plant &one, Plant &other, int ticks, double tolerance) {
  const auto &names = other.signal_names();
  std::vector<double> size(names.size(), 0.0);
  std::vector<double> worst(names.size(), 0.0);
  for (int k = 0; k < ticks; ++k) {
    const int code = static_cast<int>(900 * std::sin(0.021 * k) + 500 * std::sin(0.0037 * k * k));
    if (k % 200 == 150) {
      one.apply_impulse("c", 0.3);
      other.apply_impulse("c", 0.3);
    }
    const SensorCodes &codes = one.codes();
    const SensorCodes &others = other.codes();
    EXPECT_LE(std::abs(codes.encoder - others.encoder), 1);
    EXPECT_LE(std::abs(codes.adc[0] - others.adc[0]), 1);
    one.step(code, k % 500 < 470, true);
    other.step(code, k % 500 < 470, true);
    for (std::size_t i = 0; i < names.size(); ++i) {
      const double value = one.signal(names[i]);
      size[i] = std::max(size[i], std::fabs(value));
      worst[i] = std::max(worst[i], std::fabs(value - other.signal_at(i)));
    }
  }
  for (std::size_t i = 0; i < names.size(); ++i)
    EXPECT_LE(worst[i], tolerance * size[i]) << names[i] << " of " << size[i];
  EXPECT_EQ(one.crossings(), other.crossings());
  EXPECT_LT(residual(one), 1e-11);
  EXPECT_LT(residual(other), 1e-11);
  const double lost = dissipated(one);
  EXPECT_NEAR(dissipated(other) / lost, 1.0, 1e-8);
  return count_of(other, "tip", "pressed", "overlap") + count_of(other, "tip", "pressed", "apart");
}

TEST(Structure, MovesAsItsBodiesAndSpringsFreeAndInContact) {
  for (const double base : {0.0, 3e5}) {
    Chain chain;
    chain.base = base;
    Plant bodies(make_model(chain.as_bodies() + kRest), {.audit = true});
    for (const Wide scale : {1.0L, 0.37L}) {
      Plant modes(make_model(chain.as_modes(scale) + kRest), {.audit = true});
      Plant again = bodies;
      EXPECT_GT(expect_equal_motion(again, modes, 1500, 1e-9), 3) << "base " << base;
    }
  }
}

// One friction holds a port against ground, another one two ports against each other, and a brake
// a port against a body.
TEST(Structure, SticksAndSlidesAsItsBodies) {
  const std::string rubs =
      "[[friction]]\nname = \"rail\"\nbetween = [\"b\", \"ground\"]\ncoulomb = 12\nstiction = 19\n"
      "[[friction]]\nname = \"joint\"\nbetween = [\"c\", \"b\"]\ncoulomb = 5\n"
      "[[brake]]\nname = \"clamp\"\nbetween = [\"a\", \"work\"]\nholding = 30\nrelease = 0.05\n";
  const Chain chain;
  Plant bodies(make_model(chain.as_bodies() + kRest + rubs), {.audit = true});
  Plant modes(make_model(chain.as_modes(1) + kRest + rubs), {.audit = true});
  (void)expect_equal_motion(bodies, modes, 900, 1e-8);
  for (const char *name : {"rail", "joint"})
    EXPECT_GT(count_of(modes, name, "stuck", "forward"), 3) << name;
}

// While a port with several modes sticks, its velocity stays 0 to rounding.
TEST(Structure, APortThatSticksStaysWhereItIs) {
  const std::string rail =
      "[[friction]]\nname = \"rail\"\nbetween = [\"b\", \"ground\"]\ncoulomb = 1e6\n";
  Plant plant(make_model(Chain().as_modes(1) + kRest + rail), {.audit = true});
  plant.apply_impulse("a", 1.0);
  for (int k = 0; k < 3000; ++k) plant.step(k % 100 < 50 ? 800 : -800, true);
  EXPECT_LT(std::fabs(plant.signal("b.velocity")), 1e-13);
  const double rest = plant.signal("b.position");
  for (int k = 0; k < 3000; ++k) plant.step(k % 100 < 50 ? 800 : -800, true);
  EXPECT_LT(std::fabs(plant.signal("b.position") - rest), 1e-13);
  EXPECT_LT(residual(plant), 1e-11);
}

using Complex = std::complex<double>;

std::vector<Complex> poles(const Linear &linear) {
  const Eigen::EigenSolver<Eigen::MatrixXd> solver(linear.A, false);
  std::vector<Complex> found(solver.eigenvalues().begin(), solver.eigenvalues().end());
  std::sort(found.begin(), found.end(), [](Complex x, Complex y) {
    return std::pair(std::round(x.imag() * 1e3), x.real()) <
           std::pair(std::round(y.imag() * 1e3), y.real());
  });
  return found;
}

Eigen::MatrixXcd response(const Linear &linear, double w) {
  const auto n = linear.A.rows();
  const Eigen::MatrixXcd s = Complex(0, w) * Eigen::MatrixXcd::Identity(n, n) - linear.A;
  return linear.C * s.partialPivLu().solve(linear.B.cast<Complex>()) + linear.D.cast<Complex>();
}

TEST(Structure, HasTheLinearFiguresOfItsBodies) {
  const std::string rail =
      "[[friction]]\nname = \"rail\"\nbetween = [\"b\", \"ground\"]\ncoulomb = 1\n";
  const Chain chain;
  const auto bodies = make_model(chain.as_bodies() + kRest + rail);
  const auto modes = make_model(chain.as_modes(2.5L) + kRest + rail);
  const std::string inputs[] = {"drive.command", "c.force", "drive.force"};
  const std::string outputs[] = {"reading", "encoder", "b.acceleration", "tip.spring_force_rate"};
  LinearMode pressed, slides, free;
  slides.states = {{"rail", "forward"}};
  free = slides;
  free.free = true;
  for (const LinearMode &mode : {pressed, slides, free}) {
    const Linear one = linearise(*bodies, mode, inputs, outputs);
    const Linear other = linearise(*modes, mode, inputs, outputs);
    ASSERT_EQ(one.A.rows(), other.A.rows());
    const auto expected = poles(one);
    const auto found = poles(other);
    double largest = 0.0;
    for (const Complex pole : expected) largest = std::max(largest, std::abs(pole));
    for (std::size_t i = 0; i < expected.size(); ++i)
      EXPECT_LT(std::abs(found[i] - expected[i]), 1e-6 * largest) << expected[i];
    for (const double w : {3.0, 40.0, 150.0, 333.0, 2000.0}) {
      const Eigen::MatrixXcd a = response(one, w);
      const Eigen::MatrixXcd b = response(other, w);
      for (Eigen::Index i = 0; i < a.rows(); ++i)
        for (Eigen::Index j = 0; j < a.cols(); ++j)
          EXPECT_LT(std::abs(a(i, j) - b(i, j)), 1e-8 * a.row(i).cwiseAbs().maxCoeff() + 1e-13)
              << outputs[i] << " / " << inputs[j] << " at " << w;
    }
  }
  EXPECT_EQ(linearise(*modes, pressed, inputs, outputs).states[2], "frame.1.position");
}

// x = J s^2 / (m wd) e^(-zeta w t) sin(wd t) after an impulse J at a port with the shape s.
TEST(Structure, ModeRingsAsAnOscillator) {
  const double f = 23, zeta = 0.03, mass = 4, s = 0.7, impulse = 0.5;
  Plant plant(make_model("[[structure]]\nname = \"arm\"\nports = [\"tip\", \"root\"]\n" +
                         mode_text(f, zeta, mass, {s, -0.2L})),
              {.audit = true});
  plant.apply_impulse("tip", impulse);
  const double w = 2 * std::numbers::pi * f, wd = w * std::sqrt(1 - zeta * zeta);
  const double top = impulse * s * s / (mass * wd);
  for (int k = 1; k <= 1500; ++k) {
    plant.step(0, false);
    const double t = k * kTickS;
    const double x = top * std::exp(-zeta * w * t) * std::sin(wd * t);
    ASSERT_NEAR(plant.signal("tip.position"), x, 1e-13 * top);
    ASSERT_NEAR(plant.signal("root.position"), x * -0.2 / s, 1e-13 * top);
  }
  const EnergyAudit energy = plant.energy();
  EXPECT_NEAR(energy.impulses, 0.5 * impulse * impulse * s * s / mass, 1e-16);
  ASSERT_EQ(energy.dissipated.size(), 1U);
  EXPECT_EQ(energy.dissipated[0].element, "arm");
  EXPECT_LT(residual(plant), 1e-13);
}

// A structure is one element of the balance whatever the number of its modes.
TEST(Structure, IsOneElementOfTheEnergyBalance) {
  Plant plant(make_model(Chain().as_modes(1) + kRest), {.audit = true});
  plant.apply_impulse("c", 1.0);
  for (int k = 0; k < 200; ++k) plant.step(0, false);
  int found = 0;
  for (const auto &damper : plant.energy().dissipated) found += damper.element == "frame";
  EXPECT_EQ(found, 1);
}

// An external force acts on each mode by the shape: q = F s / (m w^2) at rest.
TEST(Structure, ForceBendsAllModes) {
  const std::string push =
      "[[external]]\nname = \"push\"\nbody = \"tip\"\ntimes = [0, 100]\nforces = [50, 50]\n";
  Plant plant(make_model("[[structure]]\nname = \"arm\"\nports = [\"tip\", \"root\"]\n" +
                         mode_text(20, 0.7L, 3, {1, 0.4L}) + mode_text(90, 0.5L, 2, {-0.6L, 1}) +
                         push));
  for (int k = 0; k < 3000; ++k) plant.step(0, false);
  const auto softness = [](double f, double mass) {
    const double w = 2 * std::numbers::pi * f;
    return 1 / (mass * w * w);
  };
  EXPECT_NEAR(plant.signal("tip.position") / (50 * (softness(20, 3) + 0.36 * softness(90, 2))), 1.0,
              1e-12);
  EXPECT_NEAR(
      plant.signal("root.position") / (50 * (0.4 * softness(20, 3) - 0.6 * softness(90, 2))), 1.0,
      1e-12);
}

// A cantilever of length 1, mass 1 and bending stiffness 1: cos b cosh b = -1, w = b^2, and each
// mass-normalised shape is 2 at the tip.
class Cantilever {
 public:
  static Wide root(int n) {
    Wide b = (n - 0.5L) * kPi;
    for (int i = 0; i < 50; ++i)
      b -= (std::cos(b) + 1 / std::cosh(b)) /
           (-std::sin(b) - std::sinh(b) / (std::cosh(b) * std::cosh(b)));
    return b;
  }
  /// Compliance of the modes that are left out.
  static Wide left_out(int modes) {
    Wide left = 1 / 3.0L;
    for (int n = 1; n <= modes; ++n) left -= 4 / std::pow(root(n), 4.0L);
    return left;
  }
  /// With `residual`, the compliance of the modes that are left out is a mode of 200 Hz.
  static std::string text(int modes, bool residual) {
    std::string text = "[[structure]]\nname = \"beam\"\nports = [\"tip\"]\n";
    for (int n = 1; n <= modes; ++n) text += mode_text(root(n) * root(n) / (2 * kPi), 0, 1, {2});
    if (residual) text += mode_text(200, 0, 1, {2 * kPi * 200 * std::sqrt(left_out(modes))});
    return text;
  }
  /// Deflection of the tip for a unit of force there, at the frequency w.
  static double receptance(Wide w) {
    const Wide b = std::sqrt(w);
    const Wide up = std::sin(b) * std::cosh(b) - std::cos(b) * std::sinh(b);
    return static_cast<double>(up / (b * b * b * (1 + std::cos(b) * std::cosh(b))));
  }
};

TEST(Structure, TruncatedBeamIsTheBeamWithItsResidualCompliance) {
  const std::string inputs[] = {"tip.force"};
  const std::string outputs[] = {"tip.position"};
  const auto at = [&](int modes, bool residual, double w) {
    const auto model = make_model(Cantilever::text(modes, residual));
    return response(linearise(*model, {}, inputs, outputs), w)(0, 0).real();
  };
  EXPECT_NEAR(static_cast<double>(Cantilever::root(1)), 1.875104068711961, 1e-15);
  EXPECT_NEAR(at(4, true, 0.0) * 3, 1.0, 1e-12);
  const auto left = static_cast<double>(Cantilever::left_out(6));
  EXPECT_NEAR(at(6, false, 0.0), 1 / 3.0 - left, 1e-13);
  const auto next = static_cast<double>(std::pow(Cantilever::root(7), 2.0L));
  for (const double w : {1.0, 3.0, 10.0, 30.0, 100.0}) {
    const double beam = Cantilever::receptance(w);
    const double bare = std::fabs(at(6, false, w) - beam);
    const double full = std::fabs(at(6, true, w) - beam);
    // A mode of the frequency `next` or above answers statically to within this share.
    const double share = w * w / (next * next - w * w);
    EXPECT_NEAR(bare, left, share * left + 1e-12) << w;
    EXPECT_LT(full, share * left + 1e-12) << w;
  }
}

TEST(Structure, APlantMayHaveNoBody) {
  const std::string text = Chain().as_modes(1) +
                           "[drive]\ntype = \"perfect\"\nbody = \"a\"\nreaction = \"c\"\n"
                           "force_per_volt = 10\n[encoder]\nbody = \"c\"\nreference = \"a\"\n"
                           "scale = 1e9\n"
                           "[[spring]]\nname = \"tie\"\nbetween = [\"b\", \"ground\"]\n"
                           "stiffness = 1e5\ndamping = 4000\n";
  Plant plant(make_model(text), {.audit = true});
  for (int k = 0; k < 3000; ++k) plant.step(1000, true);
  // At rest the force of the drive is in both springs of the chain.
  const double force = 1000 * 20.0 / 4096 * 10;
  const double apart = -force * (1 / 9e5 + 1 / 4e5);
  EXPECT_NEAR(plant.codes().encoder, apart * 1e9, 1.0);
  EXPECT_LT(residual(plant), 1e-11);
}

}  // namespace
}  // namespace forceaxis::sim::test
