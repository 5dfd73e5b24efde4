"""The page of a tuning: responses, margins, contact as predicted and as measured."""

import base64
import html
import io

import matplotlib.pyplot as plt
import numpy as np

from forceaxis.drawing import GOT, INK, style
from forceaxis.identify import fit

FILE = "index.html"
HEAD = """<!doctype html><html lang="en"><meta charset="utf-8"><title>Tuned axis</title>
<meta name="viewport" content="width=device-width">
<style>
:root { color-scheme: light dark; }
body { font: 15px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; }
table { border-collapse: collapse; display: block; overflow-x: auto; }
td, th { padding: .2em .8em; text-align: right; }
td:first-child, th:first-child { text-align: left; padding-left: 0; }
tr + tr { border-top: 1px solid #8884; }
img { max-width: 100%; background: white; border-radius: 4px; }
</style>
"""


def write(tuning, summary):
    """Writes FILE into the tuning's folder, of what is done so far."""
    from forceaxis import paths

    order = tuning.order
    names = [*(["free"] if (tuning.folder / "free").exists() else [])]
    names += [n for f in order.forces if (tuning.folder / (n := f"{f:g}N")).exists()]
    measured = {n: fit.read_response(tuning.folder / n, tuning.model) for n in names}
    values = ((tuning.read("fit.json") or {}).get("result") or {}).get("values", {})
    parts = [f"<h1>{html.escape(summary['axis'])}</h1>", _sentence(summary), _table(summary)]
    if measured:
        parts += ["<h2>Responses</h2>", _image(_responses(measured, values))]
    with paths.replacing(tuning.folder, FILE) as (file,):
        file.write_text(HEAD + "".join(parts), encoding="utf-8")


def _sentence(summary):
    limited = summary["limited_by"]
    return f"<p>{html.escape(limited)}</p>" if limited else ""


def _table(summary):
    """P and the designed bank over the set, the verified peaks, what was fitted."""
    rows = [["", "fS, Hz", "fT, Hz", "Ms", "a tick late", "gain margin", "phase margin"]]
    for name, worst in (("P", summary["p"]), ("designed", summary["worst"])):
        if worst:
            keys = ("fS_Hz", "fT_Hz", "Ms", "Ms_late", "gain_margin", "phase_margin_deg")
            rows.append([name, *(_number(worst.get(key)) for key in keys)])
    text = "<h2>What the law bears over the set</h2>" + _rows(rows) if len(rows) > 1 else ""
    if summary["levels"]:
        rows = [["verified", "bias, N", "Ms", "predicted", "at, Hz"]]
        for name, level in summary["levels"].items():
            keys = ("bias_N", "Ms", "Ms_predicted", "Ms_hz")
            rows.append([name, *(_number(level[key]) for key in keys)])
        text += "<h2>Peak of |S|, measured with the law and predicted</h2>" + _rows(rows)
    if summary["parameters"]:
        rows = [["fitted", "value", "95 % interval", "unit"]]
        for name, row in summary["parameters"].items():
            ends = " .. ".join(_number(end) for end in row["interval"])
            rows.append([name, _number(row["value"]), ends, row["unit"]])
        text += "<h2>What the responses say of the axis</h2>" + _rows(rows)
    return text


def _rows(rows):
    lines = [
        "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in row)
        for tag, row in zip(["th"] + ["td"] * (len(rows) - 1), rows, strict=True)
    ]
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def _number(value):
    return "-" if value is None else f"{value:.4g}"


def _responses(measured, values):
    """Figure: each response with its band and the fitted model's, coherence below."""
    figure, axes = plt.subplots(
        3, len(measured), figsize=(4.2 * len(measured), 6.2), sharex="col", squeeze=False,
        height_ratios=(3, 2, 1),
    )  # fmt: skip
    for (size, phase, coherence), (name, one) in zip(axes.T, measured.items(), strict=True):
        f, magnitude, radius = one.frequency_hz, abs(one.response), one.radius()
        model = one.predict(values)
        size.loglog(f, abs(model), color=GOT, linewidth=2.4, alpha=0.5, label="fitted")
        size.loglog(f, magnitude, color=INK, linewidth=0.9, label="measured")
        low = np.maximum(magnitude - radius, magnitude * 1e-2)
        size.fill_between(f, low, magnitude + radius, color=INK, alpha=0.2, linewidth=0)
        phase.semilogx(f, np.degrees(np.angle(model)), ".", color=GOT, markersize=4, alpha=0.4)
        phase.semilogx(f, np.degrees(np.angle(one.response)), ".", color=INK, markersize=1.5)
        phase.set(ylim=(-190, 190), yticks=range(-180, 181, 90))
        coherence.semilogx(f, one.coherence, color=INK, linewidth=0.9)
        coherence.set(ylim=(0, 1.05))
        coherence.set_xlabel("frequency, Hz", fontsize=8)
        size.set_title(f"{name}: {one.input} to {one.output}", fontsize=9, loc="left", color=INK)
        for axis in (size, phase, coherence):
            style(axis)
            axis.grid(True, which="both", linewidth=0.3, alpha=0.6)
    for axis, text in zip(axes[:, 0], ("count/code", "degrees", "coherence"), strict=True):
        axis.set_ylabel(text, fontsize=8)
    axes[0, 0].legend(fontsize=7, frameon=False)
    figure.tight_layout()
    plt.close(figure)
    return figure


def _image(figure):
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=100)
    alt = "Responses with their 95 % bands beside the fitted model's, and their coherence"
    return (
        f'<img alt="{alt}" src="data:image/png;base64,{base64.b64encode(out.getvalue()).decode()}">'
    )
