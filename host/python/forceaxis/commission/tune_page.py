"""Writes the page of a tuning: responses, margins, and contacts as predicted and measured."""

import html
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from forceaxis import paths
from forceaxis.commission import as_found, contact, known
from forceaxis.commission.tune import FIT, Tuning
from forceaxis.commission.tune_folder import RESPONSES_MODEL, read_touch_down
from forceaxis.commission.tune_results import (
    Fitted,
    TuningSummary,
    Values,
)
from forceaxis.design import outcome
from forceaxis.design.certificate import NoPFigures, WorstFigures
from forceaxis.drawing import (
    GOT,
    INK,
    WANTED,
    finish,
    legend,
    page_style,
    plain_ticks,
    style,
    uri,
)
from forceaxis.identify import fit
from forceaxis.identify.measurement import Measurement
from forceaxis.linear.over import Figures
from forceaxis.words import plain

ALT = "Response with its 95 % band beside the fitted model's, and its coherence"
FILE = "index.html"
HEAD = """<!doctype html><html lang="en"><meta charset="utf-8"><title>Tuned axis</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark"><link rel="icon" href="data:,">
<style>
{style}h1 {{ overflow-wrap: anywhere; }}
.refused {{ border-left: 4px solid var(--bad); padding-left: .8em; }}
</style>
"""
TERMS = """<p class="small">fS: the lowest frequency at which |S| reaches -3 dB; fT: where |T| last
falls through -3 dB; Ms: the largest |S|. Over the set: of its worst member.</p>"""
CASES = """<p class="small">Stable: how many settled, of the fitted plant and random members of
the set. Losses of contact, the worst peak and the saturation of the output are the largest of all
of them; the other figures are those of the fitted plant.</p>"""
MARGINS_HEAD = ["law", "fS, Hz", "fT, Hz", "Ms", "gain margin"]
# share of the set-point: the figure ends after the force has settled within this band
SETTLED_SHARE = 0.02
SIZE_IN = 4.2  # width of a figure; a row has three figures on a screen and one on a telephone


def write(tuning: Tuning, summary: TuningSummary) -> None:
    """Writes FILE to the folder of the tuning, with the results so far."""
    order, folder = tuning.order, tuning.folder
    names = [*(["free"] if (folder / "free").exists() else [])]
    names += [n for f in order.forces if (folder / (n := f"{f:g}N")).exists()]
    fitted = FIT.done(tuning)
    touched = [f for f in order.forces if (folder / f"{contact.name(f)}.csv").exists()]
    parts = [
        f"<h1>Tuned: {html.escape(summary.axis)}</h1>",
        _verdict(tuning, summary),
        _margins(summary),
    ]
    if touched and summary.levels:
        figures = [_touch_down(folder, force) for force in touched]
        about = "Touch-down with the new law: the reading, and that of the fitted plant with the "
        parts += ["<h2>Contact, measured and predicted</h2>", f"<p>{about}firmware.</p>"]
        parts.append(_images(figures, "Force over time, measured and predicted"))
    parts += [_simulated(summary), _verified(summary)]
    if names:
        slides = folder / RESPONSES_MODEL  # the model with dampers in the place of friction
        model = slides if slides.exists() else tuning.given
        figures = [
            _response(name, _read(tuning, name, model), _values(fitted, name)) for name in names
        ]
        parts += ["<h2>Responses</h2>", _images(figures, ALT)]
    parts += [_fitted(summary), _steps(summary)]
    with paths.replacing(folder, FILE) as (file,):
        file.write_text(HEAD.format(style=page_style()) + "".join(parts), encoding="utf-8")


def _values(fitted: Fitted | None, name: str) -> Values:
    """The fitted values, with those that belong to one response alone; {} before the fit."""
    return (fitted.own.get(name) or fitted.best) if fitted else {}


