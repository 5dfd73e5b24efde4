"""`forceaxis loop advise`: rows against independent computations, the mode that limits,
simulation."""

import json
import sys
from dataclasses import replace

import control
import numpy as np
import pytest
from forceaxis import _core, linear, paths
from forceaxis.bench import bench
from forceaxis.cli import main as cli
from forceaxis.cli.advise_text import describe
from forceaxis.cli.bench import bench_text
from forceaxis.design import advise
from forceaxis.linear import loops
from forceaxis.results import to_json
from scipy import optimize


class Advised(dict):
    """The JSON of an advice; `advice` is the result itself."""

    def __init__(self, advice):
        super().__init__(to_json(advice))
        self.advice = advice


def advised(*given, **named):
    return Advised(advise.advise(advise.AdviceOrder(*given, **named)))


@pytest.fixture(scope="module")
def laboratory():
    return advised("laboratory", runs="none")


@pytest.fixture(scope="module")
def workpiece():
    return advised("fig4_19", runs="none")


def row(result, start):
    (found,) = (r for r in result["rows"] if r["change"].startswith(start))
    return found


def halved(model, overrides=None, delay=0, tick_s=1 / 1500, modes=None):
    """Critical gain, V/N, of the exported matrices with python-control's hold and eigenvalues."""
    plant = linear.linearise(model, overrides=overrides, modes=modes)
    held = control.c2d(control.ss(plant.A, plant.B, plant.C, plant.D), tick_s)
    for _ in range(delay):
        held = held * control.ss([[0]], [[1]], [[1]], [[0]], tick_s)

    def stable(gain):
        return np.abs(np.linalg.eigvals(held.A - gain * held.B @ held.C)).max() < 1

    gains = np.geomspace(1e-4, 10, 2000)
    i = next(i for i, gain in enumerate(gains) if not stable(gain))
    low, high = gains[i - 1], gains[i]
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


@pytest.mark.parametrize(
    ("start", "how"),
    [
        ("sensor stiffness k_s x 2", {"overrides": {"k_s": 220200.0}}),
        ("arm stiffness k_rf / 2", {"overrides": {"k_rf": 332500.0}}),
        ("tip mass m_r2 x 2", {"overrides": {"m_r2": 35.8}}),
        ("slide damping b_r x 2", {"overrides": {"b_r": 1000.0}}),
        ("workpiece damping 8.25 -> 363 N s/m (zeta 0.11)", {"overrides": {"b_w": 363.0}}),
        ("sample rate x 2 (3000 Hz)", {"tick_s": 1 / 3000}),
        ("sample rate / 2 (750 Hz)", {"tick_s": 1 / 750}),
        ("one tick more of delay", {"delay": 1}),
        ("amplifier on its outer slope", {"modes": {"drive.amplifier": "high outer"}}),
    ],
)
def test_a_row_is_the_changed_models_limit(laboratory, start, how):
    found = row(laboratory, start)
    assert found["critical_gain"] == pytest.approx(halved("laboratory", **how), rel=1e-6)
    present = halved("laboratory")
    assert laboratory["present"]["critical_gain"] == pytest.approx(present, rel=1e-6)
    assert found["ratio"]["critical_gain"] == pytest.approx(found["critical_gain"] / present, 1e-6)
    # 2.5 N a count, 20/4096 V a code.
    assert found["firmware_gain"] == pytest.approx(found["critical_gain"] * 2.5 / (20 / 4096))


@pytest.mark.parametrize(
    ("model", "start", "same"),
    [
        ("fig4_19", "grip pad of 25,000", "fig4_25"),  # put in: bodies of the other figure
        ("fig4_19", "grip pad of 120,000", "fig5_2"),
        ("fig4_24", "grip pad of 25,000", "fig4_25"),  # exchanged
        ("fig4_25", "no grip pad", "fig4_24"),
        ("laboratory", "grip pad of 25,000", "laboratory_grip"),
    ],
)
def test_a_grip_pad_makes_the_other_figure(model, start, same):
    found = row(advised(model, runs="none"), start)
    wanted = loops.force_loop(same).limit()
    assert found["critical_gain"] == pytest.approx(wanted.gain, rel=1e-9)
    assert found["frequency_hz"] == pytest.approx(wanted.frequency_hz, rel=1e-9)


