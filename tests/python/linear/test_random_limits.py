"""Limits of random loops against the eigenvalues of stepped loops, of which
`tests/support/limit_study.py 10000` studies ten thousand, and laws whose dead zone is as large as
the set-point."""

import json
import os
import subprocess
import sys
from fractions import Fraction
from types import SimpleNamespace

import draws
import kernels
import limit_study
import numpy as np
import pytest
from forceaxis import InputError, linear
from forceaxis.commission import tune
from forceaxis.commission.refusal import Refusal
from forceaxis.design import data_sheet, for_set, new
from forceaxis.design.outcome import DesignOrder
from forceaxis.linear import over
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec, force_loop
from forceaxis.linear.plant_set import PlantSet
from forceaxis.linear.stability import Limit
from limit_study import Drawn
from verbs import forceaxis

SECTION = (1.394373, -2.718615, 1.362417, -1.741615, 0.77979)  # a lead
SENSOR = {"sensor_bits": "16", "sensor_noise_n": ".1", "workpiece_stiffness_n_per_m": "1e6"}


def model(**given):
    """The text of a model of `forceaxis new`."""
    values, sources = data_sheet.collect(SENSOR | given)
    return new.render("model.toml", "s", new.derive(values), sources)


@pytest.mark.quick
def test_random_loops_have_the_limit_of_their_eigenvalues():
    """FORCEAXIS_LIMIT_LOOPS loops from number FORCEAXIS_LIMIT_FIRST on."""
    count = int(os.environ.get("FORCEAXIS_LIMIT_LOOPS", "10"))
    first = int(os.environ.get("FORCEAXIS_LIMIT_FIRST", "0"))
    found = limit_study.run(count, 5, first)
    assert not [one for one in found if one.wrong]
    assert all(one.gain is not None for one in found)


@pytest.mark.beside
@pytest.mark.long
@pytest.mark.parametrize("kernel", draws.some("kernels", kernels.executed(), 2))
def test_random_loops_have_their_limits_under_every_kernel(kernel):
    """Under two kernels, drawn by the commit; with FORCEAXIS_WHOLE=1 under each."""
    done = subprocess.run(
        [sys.executable, limit_study.__file__, "--rows", "16", "6"], check=True,
        env=kernels.environment(kernel), capture_output=True, text=True,
    )  # fmt: skip
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(rows) == 16 and not [row for row in rows if row["wrong"]]
    for row, own in zip(rows, limit_study.run(16, 6), strict=True):
        assert row["gain"] == pytest.approx(own.gain, rel=1e-9), row


# Loops of a study whose limit was said to be 0 or none: two integrators that rounding separates,
# and several codes in a period.
@pytest.mark.parametrize("number", [106, 120, 128, 149])
def test_loops_that_once_had_no_limit(number):
    (found,) = limit_study.run(1, 7, number)
    assert found.gain and not found.wrong, found


def wrong_of(file, drawn, limit, changed):
    """What the stepped loop says against a limit."""
    plant = linear.linearise(file, overrides=changed)
    stepped = [
        limit_study.Stepped(drawn, (plant.A, plant.B, plant.C), phase)
        for phase in limit_study.phases(drawn)
    ]
    most = limit_study.FREE_ERROR_MAX if drawn.free else limit_study.ERROR_MAX
    return limit_study.judged(stepped, limit, most)[1]


