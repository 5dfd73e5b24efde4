"""Stiffness and mass of a workpiece with dry friction, measured with sines of the force.

The displacement of the workpiece is that of the encoder minus the deflection of the sensor, so the
ratio of force to displacement is known at each frequency. While the workpiece slides, Coulomb
friction is in phase with the speed. It then changes only the imaginary part of the ratio; the real
part is k - m w^2 for any friction.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forceaxis.axis.drive import ExcitationObjects
from forceaxis.axis.link import TICKS_PER_S

Samples = NDArray[np.float64]

SAMPLES = 750
SETTLE_S = 0.3
SIGNALS = ("force_raw", "position", "dac_code")
FREQUENCIES = 11
# multiple of the displacement at which the spring overcomes the friction; enough for a result
SLIDES = 3.0
LEAST = 1.25  # smallest accepted multiple of that displacement
# largest number of increases of the amplitude of a sine, and the factor of each increase
TRIES, MORE = 7, 1.6
FEWEST = 3  # frequencies at least


@dataclass(frozen=True)
class SineTestResult:
    """Stiffness in N/m, mass in kg, damping in N s/m and friction in N of a workpiece; relative
    standard errors of stiffness and mass; frequencies in Hz and amplitudes in codes and N of the
    sines."""

    stiffness: float
    mass: float
    damping: float
    friction_N: float
    stiffness_error: float
    mass_error: float
    hz: tuple[float, ...]
    codes: tuple[float, ...]
    newton: tuple[float, ...]
    #: for each sine (Hz, force re and im in N, displacement of the axis re and im in m, codes)
    rows: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class SineTestSetup:
    """Knowledge before the sines are measured: friction in N, stiffnesses of sensor and workpiece
    in N/m, frequencies in Hz; rate: encoder counts/s per code; scale: encoder counts per m; newton:
    N per force count."""

    friction_N: float
    sensor: float
    workpiece: float
    hz: tuple[float, ...]
    rate: float
    scale: float
    newton: float


def measure(
    analyzer: Any, force_N: float, known: SineTestSetup, most: Callable[[float], int],
    ended: type[Exception],
) -> SineTestResult | None:  # fmt: skip
    """Presses an Analyzer's axis with `force_N` and excites it with sines; None if too few sines
    make the workpiece slide.

    most(hz): largest code that the drive tolerates; ended: exception of the analyzer if the axis
    ends an excitation.
    """
    sensor = known.sensor
    analyzer.bound(analyzer.press(force_N), "sine", period=0)
    rows = []
    for f in known.hz:
        target = SLIDES * known.friction_N / known.workpiece
        amplitude = max(2, round(2 * math.pi * f * target * known.scale / known.rate))
        best = None
        for _ in range(TRIES):
            amplitude = min(amplitude, most(f))
            try:
                one = _sine(analyzer, f, amplitude, known)
            except ended:
                analyzer.standing()
                amplitude = round(amplitude / (1.25 if best else 2))
                if best or amplitude < 2:
                    break
                continue
            if best is None or abs(_way(one[0], one[1], sensor)) > abs(
                _way(best[0], best[1], sensor)
            ):
                best = (*one, amplitude)
            if abs(_way(one[0], one[1], sensor)) >= target or amplitude >= most(f):
                break
            amplitude = math.ceil(MORE * amplitude)
        way = abs(_way(best[0], best[1], sensor)) if best else 0.0
        if best and way > LEAST / SLIDES * target:
            force, place, codes = best
            rows.append((f, force.real, force.imag, place.real, place.imag, codes))
            analyzer.say(
                f"{f:g} Hz, {codes} codes: {abs(force):.3g} N move the workpiece by "
                f"{1e6 * way:.3g} um"
            )
    analyzer.set(target_force=0)
    analyzer.wait(1.0, lambda: None)
    if len(rows) < FEWEST:
        return None
    return of_sines(rows, sensor)


def _way(force: Any, place: Any, sensor: Any) -> Any:
    """Displacement of the workpiece in m from the displacement of the axis and the force on the
    sensor between them; sensor: N/m."""
    return place - force / sensor


def _sine(
    analyzer: Any, hz: float, amplitude: int, known: SineTestSetup
) -> tuple[complex, complex]:
    """(force in N, displacement of the axis in m), both complex, of one sine."""
    axis = analyzer.axis
    analyzer.set(excitation_code=amplitude, excitation_frequency=hz)
    axis.set(excitation_run="start")
    analyzer.wait(SETTLE_S, analyzer.goes_on)
    axis.arm(SIGNALS, SAMPLES)
    held = axis.link.recording(5.0)
    analyzer.goes_on()
    axis.set(excitation_run="stop")
    axis.wait_for(ExcitationObjects, lambda s: s.excitation_state == "done", "the ramp's end")
    wave = np.exp(-2j * np.pi * hz * np.arange(SAMPLES) / TICKS_PER_S) * 2 / SAMPLES
    raw = held.values("force_raw") * 2.0 ** (8 - analyzer.bits) * analyzer.sign * known.newton
    force, place = (wave @ (x - np.mean(x)) for x in (raw, held.values("position") / known.scale))
    return complex(force), complex(place)


def of_sines(
    rows: Sequence[Sequence[float]], sensor: float, damping: float = 0.0
) -> SineTestResult:
    """The SineTestResult of `rows`. sensor, damping: stiffness in N/m and damping in N s/m
    of the sensor between axis and workpiece."""
    hz, f_re, f_im, x_re, x_im, codes = np.array(rows, float).T
    force, w = f_re + 1j * f_im, 2 * np.pi * hz
    way = _way(force, x_re + 1j * x_im, sensor + 1j * w * damping)
    quotient = force / way
    # Residuals are relative to the ratio of force to displacement, because an error of force or
    # displacement is a relative error of the ratio.
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


def _solved(table: Samples, values: Samples, weight: Samples) -> Any:
    """(solution, covariance) of weighted least squares; the size of the errors follows from the
    residuals."""
    A, b = table * weight[:, None], values * weight
    solved = np.linalg.lstsq(A, b, rcond=None)[0]
    left = float(np.sum((A @ solved - b) ** 2)) / max(1, len(b) - A.shape[1])
    return solved, np.linalg.inv(A.T @ A) * max(left, 0.01**2)
