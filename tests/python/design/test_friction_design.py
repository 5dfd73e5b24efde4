"""A press with friction and backlash from its data sheet to a law that bears both."""

import json
import math
import random

import pytest
import verbs
from forceaxis import _core
from forceaxis.design import changes, friction, simulate

FRICTION_N, OVER = 40.0, 0.3
SHEET = (
    "--guide-coulomb-n", "40", "--backlash-mm", "0.05", "--transmission-stiffness-n-per-m", "2e7"
)  # fmt: skip


@pytest.fixture(scope="module")
def press(tmp_path_factory):
    """The folder that `forceaxis new` writes, without its bank."""
    folder = tmp_path_factory.mktemp("friction") / "press"
    done = verbs.forceaxis("new", str(folder), "--yes", "--no-design", *SHEET)
    assert done.returncode == 0, done.stderr
    return folder


def printed(*arguments):
    done = verbs.forceaxis(*map(str, arguments))
    assert done.returncode == 0, done.stderr
    return done.stdout


MODE = "mode         seals slides, transmission closed, sensor pressed"


def test_verbs_about_designs_take_the_sliding_mode(press):
    model = press / "model.toml"
    assert MODE in printed("loop", "advise", model, "--linear")
    assert MODE in printed(
        "loop", "compliance", model, "--points", "2", "--from", "5e5", "--to", "1e6"
    )
    stuck = verbs.forceaxis("loop", "advise", str(model), "--linear", "--mode", "seals=stuck")
    assert stuck.returncode == 2
    assert "while seals is stuck; --mode seals=forward gives a signal path" in stuck.stderr
    for words, *more in (
        (("loop", "compliance"),),
        (("design",), "--over", "k_s=30%", "--no-simulate"),
    ):
        done = verbs.forceaxis(*words, str(model), *more, "--mode", "seals=stuck")
        assert done.returncode == 2 and "while seals is stuck" in done.stderr, words


def test_a_measurement_says_that_friction_sticks(press):
    """40 N stick against what 1 V +- 0.02 V bring."""
    common = ("measure", press / "model.toml", "--output", "sensor.force", "--bias", "1",
              "--band", "10:100", "--resolution", "10", "--averages", "4")  # fmt: skip
    assert "seals was stuck" in printed(*common, "--level", "0.02")


def test_friction_is_a_range_from_none_to_twice(press):
    """Or to half-way to what the drive brings, where twice as much would not move. The drive's
    largest force: 10 V / (0.5 V/A), 0.09 N m/A, 10 mm / (2 pi): 1131 N."""
    model = press / "model.toml"
    (seals,) = friction.ranges(model)
    assert seals.declared_N == (("coulomb", FRICTION_N),) and seals.most == 2.0
    assert friction.members((seals,)) == [{"coulomb": 0.0}, {"coulomb": 80.0}]
    drawn = [one["coulomb"] for one in friction.drawn((seals,), 400, 1)]
    assert 0.0 <= min(drawn) < 4.0 and 76.0 < max(drawn) <= 80.0
    largest = 20.0 * 0.09 / (0.01 / (2 * math.pi))
    (heavy,) = friction.ranges(model, {"coulomb": 900.0})
    assert heavy.most_N == pytest.approx((900.0 + largest) / 2, rel=1e-3)
    assert friction.ranges(model, {"coulomb": 1200.0}) == ()  # never slides
    assert friction.ranges(model, {"coulomb": 0.0}) == ()


def test_a_friction_that_is_a_number_of_the_file_is_varied_too(press):
    text = (press / "model.toml").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("coulomb = { value")]
    plain = "\n".join(lines).replace('coulomb = "coulomb"', 'coulomb = 40.0\nstiction = "50 N"')
    path = press / "plain.toml"
    path.write_text(plain + "\n")
    with changes.Design(str(path)) as design:
        bench = simulate.ContactBench(design, 12)
        (seals,) = bench.frictions
        assert dict(seals.declared_N) == {"seals_coulomb": 40.0, "seals_stiction": 50.0}
        assert seals.most_N == 100.0


def test_what_presses_on_out_of_contact_slides(press):
    """The code of a speed against the most friction: with the drive's own slope of force over
    speed, D = 2 pi 40 Hz times 29.74 kg, 80 N take 10.7 mm/s of 250 mm/s at 2048 codes."""
    with changes.Design(str(press / "contact.toml")) as design:
        bench = simulate.ContactBench(design, 12)
        found = bench.press_speed_code(0.01)
    mass = 19.74 + 10.0
    most = 80.0 / (2 * math.pi * 40.0 * mass)
    assert found == pytest.approx((0.01 + most) / 0.25 * 2048, rel=0.02)


def outcomes(experiment, members):
    """[(member, verdict and fault, static error in %, peak in set-points, losses of contact)]."""
    jobs = [
        (str(experiment), [f"{n}={v!r}" for n, v in one.items()]
         + [f"firmware.latency_ticks={i % 2}"]) for i, one in enumerate(members)
    ]  # fmt: skip
    for one, run in zip(members, _core.run_many(jobs, 2, None, True, None, _core.Experiments()),
                        strict=True):  # fmt: skip
        metrics = run["metrics"]
        held = metrics.held_force
        yield (
            one, (run["verdict"], run["fault"]), abs(held.error_percent),
            metrics.peak_force_N / held.setpoint_N, metrics.contact_losses_run,
        )  # fmt: skip


def bears(experiment, members):
    """The law of an experiment on members: stable, 2 %, 1.3 set-points, one loss."""
    for member, verdict, error, peak, losses in outcomes(experiment, members):
        assert verdict == ("stable", "none"), member
        assert error <= 2.0 and peak <= 1.3 and losses <= 1, (member, error, peak, losses)


def drawn(count, stiffness=1e6, seed=28):
    rng = random.Random(seed)
    friction_N = [0.0, 2 * FRICTION_N, *(rng.uniform(0, 2 * FRICTION_N) for _ in range(count - 2))]
    shares = [rng.uniform(1 - OVER, 1 + OVER) for _ in friction_N]
    return [{"coulomb": N, "k_s": k * stiffness} for N, k in zip(friction_N, shares, strict=True)]


def test_the_law_of_new_bears_the_friction_that_is_not_there(tmp_path):
    """A law tried with its friction alone lost contact without it and held 0.4 of 117 N."""
    folder = tmp_path / "press"
    found = json.loads(printed("new", folder, "--yes", "--json", *SHEET))["design"]
    assert "refused" not in found
    bears(folder / "held.toml", drawn(12))


@pytest.mark.long
@pytest.mark.beside
def test_a_designed_law_on_two_hundred_members_with_friction(tmp_path):
    """Verdict, static error, peak and losses; fS at least 0.8 of the frictionless design's."""
    folder = tmp_path / "press"
    printed("new", folder, "--yes", *SHEET)
    bears(folder / "held.toml", drawn(200))
    law = tmp_path / "law"
    given = ("design", folder / "model.toml", "--over", "k_s=30%", "--json")
    found = json.loads(printed(*given, "--out", law))
    assert found["mode_text"] == "seals slides, transmission closed, sensor pressed"
    assert found["friction_N"] == {"coulomb": [0.0, 80.0]}
    bears(law / "contact.toml", drawn(200))
    plain = json.loads(printed(*given, "--set", "coulomb=0"))
    assert plain["friction_N"] == {}
    assert found["worst"]["fS_Hz"] >= 0.8 * plain["worst"]["fS_Hz"]
