"""Writes recordings of the signals of an axis to files."""

import csv
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from forceaxis import paths
from forceaxis.axis.link import Recording
from forceaxis.bus.message_rows import column_name

FILES = ("capture.csv", "capture.npz", "capture.png")


def columns(recording: Recording) -> dict[str, NDArray[np.int64 | np.float64]]:
    """Returns the columns of a recording as {name of the column: values}. The column `time_s` has
    the time of each sample from the trigger. Each signal has a column whose name contains the
    unit."""
    values = {column_name(name): recording.values(name) for name in recording.signals}
    return {"time_s": recording.time_s, **values}


def write(recording: Recording, folder: Path, title: str) -> None:
    """Writes a recording to the files capture.csv, capture.npz and capture.png in `folder`, which
    is created if necessary. Writes either all files or none. Raises OSError."""
    table = columns(recording)
    with paths.replacing(folder, *FILES) as (text, arrays, picture):
        with text.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(table)
            writer.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
        with arrays.open("wb") as file:
            np.savez_compressed(file, **table)  # type: ignore[arg-type]
        figure(recording, title).savefig(picture, format="png", dpi=120)


def figure(recording: Recording, title: str) -> Figure:
    """Returns a Matplotlib figure of a recording. It has one plot for each signal, over the time
    from the trigger."""
    import matplotlib.pyplot as plt

    from forceaxis.drawing import INK, THIN, style

    table = columns(recording)
    time_s = table.pop("time_s")
    figure, rows = plt.subplots(
        len(table), 1, sharex=True, squeeze=False, figsize=(7, 1 + 1.5 * len(table)),
        layout="constrained",
    )  # fmt: skip
    for ax, (name, column) in zip(rows[:, 0], table.items(), strict=True):
        style(ax)
        ax.plot(time_s, column, color=INK, **THIN)
        ax.set_ylabel(name, fontsize=8, parse_math=False)
        if recording.trigger_sample:
            ax.axvline(0, color="0.6", linewidth=0.8)
    rows[-1, 0].set_xlabel("time from the trigger, s" if recording.trigger_sample else "time, s")
    rows[0, 0].set_title(title, fontsize=9, loc="left", color=INK, parse_math=False)
    plt.close(figure)
    return figure
