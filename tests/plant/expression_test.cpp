// Parameters whose values are products and quotients of others.
#include <string>

#include "sim/model/elements/all.hpp"
#include "tests/plant/plant_test.hpp"

namespace forceaxis::sim::test {
namespace {

// k_act of a first-order actuator by the time constant that its data sheet has.
std::string model(const std::string &k_act, const std::string &more = "") {
  return "[parameters]\nm = { value = 12, unit = \"kg\" }\n"
         "tau = { value = \"20 ms\", unit = \"s\" }\n"
         "k_act = { value = " +
         k_act + ", unit = \"N s/m\" }\n" + more +
         "[[body]]\nname = \"b\"\nmass = \"m\"\n"
         "[drive]\ntype = \"first_order\"\nbody = \"b\"\nk_act = \"k_act\"\na_act = 100\n"
         "velocity_per_volt = 0.01\n";
}

double k_act(const Model &m) { return std::get<FirstOrderDrive>(m.drive->type).k_act; }

std::string refusal(const std::string &text, std::span<const Override> overrides = {},
                    const std::string &file = "") {
  try {
    (void)load_model(write_model(text), overrides, file);
  } catch (const InputError &error) {
    return error.what();
  }
  return "";
}

bool has(const std::string &text, const std::string &part) {
  return text.find(part) != std::string::npos;
}

TEST(Expression, IsWorkedFromLeftToRight) {
  EXPECT_EQ(k_act(*make_model(model("\"m / tau\""))), 12 / 0.02);
  EXPECT_EQ(k_act(*make_model(model("\"2 * m/tau\""))), 2.0 * 12 / 0.02);
  EXPECT_EQ(k_act(*make_model(model("\"m*3 / tau / 1e-1\""))), 12.0 * 3 / 0.02 / 0.1);
  // (m / tau) * tau / tau, not m / (tau * tau) / tau.
  EXPECT_EQ(k_act(*make_model(model("\"m / tau * tau / tau\""))), 12 / 0.02 * 0.02 / 0.02);
}

TEST(Expression, MayNameOneThatIsComputedLater) {
  const std::string inner = "rate = { value = \"1 / tau\", unit = \"1/s\" }\n";
  EXPECT_EQ(k_act(*make_model(model("\"m * rate\"", inner))), 12 * (1 / 0.02));
}

TEST(Expression, FollowsOverrides) {
  const auto path = write_model(model("\"m / tau\""));
  const std::vector<Override> both = {{"tau", std::string("50 ms")}, {"m", 10.0}};
  EXPECT_EQ(k_act(load_model(path, both)), 10 / 0.05);
  // An override takes the place of the expression, or is one; what the file names stays used.
  const std::vector<Override> number = {{"k_act", 7.0}};
  EXPECT_EQ(k_act(load_model(path, number)), 7.0);
  const std::vector<Override> other = {{"k_act", std::string("3 * m / tau")}};
  EXPECT_EQ(k_act(load_model(path, other)), 3.0 * 12 / 0.02);
  const auto plain = write_model(model("5",
                                       "d = { value = 1, unit = \"kg\", documentation = true }\n"
                                       "e = { value = \"m / tau\", unit = \"kg/s\", "
                                       "documentation = true }\n"));
  const std::vector<Override> named = {{"k_act", std::string("e")}};
  EXPECT_EQ(k_act(load_model(plain, named)), 12 / 0.02);
}

TEST(Expression, WhatOnlyAnExpressionNamesIsUsed) {
  const std::shared_ptr<const Model> made = make_model(model("\"m / tau\""));
  for (const Parameter &p : made->parameters) EXPECT_TRUE(p.used) << p.name;
}

TEST(Expression, IsRefusedByName) {
  const std::string units = refusal(model("\"m * tau\""));
  EXPECT_TRUE(has(units,
                  "parameters.k_act.value: expected a damping in N s/m, got \"m * tau\" in "
                  "kg s; correct the expression or the unit"))
      << units;
  EXPECT_TRUE(has(refusal(model("\"m / tua\"")), "got \"tua\"; did you mean tau?"));
  EXPECT_TRUE(has(refusal(model("\"m / \"")), "names of parameters and numbers"));
  EXPECT_TRUE(has(refusal(model("\"m / 20 ms\"")), "names of parameters and numbers"));
  EXPECT_TRUE(has(refusal(model("\"m / 20ms\"")), "expected plain numbers"));
  EXPECT_TRUE(has(refusal(model("\"m / tau / 0\"")), "expected a finite number"));
  // Hz is not rad/s: 2 pi is not guessed.
  const std::string hertz = "f = { value = 8, unit = \"Hz\" }\n";
  EXPECT_TRUE(has(refusal(model("\"m * f\"", hertz)), "cycle"));
  const std::string circle =
      refusal(model("\"m * rate\"", "rate = { value = \"k_act / m\", unit = \"1/s\" }\n"));
  EXPECT_TRUE(has(circle, "the circular reference k_act -> rate -> k_act")) << circle;
  const std::vector<Override> own = {{"m", std::string("2 * m")}};
  const std::string set = refusal(model("\"m / tau\""), own, "run.toml");
  EXPECT_TRUE(has(set, "run.toml: set.m: ") && has(set, "the circular reference m -> m")) << set;
}

TEST(Expression, AnglesAreNumbers) {
  // Force of a motor's ampere: N m/A over m/rad is N/A; 0.5 / 0.004 N/A * 2 A.
  const std::string text =
      "[parameters]\nk = { value = 0.5, unit = \"N m/A\" }\nr = { value = 0.004, unit = \"m/rad\" "
      "}\n"
      "i = { value = 2, unit = \"A\" }\nF = { value = \"k / r * i\", unit = \"N\" }\n"
      "[[body]]\nname = \"b\"\nmass = 1\n[[friction]]\nname = \"f\"\n"
      "between = [\"b\", \"ground\"]\ncoulomb = \"F\"\n";
  EXPECT_EQ(make_model(text)->frictions[0].coulomb, 0.5 / 0.004 * 2);
}

TEST(Documentation, IsKeptWithoutAUse) {
  EXPECT_TRUE(has(refusal(model("5", "note = { value = 3, unit = \"kg\" }\n")), "documentation"));
  const auto made = make_model(
      model("\"m / tau\"", "inertia = { value = 3, unit = \"kg m^2\", documentation = true }\n"));
  for (const Parameter &p : made->parameters) {
    if (p.name == "inertia") {
      EXPECT_EQ(p.value, 3);
    }
  }
}

}  // namespace
}  // namespace forceaxis::sim::test
