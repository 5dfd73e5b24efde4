"""Measures stiffness and mass of a workpiece that has dry friction on its table. The workpiece is
excited with sinusoidal forces.

The displacement of the workpiece is the displacement of the encoder minus the deflection of the
force sensor. The ratio of force to displacement of the workpiece is therefore known at each
frequency. While the workpiece slides, Coulomb friction is in phase with the speed, so it changes
only the imaginary part of this ratio. The real part is k - m w^2 for any friction, with the
stiffness k, the mass m and the angular frequency w.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from forceaxis.axis.link import TICKS_PER_S
from forceaxis.commission.analyzer import Analyzer, Ended
from forceaxis.commission.level import Samples

RECORD_SAMPLES = 750
SETTLE_S = 0.3
SIGNALS = ("force_raw", "position")
# Number of frequencies, and smallest number of frequencies at which the workpiece must slide.
FREQUENCIES, FREQUENCIES_MIN = 11, 3
# SLIDES: sufficient displacement of the workpiece.
# SLIDES_MIN: smallest displacement that is accepted.
# The unit of both displacements is the one at which the spring overcomes the friction.
SLIDES, SLIDES_MIN = 3.0, 1.25
# Largest number of amplitudes at one frequency, and ratio of two successive amplitudes.
AMPLITUDES_MAX, AMPLITUDE_FACTOR = 7, 1.6


@dataclass(frozen=True)
class SineTestResult:
    """Result of the test with sinusoidal forces. It has stiffness in N/m, mass in kg, damping in N
    s/m and friction in N of the workpiece, and the relative standard errors of stiffness and mass.
    It also has the frequencies of the sines in Hz, and their amplitudes in DAC codes and N."""

    stiffness: float
    mass: float
    damping: float
    friction_N: float
    stiffness_error: float
    mass_error: float
    hz: tuple[float, ...]
    codes: tuple[float, ...]
    newton: tuple[float, ...]
    #: one row for each sine: frequency in Hz, force in N, displacement in m, amplitude in codes.
    #: Force and displacement of the axis are complex and have two columns each.
    rows: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class SineTestSetup:
    """Values that are known before the test with sinusoidal forces: friction in N between workpiece
    and table, stiffness of force sensor and workpiece in N/m, and the frequencies in Hz.

    `rate`: speed in encoder counts/s per DAC code. `scale`: encoder counts per m. `newton`: force
    in N per force count.
    """

    friction_N: float
    sensor: float
    workpiece: float
    hz: tuple[float, ...]
    rate: float
    scale: float
    newton: float


def measure(
    analyzer: Analyzer, force_N: float, setup: SineTestSetup, codes_max: Callable[[float], int]
) -> SineTestResult | None:
    """Presses with `force_N`, excites the axis with sines, and computes stiffness and mass of the
    workpiece.

    Returns None if the workpiece slides at too few frequencies. codes_max(hz) returns the largest
    amplitude in DAC codes at which the drive stays linear.
    """
    analyzer.bound(analyzer.press(force_N), "sine", period=0)
    found = [_largest_sine(analyzer, hz, setup, codes_max(hz)) for hz in setup.hz]
    analyzer.release()
    rows = [sine.row for sine in found if sine is not None]
    return of_sines(rows, setup.sensor) if len(rows) >= FREQUENCIES_MIN else None


@dataclass(frozen=True)
class _Sine:
    """Response of an axis to a sine with the amplitude `codes` in DAC codes. It has complex
    amplitudes of the force in N, and of the displacements of axis and workpiece in m."""

    hz: float
    codes: int
    force: complex
    axis: complex
    workpiece: complex

    @property
    def row(self) -> tuple[float, ...]:
        """Returns one row of SineTestResult.rows."""
        return (
            self.hz, self.force.real, self.force.imag, self.axis.real, self.axis.imag, self.codes
        )  # fmt: skip


def _largest_sine(
    analyzer: Analyzer, hz: float, setup: SineTestSetup, codes_max: int
) -> _Sine | None:
    """Increases the amplitude until the workpiece slides far enough. Returns the sine with the
    largest displacement of the workpiece within the bounds, or None if the workpiece does not slide
    enough."""
    # displacement in m at which the spring of the workpiece overcomes the friction
    friction_m = setup.friction_N / setup.workpiece
    target = SLIDES * friction_m
    codes = max(2, round(2 * math.pi * hz * target * setup.scale / setup.rate))
    best: _Sine | None = None
    for _ in range(AMPLITUDES_MAX):
        codes = min(codes, codes_max)
        try:
            sine = _sine(analyzer, hz, codes, setup)
        except Ended:
            analyzer.standing()
            codes = round(codes / (1.25 if best else 2))
            if best or codes < 2:
                break
            continue
        if best is None or abs(sine.workpiece) > abs(best.workpiece):
            best = sine
        if abs(sine.workpiece) >= target or codes >= codes_max:
            break
        codes = math.ceil(AMPLITUDE_FACTOR * codes)
    if best is None or abs(best.workpiece) <= SLIDES_MIN / SLIDES * target:
        return None
    analyzer.say(
        f"{hz:g} Hz, {best.codes} codes: {abs(best.force):.3g} N move the workpiece by "
        f"{1e6 * abs(best.workpiece):.3g} um"
    )
    return best


def _sine(analyzer: Analyzer, hz: float, codes: int, setup: SineTestSetup) -> _Sine:
    """Excites the axis with a sine of the amplitude `codes`, in DAC codes. Raises Ended if the axis
    ends the excitation early."""
    analyzer.set(excitation_code=codes, excitation_frequency=hz)
    held = analyzer.excited(SIGNALS, RECORD_SAMPLES, SETTLE_S)
    wave = np.exp(-2j * np.pi * hz * np.arange(RECORD_SAMPLES) / TICKS_PER_S) * 2 / RECORD_SAMPLES
    newton_per_code = analyzer.count_per_code * analyzer.objects.force_sign * setup.newton
    signals = (
        held.values("force_raw") * newton_per_code,
        held.values("position") / setup.scale,
    )
    force, axis = (complex(wave @ (signal - np.mean(signal))) for signal in signals)
    return _Sine(hz, codes, force, axis, axis - force / setup.sensor)


def of_sines(
    rows: Sequence[Sequence[float]], sensor: float, damping: float = 0.0
) -> SineTestResult:
    """Computes stiffness, mass and friction of a workpiece from SineTestResult.rows. `sensor` and
    `damping`: stiffness in N/m and damping in N s/m of the force sensor, which is between axis and
    workpiece."""
    hz, f_re, f_im, x_re, x_im, codes = np.array(rows, float).T
    force, w = f_re + 1j * f_im, 2 * np.pi * hz
    way = x_re + 1j * x_im - force / (sensor + 1j * w * damping)
    quotient = force / way
    # Residuals are divided by the ratio of force to displacement.
    # An error of 1 % of force or displacement changes this ratio by 1 %.
    weight = 1 / abs(quotient)
    table = np.column_stack([np.ones(len(w)), -(w**2)])
    solved, covariance = _solved(table, quotient.real, weight)
    stiffness, mass = solved
    lost = np.column_stack([w, 4 / np.pi / abs(way)])
    (lossy, friction), _ = _solved(lost, quotient.imag, weight)
    if lossy < 0:
        lossy = 0.0
        friction = float(np.median(quotient.imag * abs(way) * np.pi / 4))
    errors = np.sqrt(np.diag(covariance)) / np.maximum(abs(solved), 1e-12)
    return SineTestResult(
        float(stiffness), float(mass), float(lossy), float(friction), float(errors[0]),
        float(errors[1]), tuple(hz.tolist()), tuple(codes.tolist()), tuple(abs(force).tolist()),
        tuple(map(tuple, np.array(rows, float).tolist())),
    )  # fmt: skip


def _solved(table: Samples, values: Samples, weight: Samples) -> tuple[Samples, Samples]:
    """Solves a problem of weighted least squares. Returns the solution and its covariance matrix,
    whose size is computed from the residuals."""
    A, b = table * weight[:, None], values * weight
    solved = np.linalg.lstsq(A, b, rcond=None)[0]
    left = float(np.sum((A @ solved - b) ** 2)) / max(1, len(b) - A.shape[1])
    return np.asarray(solved), np.linalg.inv(A.T @ A) * max(left, 0.01**2)
