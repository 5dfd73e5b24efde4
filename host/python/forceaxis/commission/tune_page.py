"""The page of a tuning: responses, margins, contact as predicted and as measured."""

import html

import matplotlib.pyplot as plt
import numpy as np

from forceaxis import paths
from forceaxis.commission import as_found, contact, known, tune_fit
from forceaxis.design import outcome
from forceaxis.design.cases import read_contacts
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
FIGURES = (
    ("fS, Hz", "fS_Hz"),
    ("fT, Hz", "fT_Hz"),
    ("Ms", "Ms"),
    ("gain margin", "gain_margin"),
)
STANDS = 0.02  # of the set-point: a touch-down is drawn until it stays so near
SIZE_IN = 4.2  # width of a figure; three stand side by side, one on a telephone


def write(tuning, summary):
    """Writes FILE into the tuning's folder, of what is done so far."""
    order, folder = tuning.order, tuning.folder
    names = [*(["free"] if (folder / "free").exists() else [])]
    names += [n for f in order.forces if (folder / (n := f"{f:g}N")).exists()]
    fitted = (tuning.read("fit.json") or {}).get("result") or {}
    values, own = fitted.get("best") or {}, fitted.get("own") or {}
    touched = [f for f in order.forces if (folder / f"{contact.name(f)}.csv").exists()]
    parts = [
        f"<h1>Tuned: {html.escape(summary['axis'])}</h1>",
        _verdict(tuning, summary),
        _margins(summary),
    ]
    if touched and summary["levels"]:
        figures = [_touch_down(folder, force) for force in touched]
        about = "Touch-down with the new law: the reading, and that of the fitted plant with the "
        parts += ["<h2>Contact, measured and predicted</h2>", f"<p>{about}firmware.</p>"]
        parts.append(_images(figures, "Force over time, measured and predicted"))
    parts += [_simulated(summary), _verified(summary)]
    if names:
        slides = folder / tune_fit.RESPONSES  # where friction is a damper
        model = str(slides) if slides.exists() else tuning.given
        measured = [_read(tuning, name, model) for name in names]
        figures = [
            _response(n, one, own.get(n) or values) for n, one in zip(names, measured, strict=True)
        ]
        parts += ["<h2>Responses</h2>", _images(figures, ALT)]
    parts += [_fitted(summary), _steps(summary)]
    with paths.replacing(folder, FILE) as (file,):
        file.write_text(HEAD.format(style=page_style()) + "".join(parts), encoding="utf-8")


def _read(tuning, name, model):
    """The Measurement of a folder of responses, in the states that --mode names."""
    states = known.states_of(model, tuning.states)
    modes = known.states_apart(model, states) if name == "free" else states
    return fit.read_response(tuning.folder / name, model, modes=modes)


def _verdict(tuning, summary):
    """What became of it, and what limits the law."""
    text = ""
    if summary["refused"]:
        refused = summary["refused"]
        why = f"Refused in step {refused['step']}, {refused['name']}: {refused['text']}."
        lost = (tuning.folder / as_found.FILE).exists()
        then = "The next run puts back what it had." if lost else "The axis has its law of before."
        text = f'<p class="refused">{html.escape(why)} {then}</p>'
        if refused.get("lines"):
            text += f"<p>To be added to the model:</p><pre>{html.escape(refused['lines'])}</pre>"
    elif summary["stored"]:
        text = "<p>Measured, designed, verified and stored.</p>"
    text += "".join(f"<p>{html.escape(one)}</p>" for one in (
        summary["cut"], summary["limited_by"]) if one)  # fmt: skip
    if summary["holds"]:
        items = "".join(f"<li>{html.escape(line)}</li>" for line in summary["holds"])
        text += f"<h2>Where this holds</h2><ul>{items}</ul>"
    if summary["friction"]:
        rows = [["dry friction between", "N", "in the model"]]
        for rub in summary["friction"]:
            known = "yes" if rub["declared"] else "no"
            rows.append([" and ".join(rub["between"]), _number(rub["newton"]), known])
        text += "<h2>Friction</h2>" + _rows(rows)
    if summary["friction_lines"]:
        text += f"<p>Add to the model:</p><pre>{html.escape(summary['friction_lines'])}</pre>"
    return text