def test_crossover_and_loop_gain_are_as_defined(laboratory):
    for found, overrides in (
        (laboratory["present"], {}),
        (row(laboratory, "sensor stiffness k_s / 2"), {"k_s": 55050.0}),
    ):
        held = linear.linearise("laboratory", overrides=overrides).sampled()
        gain = found["critical_gain"]

        def size(hz, held=held, gain=gain):
            return abs(held.response(hz)) * gain / 2 - 1

        assert found["crossover_hz"] == pytest.approx(optimize.brentq(size, 1, 20), rel=1e-9)
        assert (size(np.geomspace(0.01, 0.999 * found["crossover_hz"], 500)) > 0).all()
        zero = (held.C @ np.linalg.solve(np.eye(len(held.A)) - held.A, held.B)).item()
        assert found["loop_gain"] == pytest.approx(zero * gain, rel=1e-9)
        at = laboratory["reference_hz"]
        assert at == laboratory["present"]["crossover_hz"]
        assert found["loop_gain_at"] == pytest.approx(2 * (size(at) + 1), rel=1e-9)


def test_rows_are_ranked_and_cover_the_design(laboratory):
    crossovers = [r["crossover_hz"] for r in laboratory["rows"] if r["in_firmware"]]
    assert crossovers == sorted(crossovers, reverse=True)
    lacking = [r["change"] for r in laboratory["rows"][len(crossovers) :]]
    assert [name.split()[0] for name in sorted(lacking)] == [
        *("derivative", "neither", "sample", "sample")
    ]
    names = [r["change"] for r in laboratory["rows"]]
    for parameter in ("m_r1", "m_r2", "b_r", "k_rf", "b_rf", "m_w", "k_w", "b_w", "k_s", "b_s"):
        assert sum(f" {parameter} " in name for name in names) == 2, parameter
    assert {r["kind"] for r in laboratory["rows"]} == {
        *("stiffness", "mass", "damping", "grip", "sampling", "converter", "amplifier", "control")
    }
    assert {r["thesis"] for r in laboratory["rows"]} >= {"5.1", "5.1.2", "5.2", "5.1, 5.2", "6.2.1"}
    # Linear analysis does not see quantisation.
    assert row(laboratory, "ADC of 12")["critical_gain"] == pytest.approx(
        laboratory["present"]["critical_gain"], rel=1e-9
    )
    json.dumps(laboratory, allow_nan=False)


def test_what_the_thesis_says_of_each_change(workpiece):
    """5.1, 5.2, 6.1: for a rigid robot whose workpiece limits."""
    ratio = {r["change"]: r["ratio"] for r in workpiece["rows"]}

    def of(start):
        return next(v for k, v in ratio.items() if k.startswith(start))

    assert of("support damping b_w x 2")["critical_gain"] > 1.2
    assert of("support damping b_w / 2")["critical_gain"] < 0.9
    assert of("workpiece damping 8.25 -> 363")["crossover_hz"] > 2
    pad = of("grip pad of 25,000")
    # Much of what the pad buys in gain is the loop gain that it takes (5.1.3).
    assert pad["critical_gain"] > 50 and 10 < pad["loop_gain_at"] < 15
    assert of("grip pad of 120,000")["critical_gain"] < of("grip pad of 25,000")["critical_gain"]
    assert of("lead filter")["crossover_hz"] > 2 and of("derivative from")["crossover_hz"] > 2
    assert (
        of("one tick more of delay")["critical_gain"]
        < 0.8
        < 1.1
        < of("sample rate x 2")["critical_gain"]
    )


def test_what_a_bank_can_hold_is_the_law_that_it_stands_for(workpiece):
    hz = workpiece["present"]["frequency_hz"]
    for start, law in (
        ("lead filter", {"law": "lead", "lead_zero_hz": hz, "lead_pole_hz": 4 * hz}),
        ("derivative by", {"law": "pd", "derivative_s": 1 / (2 * np.pi * hz)}),
    ):
        wanted = loops.force_loop("fig4_19", **law).limit()
        assert row(workpiece, start)["critical_gain"] == pytest.approx(wanted.gain, rel=1e-6)


