"""Writes the page about the tuning of an axis: responses, margins, and contacts as predicted and as
measured."""

import functools
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from forceaxis import paths
from forceaxis.commission import as_found, contact, known
from forceaxis.commission.tune import FIT, Tuning
from forceaxis.commission.tune_folder import RESPONSES_MODEL, read_touch_down
from forceaxis.commission.tune_results import Fitted, TuningSummary
from forceaxis.design import outcome
from forceaxis.design.certificate import WorstFigures
from forceaxis.drawing import (
    GOT,
    INK,
    WANTED,
    finish,
    legend,
    plain_ticks,
    style,
    uri,
)
from forceaxis.identify import fit
from forceaxis.linear.precise import Figures
from forceaxis.pages.template import template
from forceaxis.words import plain

FILE = "index.html"
# Tolerance band of a settled force, relative to the set-point.
# The plot of a contact ends soon after the force has settled within this band.
SETTLED_SHARE = 0.02
# Width of a plot in inches. A row of the page has three plots on a screen, and one on a telephone.
FIGURE_WIDTH_IN = 4.2

_number = functools.partial(outcome.number, digits=4)
Rows = list[list[str]]  # rows of a table on the page; the first row is the header


def write(tuning: Tuning, summary: TuningSummary) -> None:
    """Writes the page index.html into the folder of a tuning. The page shows the results of all
    steps that have finished."""
    forces, folder = tuning.order.forces, tuning.folder
    fitted = FIT.done(tuning)
    touched = [f for f in forces if (folder / f"{contact.name(f)}.csv").exists()]
    names = [n for n in ("free", *(f"{f:g}N" for f in forces)) if (folder / n).exists()]
    html = template("tuning").render(
        s=summary,
        is_lost=(folder / as_found.FOUND.name).exists(),
        friction=_friction(summary),
        margins=_margins(summary),
        touch_downs=[_touch_down(folder, f) for f in touched if summary.levels],
        cases=_cases(summary),
        verified=_verified(summary),
        responses=[_response(tuning, name, fitted) for name in names],
        parameters=_parameters(summary),
        steps=[["step", "s"], *([step, f"{s:.1f}"] for step, s in summary.seconds.items())],
    )
    with paths.replacing(folder, FILE) as (file,):
        file.write_text(html, encoding="utf-8")


def _friction(summary: TuningSummary) -> Rows:
    """Returns a table of the measured dry friction. Its columns are the two bodies between which it
    acts, the force in N, and whether the model contains the friction."""
    return [
        ["dry friction between", "N", "in the model"],
        *(
            [" and ".join(rub.between), _number(rub.newton), "yes" if rub.declared else "no"]
            for rub in summary.friction or ()
        ),
    ]


def _margins(summary: TuningSummary) -> Rows:
    """Returns a table that compares the margins of the previous law, of law P and of the designed
    law. It has the margins with the fitted plant, and the worst ones over the set of plants."""
    rows = [["law", "fS, Hz", "fT, Hz", "Ms", "gain margin"]]
    for name, loop in (summary.on_fitted or {}).items():
        label = f"{name}, on the fitted plant"
        if loop is None:
            rows += [[label, "no law"]] if name == "before" else []
        else:
            rows.append([label, *_figures(loop)] if loop.stable else [label, "unstable"])
    if summary.p:
        p = summary.p if isinstance(summary.p, WorstFigures) else None
        rows.append(["P at the same margins, over the set", *_figures(p)])
    if summary.worst:
        rows.append(["designed, over the set", *_figures(summary.worst)])
    return rows


def _figures(law: WorstFigures | Figures | None) -> Iterator[str]:
    """Yields the bandwidth and the margins of a control law as texts for the table of margins.
    Yields "-" in each column if there is no such law."""
    figures = (law.fS_Hz, law.fT_Hz, law.Ms, law.gain_margin) if law else (None,) * 4
    return map(_number, figures)


def _cases(summary: TuningSummary) -> Rows:
    """Returns a table of the contacts that were simulated with the designed force law."""
    rows = [outcome.CASE_HEAD, *outcome.cases(summary.simulated)]
    law = outcome.CASE_HEAD.index("law")
    return [[*row[:law], *row[law + 1 :]] for row in rows]


def _verified(summary: TuningSummary) -> Rows:
    """Returns a table of the measured and the predicted Ms at each force set-point."""
    rows = [["set-point", "Ms", "95 %, ±", "Ms predicted", "at, Hz"]]
    for level in (summary.levels or {}).values():
        Ms, predicted, at = map(_number, (level.Ms, level.Ms_predicted, level.Ms_hz))
        rows.append([f"{plain(level.bias_N)} N", Ms, plain(2 * level.Ms_error, 2), predicted, at])
    return rows


