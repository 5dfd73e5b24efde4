"""The coupling rule of 2.3.2 against every assembled model."""

import coupling
import numpy as np
import pytest
from forceaxis import linear, paths

S = np.concatenate([2j * np.pi * np.geomspace(0.5, 700, 40), [3.0, -20 + 90j, 100 + 1000j]])
# The equations are those of the thesis, which has no drive with a velocity loop of its own.
MODELS = sorted(
    p.stem
    for p in paths.MODELS.glob("*.toml")
    if p.stem != "thesis" and 'type = "velocity"' not in p.read_text()
)


def output_of(name):
    """What the force loop reads; the tachometer's model shows its motor's velocity instead."""
    signal = linear.facts(name).reading
    if signal is None or signal.signal.startswith("drive."):
        return f"{linear.facts(name).required_drive.body}.velocity"
    return "reading"


def solved(system):
    """C (s I - A)^-1 B + D by elimination in balanced units, which keeps small values accurate."""
    A, B, C = system.balanced
    return np.array([(C @ np.linalg.solve(s * np.eye(len(A)) - A, B) + system.D).item() for s in S])


@pytest.mark.parametrize("name", MODELS)
def test_coupled_is_assembled(name):
    output = output_of(name)
    system = linear.linearise(name, outputs=[output])
    if not system.C.any() or not system.has_path():  # play, or friction that holds the drive
        assert not coupling.coupled(name, S, output).any()
        return
    assembled = solved(system)
    assert coupling.coupled(name, S, output) == pytest.approx(assembled, rel=1e-9, abs=1e-300)


def test_parameters_states_and_contact_are_followed():
    options = {"overrides": {"b_m": 0.02, "m_r": 140.0}}
    expected = solved(linear.linearise("fig4_19", **options))
    assert coupling.coupled("fig4_19", S, **options) == pytest.approx(expected, rel=1e-9)
    assert coupling.coupled("fig4_19", S) != pytest.approx(expected, rel=1e-3)
    apart = solved(linear.linearise("fig4_17", outputs=["robot.acceleration"], free=True))
    ours = coupling.coupled("fig4_17", S, "robot.acceleration", free=True)
    assert ours == pytest.approx(apart, rel=1e-9)


def test_motor_at_low_frequency():
    """DC values with the numbers of Figure 4.4, by hand: stall force and damping of the axis."""
    g_af, g_av = coupling.actuator("fig4_11")
    loop = 4.5 + 15 * 0.333
    assert g_af(0) == pytest.approx(0.5 * 15 * 3.9 / 0.004043 / loop)
    assert g_av(0) == pytest.approx(-0.5 * (15 * 4.2 * 0.039 + 0.5) / 0.004043**2 / loop)
    damped = coupling.actuator("fig4_11", {"b_m": 0.02})[1]
    assert g_av(0) - damped(0) == pytest.approx(0.02 / 0.004043**2)
