"""`forceaxis thesis check`: the claims are computed, and what differs has a reason."""

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner
from forceaxis import linear
from forceaxis.cli import main as cli
from forceaxis.thesis import claims as thesis
from forceaxis.thesis.claim import Claim
from scipy import signal


@pytest.fixture(scope="module")
def result():
    run = CliRunner().invoke(cli.cli, ["thesis", "check", "--json"])
    assert run.exit_code == 0, run.output
    return json.loads(run.stdout)


def test_every_difference_has_a_reason(result):
    assert result["unexplained"] == 0
    assert result["agree"] + result["differ"] == len(result["claims"]) == len(thesis.CLAIMS)
    for claim in result["claims"]:
        assert bool(claim["why"]) == (not claim["agrees"]), claim


def test_a_reason_stands_only_where_something_differs(result):
    """The page of the sentences takes a claim with a reason as one that differs."""
    for claim, checked in zip(thesis.CLAIMS, result["claims"], strict=True):
        assert claim.what == checked["what"]
        assert bool(claim.why) == (not checked["agrees"]), claim.what


@pytest.mark.parametrize(
    ("claim", "agrees"),
    [
        (Claim("1", "a", 40, "Hz", lambda: 43.9, 0.1), True),
        (Claim("1", "a", 40, "Hz", lambda: 44.1, 0.1), False),
        (Claim("1", "a", 50, "deg", lambda: 90.0, 0.0, at_least=True), True),
        (Claim("1", "a", 50, "deg", lambda: 49.9, 0.0, at_least=True), False),
        (Claim("1", "a", 0, "", lambda: 1, 0.0), False),
        (Claim("1", "a", "higher", "", lambda: "higher: 2.8 times"), True),
        (Claim("1", "a", "higher", "", lambda: "not higher: 0.9 times"), False),
        (Claim("1", "a", "stable", "", lambda: "stable at any gain"), False),
        (Claim("1", "a", 3, "", lambda: "none"), False),
    ],
)
def test_when_a_claim_agrees(claim, agrees):
    assert claim.checked().agrees == agrees


def test_numbers_by_hand(result):
    """Some of ours again, from the print of Figs 4.4 and 4.26 alone."""
    ours = {claim["what"]: claim["ours"] for claim in result["claims"]}
    hz = 1 / (2 * math.pi)
    assert ours["workpiece by itself"] == pytest.approx(hz * math.sqrt(412700 / 6.6), rel=1e-4)
    arm = hz * math.sqrt(665000 * 132.4 / (114.5 * 17.9))
    found = next(v for k, v in ours.items() if k.startswith("arm mode, free"))
    assert found == pytest.approx(arm, rel=0.01)  # b_r couples it to the ground
    assert ours["current loop, shaft locked, k_amp = 15"] == pytest.approx(
        hz * (4.5 + 15 * 0.333) / 0.0158
    )
    dc = 3.9 * 0.039 * 15 * 0.5 / ((4.5 + 15 * 0.333) * 0.02 + 0.5 * 0.5 + 15 * 0.5 * 4.2 * 0.039)
    assert ours["motor without load at DC, k_amp = 15"] == pytest.approx(dc, rel=1e-3)
    damped = 363 / (2 * math.sqrt(412700 * 6.6))
    found = ours["damping ratio of the damped workpiece, b_w = 363 (chosen for it)"]
    assert found == pytest.approx(damped)


def leading(text):
    """The number behind the colon of a statement."""
    return float(text.partition(": ")[2].split()[0].rstrip(","))


def test_statements_by_hand(result):
    """Values behind the statements again, from the print of Figs 4.4 and 4.26 alone."""
    ours = {claim["what"]: claim["ours"] for claim in result["claims"]}
    hz = 1 / (2 * math.pi)
    at_carriage = 1 / 0.004043**2
    close = {"rel": 0.01}
    rotor = ours["rotor as a part of the moving mass"]
    assert leading(rotor) == pytest.approx(100 * 0.0013 * at_carriage / 132.4, **close)
    damping = ours["damping of the robot over that of the motor at the carriage"]
    assert leading(damping) == pytest.approx(500 / (0.02 * at_carriage), **close)
    beam = ours["damping ratio with material under the beam, b_w = 49.5 (chosen for it)"]
    assert beam == pytest.approx(49.5 / (2 * math.sqrt(412700 * 6.6)))
    unbolted = ours["first mode of the machine before it was bolted to the floor"]
    assert unbolted == pytest.approx(hz * math.sqrt(665000 * 132.4 / (114.5 * 17.9)), **close)
    locked = ours["arm mode with the motor locked, as measured, over that of the formula"]
    assert locked == pytest.approx(math.sqrt(114.5 / 132.4), rel=1e-3)
    base = ours["base mode by m_b and k_b alone"]
    assert base == pytest.approx(hz * math.sqrt(3.6e6 / 500))
    for_stiffness = ours["grip: damping for its stiffness, b_g / k_g over b_s / k_s"]
    assert leading(for_stiffness) == pytest.approx(30 / 25000 / (16.5 / 110100), **close)
    none = 1 / 110100 + 1 / 412700
    motion = ours["soft grip: motion for the same force over that without grip"]
    assert leading(motion) == pytest.approx((none + 1 / 25000) / none, rel=2e-3)
    # A rigid robot behind a sensor of a quarter of the stiffness: four times the gain.
    softer = ours["softer sensor, / 4: limit over that of the printed one"]
    assert leading(softer) == pytest.approx(4, **close)
    # Arm and endpoint of Fig 2.11: m_r2 is moved through spring and damper of the arm.
    s = 2j * math.pi * np.linspace(1, 300, 3000)
    arm = 640 * s + 665000
    ratio = arm / (17.9 * s**2 + 16.5 * s + 110100 + arm)
    phase = ours["endpoint against actuator: completely out of phase"]
    assert phase == pytest.approx(-np.degrees(np.unwrap(np.angle(ratio))).min(), rel=1e-3)
    assert ours["both solutions for m_r1 and m_r2, which exchange the masses"] == "17.9 and 114.5"
    speed = 0.5 / 6.6  # of the struck workpiece, m/s
    touch, struck = ours["first touch against a strike: speed"].partition(": ")[2].split(" and ")
    assert float(struck.removesuffix(" mm/s")) == pytest.approx(1e3 * speed, rel=0.2)
    assert float(touch) < 1e3 * speed