def _read(tuning: Tuning, name: str, model: Path) -> Measurement:
    """The Measurement in a folder of a response, linearised in the states of the order."""
    states = known.states_of(model, tuning.states)
    modes = known.states_apart(model, states) if name == "free" else states
    return fit.read_response(tuning.folder / name, model, modes=modes)


def _verdict(tuning: Tuning, summary: TuningSummary) -> str:
    """The result of the tuning, and the bound that limits the force law."""
    text, refused = "", summary.refused
    if refused:
        why = f"Refused in step {refused.step}, {refused.name}: {refused.text}."
        lost = (tuning.folder / as_found.FOUND.name).exists()
        then = "The next run puts back what it had." if lost else "The axis has its law of before."
        text = f'<p class="refused">{html.escape(why)} {then}</p>'
        if refused.lines:
            text += f"<p>To be added to the model:</p><pre>{html.escape(refused.lines)}</pre>"
    elif summary.stored:
        text = "<p>Measured, designed, verified and stored.</p>"
    text += "".join(
        f"<p>{html.escape(one)}</p>" for one in (summary.cut, summary.limited_by) if one
    )
    if summary.holds:
        items = "".join(f"<li>{html.escape(line)}</li>" for line in summary.holds)
        text += f"<h2>Where this holds</h2><ul>{items}</ul>"
    if summary.friction:
        rows = [["dry friction between", "N", "in the model"]]
        for rub in summary.friction:
            declared = "yes" if rub.declared else "no"
            rows.append([" and ".join(rub.between), _number(rub.newton), declared])
        text += "<h2>Friction</h2>" + _rows(rows)
    if summary.friction_lines:
        text += f"<p>Add to the model:</p><pre>{html.escape(summary.friction_lines)}</pre>"
    return text


def _margins(summary: TuningSummary) -> str:
    """A table of the previous law, the P law and the designed law, on the fitted plant and over the
    set."""
    rows = []
    for name, loop in (summary.on_fitted or {}).items():
        label = f"{name}, on the fitted plant"
        if loop is None:
            rows += [[label, "no law"]] if name == "before" else []
        else:
            rows.append(_figures(label, loop) if loop.stable else [label, "unstable"])
    p = summary.p
    if p:
        rows.append(_figures("P at the same margins, over the set", p))
    if summary.worst:
        rows.append(_figures("designed, over the set", summary.worst))
    if not rows:
        return ""
    return "<h2>Margins, old and new</h2>" + _rows([MARGINS_HEAD, *rows]) + TERMS


def _figures(label: str, figures: WorstFigures | NoPFigures | Figures) -> list[str]:
    """A row of a table with the columns of MARGINS_HEAD."""
    if isinstance(figures, NoPFigures):
        return [label, *map(_number, [None] * (len(MARGINS_HEAD) - 1))]
    values = figures.fS_Hz, figures.fT_Hz, figures.Ms, figures.gain_margin
    return [label, *map(_number, values)]


def _simulated(summary: TuningSummary) -> str:
    """A table of the simulated cases, and the gains that were reduced for them."""
    rows = summary.simulated
    if not (rows or summary.cuts):
        return ""
    text = "<h2>Contact, simulated with the fitted plant and the firmware</h2>"
    if rows:
        drop = outcome.CASE_HEAD.index("law")
        lines = [outcome.CASE_HEAD, *outcome.cases(rows)]
        text += _rows([[*line[:drop], *line[drop + 1 :]] for line in lines]) + CASES
    if summary.cuts:
        items = "".join(f"<li>{html.escape(cut)}</li>" for cut in summary.cuts)
        text += (
            f"<p>What the simulation took off the designed gain, a tenth each:</p><ul>{items}</ul>"
        )
    return text


