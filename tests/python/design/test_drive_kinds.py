"""Kinds of drive and sensor, each from `forceaxis new` to a tuned axis by commands alone. A run
tries three of the eight kinds, drawn by its commit, and with FORCEAXIS_WHOLE=1 all of them."""

import draws
import drive_kinds
import pytest

pytestmark = [pytest.mark.beside, pytest.mark.long]


@pytest.mark.parametrize("name", draws.some("kinds", list(drive_kinds.KINDS), 3))
def test_an_axis_of_each_kind_is_designed_tuned_and_holds_its_force(name):
    found, last = drive_kinds.study(name)
    print(drive_kinds.row(name, found, last))
    assert found["design"]["worst"]["fS_Hz"] > found["design"]["p"]["fS_Hz"]
    assert found["tune"]["worst"]["fS_Hz"] > found["tune"]["p"]["fS_Hz"]
    assert found["held"]["verdict"] == "stable"
    held = found["held"]["metrics"]["held_force"]
    assert held["held_N"] == pytest.approx(held["setpoint_N"], rel=0.02)
    # tune refuses a law whose measured Ms does not agree with the prediction.
    assert found["tune"]["Ms_verified"] <= found["tune"]["Ms_predicted"] + 0.3
    # A contact that can be lost may be unstable below the linear limit. A run has one phase of the
    # samples, the limit is that of the worst phase.
    limit, gain = found["limit"]["firmware_gain"], found["new"]["force_gain"]
    assert last is None or gain <= last <= 1.1 * limit