def test_a_law_with_integral_on_a_stepper_has_a_limit(tmp_path):
    """Two plants that differ by 1e-5; rounding took the limit of the first one."""
    options = [part for name, value in SENSOR.items()
               for part in (f"--{name.replace('_', '-')}", value)]  # fmt: skip
    done = forceaxis(
        "new", "s", "--yes", "--no-design", "--drive", "stepper", *options, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    file = tmp_path / "s/model.toml"
    law = ["--law", "pi:integral=4", "--timing", "zoh", "--json"]
    for stiffness, mass in ((576300.0, 1.5075), (576295.893583, 1.507515)):
        sets = ["--set", f"k_w={stiffness}", "--set", f"m_w={mass}"]
        found = json.loads(forceaxis("loop", "limit", file, *law, *sets).stdout)
        assert found["critical_gain"] == pytest.approx(0.0484376, rel=3e-6)
        assert found["frequency_hz"] == pytest.approx(191.9, abs=0.05)
        limit = Limit(found["critical_gain"], found["frequency_hz"], [], [], "")
        drawn = Drawn("stepper", "", "pi", "zoh", 4.0)
        assert not wrong_of(file, drawn, limit, {"k_w": stiffness, "m_w": mass})


def test_a_slow_sensor_on_a_bus_of_8_ms_has_limits(tmp_path):
    """Every third of 48 members was said to be stable at no gain; the true limit is 0.013 V/N."""
    text = model(
        drive="velocity", bus_cycle_ms="8", sensor_rate_hz="500", sensor_filter="sinc3",
        sensor_latency_ms="0.1",
    )  # fmt: skip
    (tmp_path / "model.toml").write_text(text)
    for stiffness in np.geomspace(0.7e6, 1.3e6, 3):
        changed = {"k_w": float(stiffness)}
        limit = force_loop(tmp_path / "model.toml", "pi", "zoh", changed,
                           integral_rad_per_s=4.0).limit()  # fmt: skip
        drawn = Drawn("velocity", text, "pi", "zoh", 4.0, cycle=12, out=12, every=Fraction(3),
                      latency=Fraction(15, 100), order=3)  # fmt: skip
        wrong = wrong_of(tmp_path / "model.toml", drawn, limit, changed)
        assert limit.gain and not wrong, (stiffness, limit, wrong)


def test_a_bank_on_a_bus_of_2_ms_has_a_limit_over_a_set(tmp_path):
    """Five codes in a period; nothing was found within the gains that were tried."""
    file = tmp_path / "model.toml"
    file.write_text(model(drive="velocity", bus_cycle_ms="2", sensor_rate_hz="600"))
    spec = LoopSpec("bank", bank=Bank(1.0, 30.0, 0.0, (SECTION,)))
    found = over.largest_gain(
        PlantSet(str(file), ranges={"k_w": (1e6, 0.7e6, 1.3e6)}), ("zoh",), spec
    )
    assert found.gain and found.known_to is None
    for stiffness in (0.7e6, 1e6, 1.3e6):
        limit = spec.around(file, {"k_w": stiffness}).limit()
        assert limit.gain >= found.gain * (1 - 1e-9)


def test_the_limit_of_an_unknown_phase_is_the_lowest_of_all_phases(tmp_path):
    """A sample in every other tick: the lowest of three phases was 1 % too high."""
    text = model(drive="amplifier", sensor_rate_hz="750", sensor_latency_ms="0")
    (tmp_path / "free.toml").write_text(text)
    loop = LoopSpec("p", "zoh+1").around(tmp_path / "free.toml")
    free = loop.limit().gain
    assert over.figures(loop, free / 2).gain_margin == pytest.approx(2, rel=1e-9)
    assert loop.margins(free / 2).gain_margin == pytest.approx(2, rel=1e-9)
    assert not loop.stable(1.001 * free) and not over.figures(loop, 1.001 * free).stable
    limits = []
    for part in range(40):
        keys = f"channel = 0\nsample_phase = {part / 40 / 750!r}\n"
        (tmp_path / "one.toml").write_text(text.replace("channel = 0\n", keys, 1))
        limits.append(LoopSpec("p", "zoh+1").around(tmp_path / "one.toml").limit().gain)
    assert free * (1 - 1e-4) <= min(limits) <= free * (1 + 1e-3)


# Rounding of the command.

FAST = {"drive": "velocity", "full_scale_speed_m_per_s": "60"}  # a code is 29 mm/s


def tuning(file, *forces):
    order = SimpleNamespace(over=("k_w=30%",), forces=forces)
    return SimpleNamespace(model=file, order=order, states={})


def test_a_law_whose_command_rounds_to_nothing_is_refused(tmp_path):
    """With 12 bits the gain that is left for the test forces gives less than half a code for 30 N;
    with 16 bits of output a step is a sixteenth of a code."""
    coarse, fine = tmp_path / "coarse.toml", tmp_path / "fine.toml"
    coarse.write_text(model(**FAST))
    fine.write_text(model(**FAST, output_bits="16", bus_cycle_ms="2"))
    with pytest.raises(
        Refusal, match=r"dead_zone: expected a force law whose dead zone is smaller"
    ):
        tune.measuring_law(tuning(coarse, 30.0, 100.0))
    with pytest.raises(InputError, match="dead zone: expected a force law whose dead zone"):
        for_set.design(DesignOrder(str(coarse), over=("k_w=30%",), forces_N=(5.0,), simulate=False))
    known = linear.facts(fine)
    # Half of a step of the output over the gain: 0.5 / 16 / 0.1 counts of 500 N / 128.
    assert known.dead_zone(0.1) == pytest.approx(0.5 / 16 / 0.1 * 500 / 128)
    assert linear.facts(coarse).dead_zone(0.1) == pytest.approx(0.5 / 0.1 * 500 / 128)
    assert known.dead_law(0.1, 1.3) is None and known.dead_law(0.1, 1.2)
    assert known.dead_law(0.0, 1e9)


def test_limit_names_a_law_that_rounds_to_nothing(tmp_path):
    (tmp_path / "model.toml").write_text(model(**FAST))
    text = forceaxis("loop", "limit", tmp_path / "model.toml", "--law", "force_gain=0.003").stdout
    named = "dead zone    expected a force law whose dead zone is smaller than the set-point"
    assert named in text and " codes per 8-bit count, with which each force error below " in text
    of_set = ("--over", "b_s=10%", "--law", "force_gain=0.003")
    assert named in forceaxis("loop", "limit", tmp_path / "model.toml", *of_set).stdout
    text = forceaxis("loop", "limit", tmp_path / "model.toml", "--law", "force_gain=0.02").stdout
    assert "dead zone" not in text and "at           " in text


def test_the_gain_at_rest_has_the_sections(tmp_path):
    bank = Bank(0.5, 0.0, 0.0, ((0.2, 0.0, 0.0, -0.5, 0.0),))
    assert bank.gain_at_rest() == pytest.approx(0.2)
    assert Bank(0.5, 0.0, 0.0, ((1.0, -1.0, 0.0, 0.0, 0.0),)).gain_at_rest() == 0
    assert Bank(0.5, 3.0, 0.0, ((1.0, -1.0, 0.0, 0.0, 0.0),)).gain_at_rest() == float("inf")