def test_a_converter_with_a_clock_of_its_own_leaves_the_rate_of_the_force_out(tmp_path):
    """The law with a sensor of the velocity needs a sample at each tick."""
    source = (paths.MODELS / "fig4_19.toml").read_text()
    at = source.index("channel = 0\n")
    model = tmp_path / "model.toml"
    model.write_text(source[:at] + "sample_rate = 1500\n" + source[at:])
    (tmp_path / "thesis.toml").write_text((paths.MODELS / "thesis.toml").read_text())
    found = advised(str(model), runs="none")
    names = [one["change"] for one in found["rows"]]
    assert any(name.startswith("derivative by differences") for name in names)
    assert not any(name.startswith("derivative from") for name in names)


def test_a_stiff_machine_keeps_the_digits_of_its_gains(workpiece):
    """Gains of a press of 20 kN are below 0.001 V/N."""
    present = replace(workpiece.advice.present, critical_gain=0.00048117)
    assert "0.0004812" in describe(replace(workpiece.advice, present=present))


@pytest.mark.long
def test_over_a_set_the_designed_bank_is_a_row_and_the_worst_member_counts():
    over = ("k_w=30%,m_w=30%",)
    result = advised("fig4_19", runs="none", over=over, modes="all")
    rows = [r for r in result["rows"] if r["in_firmware"]]
    fS = [(r["over"] or {"fS_Hz": 0.0})["fS_Hz"] for r in rows]
    assert fS == sorted(fS, reverse=True)
    present, found = result["present"]["over"], row(result, "designed bank")["over"]
    assert found["fS_Hz"] > 1.3 * present["fS_Hz"]
    # P at the margins, by python-control at every corner, with both slopes of the amplifier.
    gain, bandwidths, peaks = present["firmware_gain"] * (20 / 4096), [], []
    scale = linear.facts("fig4_19").required_reading.per_count
    for k_w, m_w in ((a, b) for a in (0.7, 1.3) for b in (0.7, 1.3)):
        known = linear.facts("fig4_19").parameters
        values = {"k_w": k_w * known["k_w"][0], "m_w": m_w * known["m_w"][0]}
        for modes in (None, {"drive.amplifier": "high outer"}):
            plant = linear.linearise("fig4_19", overrides=values, modes=modes)
            held = control.c2d(control.ss(plant.A, plant.B, plant.C, plant.D), 1 / 1500)
            w = 2 * np.pi * np.geomspace(0.05, 749, 40000)
            z = np.exp(1j * w / 1500)
            S = np.abs(1 / (1 + gain / scale * held(z)))
            bandwidths.append(w[np.argmax(np.sqrt(0.5) < S)] / (2 * np.pi))
            peaks.append(S.max())
    assert present["fS_Hz"] == pytest.approx(min(bandwidths), rel=1e-2)
    assert 1.5 < max(peaks) <= 2.02  # the search judges on a grid
    text = describe(result.advice)
    assert "designed bank" in text and "not in the firmware" in text and "fS over" in text
    assert max(map(len, describe(result.advice, 80).splitlines())) <= 80
    json.dumps(result, allow_nan=False)


def test_doubling_the_damping_of_fig_5_4_raises_what_limit_gives(workpiece):
    found = row(workpiece, "support damping b_w x 2")
    again = loops.force_loop("fig4_19", overrides={"b_w": 16.5}).limit()
    assert found["critical_gain"] == again.gain > loops.force_loop("fig4_19").limit().gain


@pytest.mark.parametrize(
    ("model", "element", "label", "how"),
    [
        ("fig4_15", "arm", "noncolocated", "its poles cross"),
        ("fig2_11", "arm", "noncolocated", "its lag turns the rigid body's poles"),
        ("fig4_19", "support", "colocated", "its poles cross"),
        ("fig5_5", "support", "colocated", "its poles cross"),
        ("fig4_25", "sensor", "colocated", "its poles cross"),
        ("full_axis", "arm_flex", "noncolocated", "its poles cross"),
    ],
)
def test_the_limiting_mode_is_named(model, element, label, how):
    mode = advised(model, runs="none")["limiting_mode"]
    assert (mode["element"], mode["label"], mode["how"]) == (element, label, how)
    assert mode["name"] == f"{element} ({mode['body']})"


