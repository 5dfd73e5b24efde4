"""Plots that are shown only in the report about all experiments."""

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import ticker
from matplotlib.figure import Figure

from forceaxis.drawing import INK, style
from forceaxis.thesis.nonlinear import ContactMap


def plateau(
    curves: Mapping[str, Sequence[tuple[float, float]]], score_of_fit: float, label: str
) -> Figure:
    """Returns a plot of the number of table cells with equal verdicts over the value of each fitted
    constant, relative to its fitted value. There is one curve for each constant.

    curves: {constant: [(ratio to the fitted value, score)]}. label: label of the scores.
    """
    figure, ax = plt.subplots(figsize=(5.6, 2.8))
    style(ax)
    for name, pairs in curves.items():
        ratio, score = np.transpose(pairs)
        ax.plot(ratio * 100, score, linewidth=0.9, marker="o", markersize=3, label=name)
    ax.axhline(score_of_fit, color="#999999", linewidth=0.6)
    ax.set_xlabel("constant, % of its fitted value")
    ax.set_ylabel(label)
    locator = ticker.AutoLocator()
    locator.set_params(integer=True)
    ax.yaxis.set_major_locator(locator)
    ax.legend(fontsize=7, frameon=False)
    figure.tight_layout()
    plt.close(figure)
    return figure


def contact_maps(
    maps: Sequence[ContactMap], gains: Sequence[float], gaps: Sequence[float]
) -> Figure:
    """Returns a plot of the simulated runs that end in a limit cycle. Its axes are the initial gap
    and the gain relative to the critical gain of the linear loop."""
    size = (5.6, 0.7 + 2.3 * len(maps))
    figure, axes = plt.subplots(len(maps), 1, sharex=True, figsize=size)
    columns, rows = np.meshgrid(np.arange(len(gaps)), gains)
    for ax, m in zip(axes, maps, strict=True):
        style(ax)
        ax.scatter(columns[m.cycles], rows[m.cycles], s=16, color="#c0562b", label="cycles")
        ax.scatter(
            columns[~m.cycles], rows[~m.cycles], s=16, facecolor="none", edgecolor=INK,
            linewidth=0.8, label="settles",
        )  # fmt: skip
        ax.axhline(1, color="#555555", linewidth=0.9, linestyle="--")
        ax.set_title(m.title, fontsize=8, loc="left", color=INK, parse_math=False)
        ax.set_xticks(range(0, len(gaps), 2), [f"{gap * 1e3:g}" for gap in gaps[::2]])
        ax.set_ylabel("force gain / linear limit", fontsize=8)
    axes[-1].set_xlabel("initial gap, mm", fontsize=8)
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="lower left", ncols=2, fontsize=7, frameon=False
    )
    figure.tight_layout(rect=(0, 0.02, 1, 1))
    plt.close(figure)
    return figure
