"""`forceaxis loop compliance` and `forceaxis design --pareto`: maps against exact figures."""

import itertools
import json

import numpy as np
import pytest
import verbs
from forceaxis import linear
from forceaxis.linear import over, plant_set
from forceaxis.linear.bank import GAIN_STEP, Bank
from forceaxis.linear.loops import LoopSpec

OVER = "k_w=30%,m_w=30%"


@pytest.fixture(scope="module")
def soft(tmp_path_factory):
    out = tmp_path_factory.mktemp("c") / "map.png"
    done = verbs.forceaxis(
        *(
            "loop",
            "compliance",
            "fig5_2",
            "--from",
            2e4,
            "--to",
            4e5,
            "--points",
            2,
            "--json",
            "--out",
            out,
        )
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), out


def test_a_stiffer_contact_needs_less_motion_and_leaves_p_more_error(soft):
    result, out = soft
    low, high = result["rows"]
    assert result["element"] == "k_g" and result["over"] == ["k_w=30%", "m_w=30%"]
    # In series with the workpiece, at rest: x = f (1/k_s + 1/k_g + 1/k_w).
    known = {n: v for n, (v, _) in linear.facts("fig5_2").parameters.items()}
    for row in (low, high):
        way = sum(1 / k for k in (known["k_s"], row["stiffness"], known["k_w"]))
        assert row["motion_m"] == pytest.approx(result["setpoint_N"] * way, rel=1e-3)
    assert low["p_static_error"] < high["p_static_error"]
    assert low["strike_N_s"] >= high["strike_N_s"] > 0
    assert out.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.long
def test_its_figures_are_those_of_the_worst_member(soft):
    row = soft[0]["rows"][1]
    overrides = {"k_g": row["stiffness"]}
    plants = plant_set.PlantSet(
        "fig5_2", overrides, plant_set.ranges_of("fig5_2", (OVER,), overrides),
        ({}, {"drive.amplifier": "high outer"}),
    )  # fmt: skip
    for prefix in ("p_", ""):
        keys = row[prefix + "bank"]
        bank = Bank(
            keys["gain"], keys.get("integral_rad_per_s", 0.0), 0.0,
            tuple(map(tuple, keys.get("sections", ()))),
        )  # fmt: skip
        exact = [over.worst(plants, (t,), LoopSpec("bank", bank=bank)) for t in ("zoh", "zoh+1")]
        assert row[prefix + "fS_Hz"] == pytest.approx(min(w.fS_Hz for w in exact), rel=0.02)
        assert exact[0].Ms < 1.04 * 2.0 and exact[1].Ms < 1.04 * 2.2  # of corners, on a grid
    # The static error of P is that of its loop at rest, at its worst member.
    gain = row["p_bank"]["gain"]
    worst = 0.0
    for member in plants.corners():
        loop = plants.loop(member)
        worst = max(worst, abs(1 / (1 + loop.gain_of(gain) * loop.open.at(1.0))))
    assert row["p_static_error"] == pytest.approx(worst, rel=0.01)
    assert GAIN_STEP * round(gain / GAIN_STEP) == gain


@pytest.mark.long
def test_the_front_rises_with_what_is_allowed(tmp_path):
    done = verbs.forceaxis(
        *("design", "fig4_19", "--over", OVER, "--latency", 0, "--pareto", "bandwidth,hf"),
        *("--out", tmp_path / "front", "--json"),
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    rows = result["rows"]
    bandwidths = [row["bandwidth_Hz"] for row in rows]
    assert all(b > 0.97 * a for a, b in itertools.pairwise(bandwidths))
    assert bandwidths[-1] > 2 * bandwidths[0]
    assert all(row["bank"]["hf_gain"] <= row["hf"] for row in rows)
    assert np.isfinite(bandwidths).all()
    assert json.loads((tmp_path / "front/tradeoff.json").read_text()) == result
    assert (tmp_path / "front/tradeoff.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("loop", "compliance", "fig4_19", "--element", "m_w"), "--element"),
        (("loop", "compliance", "fig4_19", "--from", "1e5"), "--to"),
        (("loop", "compliance", "fig4_19", "--from", "1e5", "--to", "1e4"), "--from"),
        (("loop", "compliance", "fig4_27"), "adc"),
        (("loop", "compliance", "nowhere"), "nowhere"),
        (("loop", "compliance", "fig4_19", "--out", "x.jpg"), "x.jpg"),
        (("design", "fig4_19", "--over", OVER, "--pareto", "bandwidth,mass"), "--pareto"),
        (("design", "fig4_19", "--over", OVER, "--pareto", "ms"), "--pareto"),
    ],
)
def test_a_mistake_is_one_line(arguments, says):
    done = verbs.forceaxis(*arguments)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.count("\n") == 1 and says in done.stderr, done.stderr