def _parameters(summary: TuningSummary) -> Rows:
    """Returns a table of the fitted parameters with their confidence intervals."""
    rows = [["parameter", "value", "95 % interval", "unit"]]
    for name, row in (summary.parameters or {}).items():
        ends = " to ".join(_number(end) for end in row.interval)
        rows.append([name, _number(row.value), ends, row.unit])
    return rows


def _touch_down(folder: Path, force_N: float) -> str:
    """Returns the data URI of a plot of the measured and the predicted force over the time after a
    first contact."""
    touch = read_touch_down(folder / f"{contact.name(force_N)}.csv")
    time_s, expected, measured = touch.time_s, touch.predicted_N, touch.force_N
    figure, ax = plt.subplots(figsize=(FIGURE_WIDTH_IN, 2.8))
    ax.axhline(force_N, color=WANTED, linestyle="--", linewidth=0.8, label="set-point")
    ax.plot(time_s, expected, color=GOT, linewidth=2.4, alpha=0.5, label="predicted")
    ax.plot(time_s, measured, color=INK, linewidth=0.8, label="measured")
    within = SETTLED_SHARE * force_N + np.ptp(measured[time_s < -0.02])
    # np.fmax ignores the predicted force at times at which it is NaN.
    far = np.fmax(abs(expected - force_N), abs(measured - force_N)) > within
    settled = time_s[far].max(initial=0.0)
    ax.set(xlim=(-0.05, min(settled + 0.2, time_s[-1])))
    ax.set(xlabel="time from the touch, s", ylabel="force, N")
    style(ax)
    legend(ax, loc="lower right")
    finish(figure, ax, f"{force_N:g} N")
    return uri(figure)


def _response(tuning: Tuning, name: str, fitted: Fitted | None) -> str:
    """Returns the data URI of a plot of a measured response. It shows the confidence band, the
    response of the fitted model, and the coherence."""
    # If the axis has dry friction, the drawn model has dampers in place of this friction.
    damped = tuning.folder / RESPONSES_MODEL
    model = damped if damped.exists() else tuning.given
    states = known.states_of(model, tuning.states)
    modes = known.states_apart(model, states) if name == "free" else states
    settings = fit.ResponseSettings(modes=modes)
    one = fit.read_response(tuning.folder / name, model, settings=settings)
    figure, (size, phase, coherence) = plt.subplots(
        3, 1, figsize=(FIGURE_WIDTH_IN, 5.6), sharex=True, height_ratios=(3, 2, 1)
    )
    f, magnitude, radius = one.frequency_hz, abs(one.response), one.radius()
    if fitted:
        expected = one.predict(fitted.own.get(name) or fitted.best)
        size.loglog(f, abs(expected), color=GOT, linewidth=2.4, alpha=0.5, label="fitted")
        phase.semilogx(f, np.degrees(np.angle(expected)), ".", color=GOT, markersize=4, alpha=0.4)
    size.loglog(f, magnitude, color=INK, linewidth=0.9, label="measured, 95 % band")
    low = np.maximum(magnitude - radius, magnitude * 1e-2)
    size.fill_between(f, low, magnitude + radius, color=INK, alpha=0.2, linewidth=0)
    phase.semilogx(f, np.degrees(np.angle(one.response)), ".", color=INK, markersize=1.5)
    phase.set(ylim=(-190, 190), yticks=range(-180, 181, 90))
    coherence.semilogx(f, one.coherence, color=INK, linewidth=0.9)
    coherence.set(ylim=(0, 1.05), xlabel="frequency, Hz")
    title = "apart: codes to the encoder" if name == "free" else f"{name}: codes to the reading"
    size.set_title(title, fontsize=9, loc="left", color=INK)
    for axis, text in ((size, one.unit), (phase, "phase, degrees"), (coherence, "coherence")):
        style(axis)
        axis.grid(True, which="both", linewidth=0.3, alpha=0.6)
        axis.set_ylabel(text)
    # The plot omits the lower end of the confidence band, which may be near zero.
    size.set_ylim(bottom=magnitude.min() / 2)
    plain_ticks(coherence.xaxis)
    plain_ticks(size.yaxis)
    legend(size)
    figure.tight_layout()
    plt.close(figure)
    return uri(figure)
