"""Measured frequency responses, and the responses of a model between the same signals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from forceaxis import linear
from forceaxis.errors import ParameterError
from forceaxis.identify.fit import read_response
from forceaxis.identify.measurement import MeasuredCurve, Measurement, sampled
from forceaxis.linear import curves
from forceaxis.linear.curves import BodeCurve, PlantBode


@dataclass(frozen=True, kw_only=True)
class MeasuredBode(PlantBode):
    """Frequency responses of a model, and measured responses between the same signals. `of`: the
    text "measured"."""

    measured: list[MeasuredCurve]


def overlay(
    model: Path | str,
    folders: Sequence[Path | str],
    overrides: linear.Overrides | None = None,
    span_hz: tuple[float, float] = (0.5, 500.0),
) -> tuple[list[curves.Curve], MeasuredBode]:
    """Returns (curves of the model, result) for measured responses, which the curves of the model
    show between the same signals.

    model: a path, or the file name without suffix. folders: folders of measurements. overrides:
    {parameter: value}. span_hz: range of the curves, limited by the sampling. For each state of the
    plant in the measurements, there is one curve of the model. Raises InputError.
    """
    model = linear.find_model(model)
    measured = [(str(folder), read_response(folder, model, overrides)) for folder in folders]
    signals = {(m.input, m.output, m.unit) for _, m in measured}
    if len(signals) > 1:
        found = ", ".join(sorted(f"{i} to {o}" for i, o, _ in signals))
        raise ParameterError(
            "measured", f"expected responses with equal input and equal output, got {found}"
        )
    known: list[curves.Curve] = []
    rows: list[MeasuredCurve] = []
    for folder, one in measured:
        curve = _model_curve(one, span_hz)
        if not any(_same(curve, other) for other in known):
            known.append(curve)
        turn = np.interp(np.log(one.frequency_hz), np.log(curve.frequency_hz), curve.phase_deg)
        degrees = np.degrees(np.angle(one.response))
        phase = degrees + 360 * np.round((turn - degrees) / 360)
        rows.append(
            MeasuredCurve(
                folder=folder,
                frequency_hz=one.frequency_hz,
                magnitude=np.abs(one.response),
                phase_deg=phase,
                radius=one.radius(),
                coherence=one.coherence,
                comparison=one.compare(),
            )
        )
    return (
        known,
        MeasuredBode(
            model=str(model),
            of="measured",
            input=one.input,
            timing=f"{one.dt:.6g} s",
            working=None,
            curves=[BodeCurve(output=one.output, table=c.table()) for c in known],
            measured=rows,
        ),
    )


def _model_curve(measured: Measurement, span_hz: tuple[float, float]) -> curves.Curve:
    """Returns the response of the model between the two signals of the measurement `measured`, with
    small steps of the frequency."""
    system = sampled(measured, measured.overrides)
    output = replace(system, C=system.C[1:], D=system.D[1:])
    roots = np.concatenate([output.poles_s(), output.zeros_s()])
    low, high = max(span_hz[0], measured.resolution_hz), min(span_hz[1], 0.499 / measured.dt)
    hz = curves.grid_hz(low, high, roots[np.isfinite(roots)])
    return curves.Curve("model", hz, measured.predict(frequency_hz=hz), measured.unit)


def _same(one: curves.Curve, other: curves.Curve) -> bool:
    return len(one.response) == len(other.response) and np.allclose(one.response, other.response)
