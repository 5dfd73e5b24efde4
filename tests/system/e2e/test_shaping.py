"""Command shaping on the laboratory axis: what a shaper leaves of the vibration that a step of the
force and a move excite, against the closed form."""

import re
from pathlib import Path
from typing import NamedTuple

import forceaxis
import numpy as np
import pytest
from forceaxis import loops
from scipy import optimize

ROOT = Path(__file__).resolve().parents[3]
EXPERIMENTS = ROOT / "sim/experiments"
TICKS_PER_S = 1500
FORCE_GAIN = 2.5


class Case(NamedTuple):
    experiment: str
    table: str
    signal: str  # that shows the arm's vibration
    from_s: float  # after the end of the unshaped command
    fit_s: float
    tolerance: float  # beside the closed form; converters excite the arm, too


FORCE = Case("force_step", "shaper_force", "sensor.force", 9.02, 0.25, 0.03)
# The end of the move passes the break of the amplifier, so its loop is not linear.
MOTION = Case("move", "shaper_motion", "arm.deflection", 0.925, 0.13, 0.06)


def impulses(mode_Hz, damping, kind):
    """(amplitude of 65536, delay in ticks) of the textbook's shaper, rounded as objects are."""
    root = np.sqrt(1 - damping**2)
    k = np.exp(-damping * np.pi / root)
    weights = np.array({"zv": [1, k], "zvd": [1, 2 * k, k * k]}[kind])
    amplitudes = np.round(65536 * weights / weights.sum())
    amplitudes[0] = 65536 - amplitudes[1:].sum()
    return amplitudes, np.round(np.arange(len(weights)) * TICKS_PER_S / (2 * mode_Hz * root))


def residual(shaper, pole):
    """Singer and Seering: the vibration after the last impulse beside that of a single impulse."""
    amplitudes, delays = shaper
    t = (delays - delays[-1]) / TICKS_PER_S
    parts = amplitudes / 65536 * np.exp(-pole.real * t)
    return np.hypot((parts * np.cos(pole.imag * t)).sum(), (parts * np.sin(pole.imag * t)).sum())


def fitted(t, y, poles):
    """Least squares of modes and a constant: the last one's amplitude at 0, and the errors."""
    columns = [np.ones_like(t)]
    for pole in poles:
        columns += [np.exp(pole.real * t) * wave(pole.imag * t) for wave in (np.cos, np.sin)]
    matrix = np.stack(columns, axis=1)
    found = np.linalg.lstsq(matrix, y, rcond=None)[0]
    return np.hypot(*found[-2:]), matrix @ found - y


def after_command(file, case, late_s=0.0):
    """Time and signal from the end of the command, uN or um."""
    result = forceaxis.run(str(file))
    assert (result.verdict, result.fault, result.refused) == ("stable", "none", [])
    t = np.asarray(result.tick) / TICKS_PER_S - case.from_s - late_s
    part = (t >= 0) & (t < case.fit_s)
    return t[part], 1e6 * np.asarray(result.columns()[case.signal])[part]


def poles_of(case):
    """Slow poles; the last one is the arm's. In contact they are those of the loop, the amplifier
    beyond its break; in free space what fits the unshaped move best."""
    if case is FORCE:
        loop = loops.force_loop("laboratory", modes={"drive.amplifier": "high outer"})
        poles = [
            p for p in loop.closed_poles(loop.gain_of(FORCE_GAIN)) if p.imag > 0 > p.real + 0.1
        ]
        return sorted((p for p in poles if p.real > -100), key=lambda p: -abs(abs(p.imag) - 200))
    t, y = after_command(EXPERIMENTS / f"{case.experiment}.toml", case)

    def error(guess):
        return fitted(t, y, [complex(-guess[0], guess[1])])[1]

    return [complex(*optimize.least_squares(error, (20, 200), x_scale=(5, 50)).x * (-1, 1))]


def reshaped(folder, case, mode_Hz, damping, kind):
    """The shaped experiment with another shaper."""
    text = (EXPERIMENTS / f"{case.experiment}_shaped.toml").read_text()
    text, count = re.subn(
        rf"(\[firmware.{case.table}\]\n)mode_Hz = .*\ndamping = .*\n",
        rf'\1mode_Hz = {mode_Hz}\ndamping = {damping}\nkind = "{kind}"\n',
        text.replace("../models", f"{ROOT}/sim/models"),
    )
    assert count == 1
    file = folder / "shaped.toml"
    file.write_text(text)
    return file


@pytest.mark.parametrize("case", [FORCE, MOTION], ids=["force", "motion"])
def test_a_shaper_takes_the_vibration_out_of_a_command(tmp_path, case):
    """At most 5 % at the mode that it is made for, 20 % with the mode 10 % off; and a wrong shaper
    leaves what the closed form says."""
    poles = poles_of(case)
    mode_Hz, damping = abs(poles[-1]) / (2 * np.pi), -poles[-1].real / abs(poles[-1])
    unshaped = fitted(*after_command(EXPERIMENTS / f"{case.experiment}.toml", case), poles)[0]

    def left(file, shaper):
        late_s = shaper[1][-1] / TICKS_PER_S
        return fitted(*after_command(file, case, late_s), poles)[0] / unshaped

    as_it_is = EXPERIMENTS / f"{case.experiment}_shaped.toml"
    assert left(as_it_is, impulses(mode_Hz, damping, "zvd")) <= 0.05
    for kind, off in (("zv", 1.0), ("zvd", 1.0), ("zvd", 0.9), ("zvd", 1.1), ("zv", 0.4)):
        shaper = impulses(mode_Hz * off, damping, kind)
        found = left(reshaped(tmp_path, case, mode_Hz * off, damping, kind), shaper)
        assert found == pytest.approx(residual(shaper, poles[-1]), abs=case.tolerance), (kind, off)
        if kind == "zvd":
            assert found <= (0.05 if off == 1.0 else 0.2), off


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("mode_Hz = 2.0", "firmware.shaper_force.mode_Hz: expected a number from 5.88235"),
        (
            'mode_Hz = 20\nkind = "ei"',
            'firmware.shaper_force.kind: expected one of zv, zvd, got "ei"',
        ),
        ("mode_Hz = 20\ndamping = 1", "firmware.shaper_force.damping: expected a number from 0 to"),
        ("damping = 0.1", "firmware.shaper_force.mode_Hz: expected"),
        ("mode = 20", "firmware.shaper_force"),
    ],
)
def test_a_shaper_that_cannot_be_is_refused(tmp_path, written, message):
    file = tmp_path / "wrong.toml"
    text = (EXPERIMENTS / "force_step.toml").read_text()
    table = f"[firmware.shaper_force]\n{written}\n\n[[at]]"
    file.write_text(text.replace("../models", f"{ROOT}/sim/models").replace("[[at]]", table, 1))
    with pytest.raises(forceaxis.InputError, match=re.escape(message)):
        forceaxis.run(str(file))
