"""Plots and files of comparisons of recordings with predictions."""

import json
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forceaxis import drawing, paths
from forceaxis.experiments.compare import ComparedRecording, ComparedSignal
from forceaxis.results import to_json

RESULT = "comparison.json"
MM = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3)}  # {unit: (unit in plots, factor)}


def figure(compared: ComparedRecording) -> Figure:
    """Returns the plot of a comparison. It shows each signal as measured and as predicted, with the
    band for a single sample, and below it the difference."""
    signals = compared.signals
    made, rows = plt.subplots(
        2 * len(signals), 1, sharex=True, squeeze=False, layout="constrained",
        figsize=(8, 0.8 + 3.4 * len(signals)), height_ratios=[2.2, 1] * len(signals),
    )  # fmt: skip
    for place, signal in enumerate(signals):
        _draw(rows[2 * place, 0], rows[2 * place + 1, 0], signal)
    result = compared.result
    outside = sum(not one.agrees for one in result.figures)
    verdict = f"{outside} of {len(result.figures)} figures differ" if outside else "agrees"
    rows[0, 0].set_title(
        f"{result.title} and {drawing.name_of(result.experiment)}: {verdict}",
        fontsize=9, loc="left", color=drawing.INK, parse_math=False,
    )  # fmt: skip
    rows[-1, 0].set_xlabel("time from the first contact, s")
    drawing.legend(made, rows[0, 0].get_legend_handles_labels()[0], loc="outside lower center",
                   ncols=3)  # fmt: skip
    plt.close(made)
    return made


def _draw(above: Axes, below: Axes, signal: ComparedSignal) -> None:
    unit, factor = MM.get(signal.unit, (signal.unit, 1.0))
    time_s = signal.time_s
    low, high = signal.low * factor, signal.high * factor
    predicted, measured = signal.predicted * factor, signal.measured * factor
    for ax, zero in ((above, 0.0), (below, predicted)):
        drawing.style(ax)
        ax.fill_between(
            time_s, low - zero, high - zero, color=drawing.WANTED, alpha=0.3, linewidth=0,
            label="band of 95 % of the samples",
        )  # fmt: skip
        ax.axvline(0, color=drawing.FAINT, linewidth=0.6)
    above.plot(time_s, predicted, color=drawing.WANTED, label="predicted", linewidth=0.9)
    above.plot(time_s, measured, color=drawing.INK, label="measured", linewidth=0.9)
    below.plot(time_s, measured - predicted, color=drawing.INK, linewidth=0.9)
    above.set_ylabel(f"{signal.name}, {unit}")
    below.set_ylabel(f"residual, {unit}")
    above.margins(x=0)


def write(compared: Sequence[ComparedRecording], folder: Path) -> None:
    """Writes the results of all comparisons to comparison.json in `folder`. For each comparison,
    also writes a plot (.png, .svg) and the signals (.npz). Writes either all files or none. Raises
    OSError."""
    stems = _stems(compared)
    names = [f"{stem}{end}" for stem in stems for end in (".png", ".svg", ".npz")]
    with paths.replacing(folder, RESULT, *names) as (result, *files):
        results = [to_json(one.result) for one in compared]
        result.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
        for place, one in enumerate(compared):
            png, svg, npz = files[3 * place : 3 * place + 3]
            drawn = figure(one)
            drawing.save(drawn, png, "png")
            drawing.save(drawn, svg, "svg")
            with npz.open("wb") as file:
                np.savez_compressed(file, **_arrays(one))  # type: ignore[arg-type]


def _stems(compared: Sequence[ComparedRecording]) -> list[str]:
    """Returns the file name without suffix for the files of each recording."""
    stems = [Path(one.result.recording).stem for one in compared]
    return [f"{s}_{i + 1}" if stems.count(s) > 1 else s for i, s in enumerate(stems)]


def _arrays(compared: ComparedRecording) -> dict[str, np.ndarray]:
    arrays = {"time_s": compared.signals[0].time_s}
    for signal in compared.signals:
        for kind in ("measured", "predicted", "low", "high"):
            arrays[f"{kind}_{signal.name}"] = getattr(signal, kind)
    return arrays