def test_the_drive_alone_limits_a_rigid_axis():
    result = advised("fig4_11", runs="none")
    assert result["limiting_mode"]["name"] == "none"
    assert "lag of drive" in describe(result.advice)
    # 4.3.5: the base's colocated mode does not limit either.
    assert advised("fig4_17", runs="none")["limiting_mode"]["name"] == "none"


def test_without_a_limit_there_is_nothing_to_compare_with():
    result = advised("fig2_3", timing="continuous")
    assert result["present"]["critical_gain"] is None and result["limiting_mode"] is None
    assert "simulated" not in result["present"]  # the firmware samples
    hold = row(result, "hold of one tick")
    assert hold["critical_gain"] == pytest.approx(halved("fig2_3"), rel=1e-6)
    assert hold["ratio"]["critical_gain"] is None
    assert "no limit" in describe(result.advice)


@pytest.fixture(scope="module")
def simulated():
    return advised(paths.EXPERIMENTS / "contact.toml", runs="all", threads=2)


@pytest.mark.long
def test_the_simulated_limit_is_where_the_verdict_turns(simulated):
    found = simulated["present"]["simulated"]
    contact = str(paths.EXPERIMENTS / "contact.toml")
    for gain, verdict in ((found["stable_gain"], "stable"), (found["unstable_gain"], "unstable")):
        assert _core.run(contact, [f"firmware.force_gain={gain!r}"]).verdict == verdict
    assert found["unstable_gain"] < 1.02 * found["stable_gain"]
    # Contact and limit cycle side by side below the linear limit, as in the laboratory (3.3.2).
    assert found["of_limit"] == pytest.approx(
        found["stable_gain"] / simulated["present"]["firmware_gain"]
    )
    assert 0.3 < found["of_limit"] < 0.9
    assert simulated["present_gain"] == 5.0 and simulated["timing"] == "zoh"
    assert max(map(len, describe(simulated.advice, 80).splitlines())) <= 80


def test_a_pad_that_is_put_in_runs_as_the_model_with_a_pad(simulated, tmp_path):
    found = row(simulated, "grip pad of 25,000")["simulated"]
    text = (paths.EXPERIMENTS / "contact.toml").read_text()
    grip = str(paths.MODELS / "laboratory_grip.toml")
    (tmp_path / "e.toml").write_text(text.replace("../models/laboratory.toml", grip))
    for gain, verdict in ((found["stable_gain"], "stable"), (found["unstable_gain"], "unstable")):
        done = _core.run(str(tmp_path / "e.toml"), [f"firmware.force_gain={gain!r}"])
        assert done.verdict == verdict


def test_simulated_rows_run_the_changed_axis(simulated):
    stable = {r["change"]: (r["simulated"] or {}).get("stable_gain") for r in simulated["rows"]}
    present = simulated["present"]["simulated"]["stable_gain"]
    # The thesis found 10 % in contact and 40 % after a strike (Fig 5.10), with the arm in the way.
    assert 1.1 < stable["workpiece damping 8.25 -> 363 N s/m (zeta 0.11)"] / present < 1.5
    assert stable["grip pad of 25,000 N/m"] > 2 * present
    damped = str(paths.EXPERIMENTS / "contact.toml")
    gain = stable["workpiece damping 8.25 -> 363 N s/m (zeta 0.11)"]
    assert _core.run(damped, [f"firmware.force_gain={gain!r}", "b_w=363"]).verdict == "stable"
    assert stable["sample rate x 2 (3000 Hz)"] is None  # the firmware has one clock
    # A finer ADC does not move the limit much, but calms the force.
    finer = next(r for r in simulated["rows"] if r["kind"] == "converter")["simulated"]
    assert finer["ripple_count"] < simulated["present"]["simulated"]["ripple_count"]
    assert finer["stable_gain"] == pytest.approx(present, rel=0.1)
    later = stable["one tick more of delay"]
    sets = [f"firmware.force_gain={later!r}", "firmware.latency_ticks=1"]
    assert _core.run(damped, sets).verdict == "stable"