def _verified(summary: TuningSummary) -> str:
    """A table of the measured peaks of |S|."""
    if not summary.levels:
        return ""
    rows = [["set-point", "Ms", "95 %, ±", "Ms predicted", "at, Hz"]]
    for level in summary.levels.values():
        Ms, predicted, at = map(_number, (level.Ms, level.Ms_predicted, level.Ms_hz))
        rows.append([f"{level.bias_N:.3g} N", Ms, plain(2 * level.Ms_error, 2), predicted, at])
    return "<h2>Peak of |S|, measured with the law and predicted</h2>" + _rows(rows)


def _fitted(summary: TuningSummary) -> str:
    """A table of the parameters with their confidence intervals."""
    if not summary.parameters:
        return ""
    rows = [["parameter", "value", "95 % interval", "unit"]]
    for name, row in summary.parameters.items():
        ends = " to ".join(_number(end) for end in row.interval)
        rows.append([name, _number(row.value), ends, row.unit])
    return "<h2>What the responses say of the axis</h2>" + _rows(rows)


def _steps(summary: TuningSummary) -> str:
    """A table of the duration of each step."""
    if not summary.seconds:
        return ""
    rows = [["step", "s"], *([step, f"{took:.1f}"] for step, took in summary.seconds.items())]
    return "<h2>Steps</h2>" + _rows(rows)


def _rows(rows: Sequence[Sequence[str]]) -> str:
    lines = [
        "".join(
            f"<{tag}{' class=number' if column else ''}>{html.escape(cell)}</{tag}>"
            for column, cell in enumerate(row)
        )
        for tag, row in zip(["th"] + ["td"] * (len(rows) - 1), rows, strict=True)
    ]
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def _number(value: float | None) -> str:
    return "-" if value is None else plain(value, 4)


def _touch_down(folder: Path, force_N: float) -> Figure:
    """Figure of the measured force and the predicted force over time."""
    touch = read_touch_down(folder / f"{contact.name(force_N)}.csv")
    time_s, expected, measured = touch.time_s, touch.predicted_N, touch.force_N
    figure, ax = plt.subplots(figsize=(SIZE_IN, 2.8))
    ax.axhline(force_N, color=WANTED, linestyle="--", linewidth=0.8, label="set-point")
    ax.plot(time_s, expected, color=GOT, linewidth=2.4, alpha=0.5, label="predicted")
    ax.plot(time_s, measured, color=INK, linewidth=0.8, label="measured")
    within = SETTLED_SHARE * force_N + np.ptp(measured[time_s < -0.02])
    far = np.maximum(abs(expected - force_N), abs(measured - force_N)) > within
    settled = time_s[np.flatnonzero(far)[-1]]
    ax.set_xlim(-0.05, min(settled + 0.2, time_s[-1]))
    ax.set_xlabel("time from the touch, s")
    ax.set_ylabel("force, N")
    style(ax)
    legend(ax, loc="lower right")
    finish(figure, ax, f"{force_N:g} N")
    return figure


def _response(name: str, one: Measurement, values: Values) -> Figure:
    """Figure of a response with its confidence band and the response of the fitted model; coherence
    below."""
    figure, (size, phase, coherence) = plt.subplots(
        3, 1, figsize=(SIZE_IN, 5.6), sharex=True, height_ratios=(3, 2, 1)
    )
    f, magnitude, radius = one.frequency_hz, abs(one.response), one.radius()
    if values:
        model = one.predict(values)
        size.loglog(f, abs(model), color=GOT, linewidth=2.4, alpha=0.5, label="fitted")
        phase.semilogx(f, np.degrees(np.angle(model)), ".", color=GOT, markersize=4, alpha=0.4)
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
    size.set_ylim(bottom=magnitude.min() / 2)  # the confidence band may reach almost to zero
    plain_ticks(coherence.xaxis)
    plain_ticks(size.yaxis)
    legend(size)
    figure.tight_layout()
    plt.close(figure)
    return figure


def _images(figures: Sequence[Figure], alt: str) -> str:
    tags = [f'<img alt="{alt}" src="{uri(figure)}">' for figure in figures]
    return f'<div class="figures">{"".join(tags)}</div>'