def test_poles_of_a_stiffer_workpiece_by_hand(result):
    """The denominator of 2.5.1 with k_w and with 4 k_w."""
    ours = {claim["what"]: claim["ours"] for claim in result["claims"]}

    def highest(k_w):
        robot, part = [132.4, 516.5, 110100], [6.6, 24.75, 110100 + k_w]
        off = np.polymul([16.5, 110100], [16.5, 110100])
        roots = np.roots(np.polysub(np.polymul(robot, part), off))
        return roots[np.argmax(roots.imag)]

    stiff, original = highest(4 * 412700), highest(412700)
    found = ours["workpiece four times stiffer: real part of its poles over that of the original"]
    assert found == pytest.approx(stiff.real / original.real, rel=1e-6)
    faster = leading(ours["workpiece four times stiffer: frequency of its poles"])
    assert faster == pytest.approx(abs(stiff) / abs(original), rel=0.01)


def test_the_rigid_robot_with_motor_by_hand(result):
    """Limits and frequencies from the polynomials of 4.1.1 and 4.3.1 and the print of Fig 4.4."""
    ours = {claim["what"]: claim["ours"] for claim in result["claims"]}
    r, a = 0.004043, 942

    def roots(gain, m_r=132.4, k_s=110100):
        lags = np.polymul([0.0158, 4.5 + 15 * 0.333], [1, a])
        back = np.polyadd([15 * 4.2 * 0.039 * a], [0.5, 0.5 * a]) * 0.5 / r**2
        fixed = np.polyadd(np.polymul(lags, [m_r, 516.5, k_s]), np.polymul(back, [1, 0]))
        moved = np.array([1, a]) * k_s * 0.5 * 15 * 3.9 / r
        return np.roots(np.polyadd(fixed, gain * moved))

    def limit(**plant):
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = (low + high) / 2
            stable = roots(middle, **plant).real.max() < 0
            low, high = (middle, high) if stable else (low, middle)
        return low

    def crossing_hz(**plant):
        found = roots(limit(**plant), **plant)
        return abs(found[np.argmax(found.real)].imag) / (2 * math.pi)

    printed = crossing_hz()
    assert ours["rigid robot with motor: crossover"] == pytest.approx(printed, rel=1e-6)
    heavier = leading(ours["heavier robot, x 1.2: crossover over that of the printed one"])
    assert heavier == pytest.approx(crossing_hz(m_r=1.2 * 132.4) / printed, rel=0.01)
    more = leading(ours["softer sensor, / 4: limit over that of the printed one"])
    assert more == pytest.approx(limit(k_s=110100 / 4) / limit(), rel=0.01)
    slow, fast = (
        min(abs(root) for root in roots(limit() / 2, k_s=k_s) if root.imag > 0)
        for k_s in (110100 / 4, 110100)
    )
    found = ours["softer sensor, / 4: frequency in contact, half of the printed limit"]
    assert leading(found) == pytest.approx(slow / fast, rel=0.01)


@pytest.mark.parametrize("times", [5, 10])
def test_the_sampled_limit_by_another_program(result, times):
    """SciPy's zero-order hold around the motor and the rigid robot, and the gain by bisection."""
    name = {5: "five", 10: "ten"}[times]
    ours = next(c["ours"] for c in result["claims"] if f"sampling at {name} times" in c["what"])
    system = linear.linearise("fig4_11")

    def limit(A, B, C, unstable):
        low, high = 1e-4, 1.0
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (low, middle) if unstable(A - middle * B @ C) else (middle, high)
        return low

    def leaves(A):
        return max(np.linalg.eigvals(A).real) > 0

    continuous = limit(system.A, system.B, system.C, leaves)
    closed = system.A - continuous * system.B @ system.C
    crossing_hz = max(abs(np.linalg.eigvals(closed).imag)) / (2 * math.pi)
    matrices = (system.A, system.B, system.C, system.D)
    A, B, C, *_ = signal.cont2discrete(matrices, 1 / (times * crossing_hz))
    sampled = limit(A, B, C, lambda A: max(abs(np.linalg.eigvals(A))) > 1)
    assert ours == pytest.approx(sampled / continuous, rel=1e-6)


def test_a_claim_follows_its_model(monkeypatch):
    """What is printed as ours is computed: another plant, another number, and no agreement."""
    heavier = linear.linearise

    def linearise(model, *arguments, overrides=None, **named):
        if model == "fig4_19":
            overrides = {"m_w": 13.2} | (overrides or {})
        return heavier(model, *arguments, overrides=overrides, **named)

    monkeypatch.setattr(linear, "linearise", linearise)
    claim = next(c for c in thesis.CLAIMS if c.what == "workpiece by itself").checked()
    assert claim.ours == pytest.approx(39.8 / math.sqrt(2), rel=1e-3)
    assert not claim.agrees
