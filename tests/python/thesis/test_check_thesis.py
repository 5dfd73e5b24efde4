"""`forceaxis check-thesis`: the claims are computed, and what differs has a reason."""

import json
import math

import pytest
from click.testing import CliRunner
from forceaxis import linear
from forceaxis.cli import main as cli
from forceaxis.thesis import claims as thesis


@pytest.fixture(scope="module")
def result():
    run = CliRunner().invoke(cli.cli, ["check-thesis", "--json"])
    assert run.exit_code == 0, run.output
    return json.loads(run.stdout)


def test_every_difference_has_a_reason(result):
    assert result["unexplained"] == 0
    assert result["agree"] + result["differ"] == len(result["claims"]) == len(thesis.CLAIMS)
    for claim in result["claims"]:
        assert bool(claim["why"]) == (not claim["agrees"]), claim


def test_numbers_by_hand(result):
    """Some of ours again, from the print of Figs 4.4 and 4.26 alone."""
    ours = {claim["what"]: claim["ours"] for claim in result["claims"]}
    hz = 1 / (2 * math.pi)
    assert ours["workpiece by itself"] == pytest.approx(hz * math.sqrt(412700 / 6.6), rel=1e-4)
    arm = hz * math.sqrt(665000 * 132.4 / (114.5 * 17.9))
    found = next(v for k, v in ours.items() if k.startswith("arm mode"))
    assert found == pytest.approx(arm, rel=0.01)  # b_r couples it to the ground
    assert ours["current loop, shaft locked, k_amp = 15"] == pytest.approx(
        hz * (4.5 + 15 * 0.333) / 0.0158
    )
    dc = 3.9 * 0.039 * 15 * 0.5 / ((4.5 + 15 * 0.333) * 0.02 + 0.5 * 0.5 + 15 * 0.5 * 4.2 * 0.039)
    assert ours["motor without load at DC, k_amp = 15"] == pytest.approx(dc, rel=1e-3)
    damped = 363 / (2 * math.sqrt(412700 * 6.6))
    assert ours["damping ratio of the damped workpiece, b_w = 363"] == pytest.approx(damped)


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
