"""The polynomial resonance model: what was put in comes out."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from forceaxis import linear
from forceaxis._core import InputError
from forceaxis.cli import main as cli
from forceaxis.identify import resonance
from forceaxis.linear import modes

# Peak Hz, damping; trough Hz, damping: five modes as 4.2 describes them, troughs some 10 % above.
KNOWN = [
    (12.0, 0.05, 13.2, 0.05),
    (31.0, 0.04, 34.5, 0.06),
    (61.0, 0.03, 66.0, 0.03),
    (110.0, 0.05, 122.0, 0.04),
    (210.0, 0.02, 232.0, 0.03),
]
HZ = np.geomspace(2, 500, 1500)
S = 2j * np.pi * HZ
RIGID = 3.0 * S / ((S + 90) * (S + 400))  # tip acceleration over command of a rigid robot


def cascade(known, s=S):
    """Product of R_i as 4.2 prints it."""
    value = 1.0
    for hz_p, zeta_p, hz_z, zeta_z in known:
        p, z = 2 * np.pi * hz_p, 2 * np.pi * hz_z
        value = value * p**2 / z**2 * (s * s + 2 * zeta_z * z * s + z * z)
        value = value / (s * s + 2 * zeta_p * p * s + p * p)
    return value


def values(resonances):
    return [(r.peak_hz, r.peak_damping, r.trough_hz, r.trough_damping) for r in resonances]


def test_recovers_a_known_cascade():
    data = RIGID * cascade(KNOWN)
    for given, rigid in ((data, RIGID), (abs(data), abs(RIGID))):
        found = resonance.fit(HZ, given, rigid, refine=True)
        assert np.array(values(found.resonances)) == pytest.approx(np.array(KNOWN), rel=1e-5)
        assert found.rms_db < 1e-5
        assert (found.phase_error_deg is None) == (given is not data)
    assert resonance.fit(HZ, data, RIGID, refine=True).phase_error_deg < 1e-3


def test_five_steps_alone_come_close():
    found = resonance.fit(HZ, RIGID * cascade(KNOWN), RIGID)
    ours = np.array(values(found.resonances))
    assert ours[:, [0, 2]] == pytest.approx(np.array(KNOWN)[:, [0, 2]], rel=2e-3)
    assert ours[:, [1, 3]] == pytest.approx(np.array(KNOWN)[:, [1, 3]], rel=0.02)
    assert 1e-3 < found.rms_db < 0.05


def test_cascade_as_zeros_and_poles():
    found = resonance.fit(HZ, RIGID * cascade(KNOWN), RIGID, refine=True)
    zeros, poles, gain = found.cascade().zpk()
    assert len(zeros) == len(poles) == 10
    assert np.sort(abs(poles)) == pytest.approx(
        np.repeat([2 * np.pi * k[0] for k in KNOWN], 2), rel=1e-5
    )
    assert gain == pytest.approx(np.prod([(k[0] / k[2]) ** 2 for k in KNOWN]), rel=1e-5)
    assert found.response(HZ, RIGID) == pytest.approx(RIGID * cascade(KNOWN), rel=1e-5)
    G = found.cascade().transfer_function()
    assert G(30j) == pytest.approx(complex(cascade(KNOWN, 30j)), rel=1e-5)


def test_noise_of_a_measurement():
    rng = np.random.default_rng(4)
    noise = 1 + 0.01 * (rng.standard_normal(len(HZ)) + 1j * rng.standard_normal(len(HZ)))
    found = resonance.fit(HZ, RIGID * cascade(KNOWN) * noise, RIGID, refine=True)
    ours = np.array(values(found.resonances))
    assert ours[:, [0, 2]] == pytest.approx(np.array(KNOWN)[:, [0, 2]], rel=3e-3)
    assert ours[:, [1, 3]] == pytest.approx(np.array(KNOWN)[:, [1, 3]], rel=0.1)
    assert found.rms_db == pytest.approx(20 * np.log10(np.e) * 0.01, rel=0.1)


def test_fewer_modes_than_there_are():
    found = resonance.fit(HZ, RIGID * cascade(KNOWN), RIGID, modes=2)
    assert len(found.resonances) == 2
    assert found.rms_db > 0.1


def test_tip_acceleration_of_a_flexible_arm():
    """Fig 2.11 apart, perfect actuator: one mode, noncolocated, so a peak without a trough."""
    f = np.geomspace(2, 100, 400)
    data = linear.linearise("fig2_11", outputs=["tip.acceleration"], free=True).response(f)
    rigid = linear.linearise("fig2_3", outputs=["robot.acceleration"], free=True).response(f)
    (arm,) = resonance.fit(f, data, rigid).resonances
    assert arm.trough_hz is None
    assert arm.peak_hz == pytest.approx(32.99, abs=0.1)
    assert arm.peak_damping == pytest.approx(0.101, abs=0.005)


def test_tip_acceleration_of_the_whole_robot():
    """Fig 3.11's measurement on Fig 4.14: the rigid body is that of Fig 4.11, behind the motor.

    The base mode has its trough, the workpiece's on the base hides at 40 Hz; the arm's has none.
    """
    f = np.geomspace(2, 100, 400)
    data = linear.linearise("fig4_14", outputs=["tip.acceleration"], free=True).response(f)
    rigid = linear.linearise("fig4_11", outputs=["robot.acceleration"], free=True).response(f)
    found = resonance.fit(f, data, rigid, prominence_db=0.3)
    base, arm, workpiece = found.resonances
    driven = [m.driven for m in modes.modes("fig4_14", free=True).modes]
    assert base.peak_hz == pytest.approx(driven[1].frequency_hz, rel=0.05)
    assert base.peak_damping == pytest.approx(driven[1].damping_ratio, rel=0.1)
    assert base.trough_hz == pytest.approx(13.4, rel=0.04)  # base and workpiece alone
    assert arm.peak_hz == pytest.approx(driven[2].frequency_hz, rel=0.02)
    # The drive's real poles move with the arm, which the quotient puts down to the peak.
    assert arm.peak_damping == pytest.approx(driven[2].damping_ratio, rel=0.25)
    assert arm.trough_hz is None
    assert workpiece.peak_hz == pytest.approx(driven[3].frequency_hz, rel=0.04)
    assert found.rms_db < 1.5
    # The two strongest alone are the same two: a mode that is left out takes its trough along.
    two = resonance.fit(f, data, rigid, modes=2, prominence_db=0.3).resonances
    assert [r.trough_hz is None for r in two] == [False, True]


def test_refusals():
    data = RIGID * cascade(KNOWN)
    with pytest.raises(InputError, match="peak"):
        resonance.fit(HZ, RIGID, RIGID)
    with pytest.raises(InputError, match="expected arrays of equal length"):
        resonance.fit(HZ, data[:-1], RIGID)
    with pytest.raises(InputError, match="at least 10"):
        resonance.fit(HZ[:5], data[:5], RIGID[:5])
    with pytest.raises(InputError, match="larger than the frequency before"):
        resonance.fit(HZ[::-1], data, RIGID)
    with pytest.raises(InputError, match="not 0"):
        resonance.fit(HZ, 0 * data, RIGID)


def test_the_verb_on_a_measured_response(tmp_path):
    """Fig 3.11 as the analyzer measures it: the base at 12.4 Hz, the arm at 33 Hz."""
    runner = CliRunner()
    measured = runner.invoke(cli.cli, ["measure", "fig3_11", "--out", str(tmp_path)])
    assert measured.exit_code == 0, measured.output
    command = f"identify resonances fig4_11 {tmp_path} --rigid robot.acceleration --modes 2 --json"
    done = runner.invoke(cli.cli, command.split())
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    base, arm = result["resonances"]
    assert base["peak_hz"] == pytest.approx(12.4, rel=0.05) and base["trough_hz"] > base["peak_hz"]
    assert arm["peak_hz"] == pytest.approx(33.0, rel=0.02)
    assert result["rms_db"] < 2.0