def test_a_model_without_an_experiment_gets_a_first_contact():
    """laboratory: the same plant and settings as contact.toml, so the same limit."""
    result = advised("laboratory", threads=2)
    assert result["experiment"] is None
    contact = advised(paths.EXPERIMENTS / "contact.toml", threads=2)
    assert result["present"] == contact["present"]


def test_an_experiments_own_values_and_delay_count(tmp_path):
    text = (paths.EXPERIMENTS / "contact.toml").read_text()
    text = text.replace("../models/laboratory.toml", str(paths.MODELS / "laboratory.toml"))
    text = text.replace("latency_ticks = 0", "latency_ticks = 1")
    text = text.replace("[firmware]", "[set]\nb_w = 363.0\n\n[firmware]")
    (tmp_path / "e.toml").write_text(text)
    result = advised(tmp_path / "e.toml", runs="none")
    assert result["timing"] == "zoh+1"
    wanted = halved("laboratory", {"b_w": 363.0}, delay=1)
    assert result["present"]["critical_gain"] == pytest.approx(wanted, rel=1e-6)
    over = advised(tmp_path / "e.toml", {"b_w": 8.25}, "zoh", runs="none")
    assert over["present"]["critical_gain"] == pytest.approx(halved("laboratory"), rel=1e-6)


def call(capsys, monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["forceaxis", "loop", "advise", *map(str, arguments)])
    status = 0
    try:
        cli.main()
    except SystemExit as leave:
        status = leave.code
    return status, *capsys.readouterr()


def test_the_verb(capsys, monkeypatch, tmp_path, laboratory):
    picture = tmp_path / "a.png"
    status, out, err = call(
        capsys, monkeypatch, "laboratory", "--linear", "--json", "--out", picture
    )
    assert status == 0 and json.loads(out) == json.loads(json.dumps(laboratory)), err
    assert picture.read_bytes()[:4] == b"\x89PNG"
    status, out, _ = call(capsys, monkeypatch, "laboratory", "--linear", "--set", "b_w=363")
    assert status == 0 and "limited by   arm (tip), noncolocated" in out
    assert "grip pad of 25,000" in out and "[5.1]" in out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("nowhere",), "nowhere"),
        (("fig4_27",), "adc"),
        (("fig4_19", "--factor", "1"), "--factor"),
        (("fig4_19", "--set", "b_q=1"), "b_q"),
        (("fig4_19", "--set", "b_w"), "--set"),
        (("fig4_19", "--out", "x.jpg"), "x.jpg"),
        (("fig4_19", "--linear", "--simulate"), "--simulate"),
        (("fig4_19", "--over", "k_q=30%"), "k_q"),
        (("fig4_19", "--over", "k_w=30%", "--timing", "continuous"), "--timing"),
        (("no/such.toml",), "no/such.toml"),
    ],
)
def test_a_mistake_is_one_line(capsys, monkeypatch, arguments, says):
    status, out, err = call(capsys, monkeypatch, *arguments)
    assert status == 2 and out == ""
    assert err.count("\n") == 1 and says in err, err


def test_bench_times_responses_limits_and_advice():
    rows = bench.linear_analysis(1, lambda: None)
    assert sum("frequencies of full_axis" in r.work for r in rows) == 1
    assert sum("critical gain of" in r.work for r in rows) == 2
    assert sum("advice table of" in r.work for r in rows) == 2
    for r in rows:
        assert r.seconds > 0 and (r.difference is None or r.difference < 1e-6)
    result = bench.BenchResult(results=[], missing={}, load=0.0, linear=rows)
    assert sum("advice" in c.check for c in bench.check(result)) == 2
    slow = replace(result, linear=[replace(r, seconds=5.0) for r in rows])
    timed = [c for c in bench.check(slow) if "advice" in c.check]
    assert len(timed) == 2 and not any(c.held for c in timed)
    assert "python-control" in bench_text(result)