def _margins(summary):
    """The law of before, P and the designed one, on the fitted plant and over the set."""
    fitted, rows = summary["on_fitted"] or {}, []
    for name, worst in (
        ("before, on the fitted plant", fitted.get("before")),
        ("designed, on the fitted plant", fitted.get("designed")),
        ("P at the same margins, over the set", summary["p"]),
        ("designed, over the set", summary["worst"]),
    ):
        if worst and worst.get("stable", True):
            rows.append([name, *(_number(worst.get(key)) for _, key in FIGURES)])
        elif worst:
            rows.append([name, "unstable"])
        elif name in fitted or (fitted and name.startswith("before")):
            rows.append([name, "no law"])
    if not rows:
        return ""
    head = ["law", *(text for text, _ in FIGURES)]
    return "<h2>Margins, old and new</h2>" + _rows([head, *rows]) + TERMS


def _simulated(summary):
    """What each simulated case came to, and what was cut for it."""
    rows = read_contacts(summary["simulated"])
    if not (rows or summary["cuts"]):
        return ""
    text = "<h2>Contact, simulated with the fitted plant and the firmware</h2>"
    if rows:
        drop = outcome.CASE_HEAD.index("law")
        lines = [outcome.CASE_HEAD, *outcome.cases(rows)]
        text += _rows([[*line[:drop], *line[drop + 1 :]] for line in lines]) + CASES
    if summary["cuts"]:
        items = "".join(f"<li>{html.escape(cut)}</li>" for cut in summary["cuts"])
        text += (
            f"<p>What the simulation took off the designed gain, a tenth each:</p><ul>{items}</ul>"
        )
    return text


def _verified(summary):
    """The measured peaks of |S|."""
    if not summary["levels"]:
        return ""
    rows = [["set-point", "Ms", "95 %, ±", "Ms predicted", "at, Hz"]]
    for level in summary["levels"].values():
        error = 2 * level["Ms_error"]
        numbers = (level["Ms"], level["Ms_predicted"], level["Ms_hz"])
        Ms, predicted, at = map(_number, numbers)
        rows.append([f"{level['bias_N']:.3g} N", Ms, plain(error, 2), predicted, at])
    return "<h2>Peak of |S|, measured with the law and predicted</h2>" + _rows(rows)


def _fitted(summary):
    """The parameters with their intervals."""
    if not summary["parameters"]:
        return ""
    rows = [["parameter", "value", "95 % interval", "unit"]]
    for name, row in summary["parameters"].items():
        ends = " to ".join(_number(end) for end in row["interval"])
        rows.append([name, _number(row["value"]), ends, row["unit"]])
    return "<h2>What the responses say of the axis</h2>" + _rows(rows)


def _steps(summary):
    if not summary["seconds"]:
        return ""
    rows = [["step", "s"], *([step, f"{took:.1f}"] for step, took in summary["seconds"].items())]
    return "<h2>Steps</h2>" + _rows(rows)


def _rows(rows):
    lines = [
        "".join(
            f"<{tag}{' class=number' if column else ''}>{html.escape(str(cell))}</{tag}>"
            for column, cell in enumerate(row)
        )
        for tag, row in zip(["th"] + ["td"] * (len(rows) - 1), rows, strict=True)
    ]
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def _number(value):
    return "-" if value is None else plain(value, 4)


def _touch_down(folder, force_N):
    """Figure: the recorded reading and the predicted one."""
    held = np.genfromtxt(folder / f"{contact.name(force_N)}.csv", delimiter=",", names=True)
    figure, ax = plt.subplots(figsize=(SIZE_IN, 2.8))
    ax.axhline(force_N, color=WANTED, linestyle="--", linewidth=0.8, label="set-point")
    expected, measured = held["predicted_N"], held["force_N"]
    ax.plot(held["time_s"], expected, color=GOT, linewidth=2.4, alpha=0.5, label="predicted")
    ax.plot(held["time_s"], measured, color=INK, linewidth=0.8, label="measured")
    within = STANDS * force_N + np.ptp(measured[held["time_s"] < -0.02])
    far = np.maximum(abs(expected - force_N), abs(measured - force_N)) > within
    settled = held["time_s"][np.flatnonzero(far)[-1]]
    ax.set_xlim(-0.05, min(settled + 0.2, held["time_s"][-1]))
    ax.set_xlabel("time from the touch, s")
    ax.set_ylabel("force, N")
    style(ax)
    legend(ax, loc="lower right")
    finish(figure, ax, f"{force_N:g} N")
    return figure


def _response(name, one, values):
    """Figure: a response with its band and the fitted model's, coherence below."""
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
    size.set_ylim(bottom=magnitude.min() / 2)  # the band may reach far down
    plain_ticks(coherence.xaxis)
    plain_ticks(size.yaxis)
    legend(size)
    figure.tight_layout()
    plt.close(figure)
    return figure


def _images(figures, alt):
    tags = [f'<img alt="{alt}" src="{uri(figure)}">' for figure in figures]
    return f'<div class="figures">{"".join(tags)}</div>'
