"""Plots of parameters that were identified from touch-downs. One plot shows the posterior for each
pair of parameters. The other plot compares the measured touch-downs with the touch-downs of the
model."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from forceaxis.commission.contact_results import Identified
from forceaxis.drawing import COLORS, FAINT, GOT, INK, legend, name_of, style
from forceaxis.words import plain

DRAWN = 1500  # largest number of samples in a plot
BAND_PLANTS = 40  # number of simulated plants from which a band of the force is drawn


def pairs(found: Identified) -> Figure:
    """Returns the plot of the posterior. It shows the density of each parameter together with the
    density of its prior, and samples of each pair of parameters."""
    result, problem = found.result, found.problem
    assert result.posterior is not None
    names, table = result.posterior.names, result.posterior.table
    size = len(names)
    figure, every = plt.subplots(
        size, size, figsize=(1.3 + 1.5 * size, 1.1 + 1.4 * size), squeeze=False
    )
    shown = table[np.linspace(0, len(table) - 1, min(DRAWN, len(table))).astype(int)]
    for i, row in enumerate(names):
        for j in range(size):
            ax = every[i][j]
            if j > i:
                ax.set_axis_off()
                continue
            style(ax)
            if i == j:
                ax.hist(table[:, i], bins=40, density=True, color=INK, alpha=0.6)
                low, high = ax.get_xlim()
                x = np.linspace(max(low, 1e-300), high, 200)
                prior = problem.priors[row]
                off = np.log(x / prior.value) / prior.spread
                ax.plot(
                    x, np.exp(-0.5 * off**2) / (x * prior.spread * np.sqrt(2 * np.pi)), color=GOT,
                    linewidth=1.2,
                )  # fmt: skip
                ax.set_yticks([])
                unit = result.parameters[row].unit
                ax.set_title(f"{row}, {unit}" if unit else row, fontsize=8, parse_math=False)
            else:
                ax.plot(shown[:, j], shown[:, i], ".", color=INK, markersize=1, alpha=0.4)
            ax.xaxis.set_major_locator(MaxNLocator(2))
            if i != j:
                ax.yaxis.set_major_locator(MaxNLocator(3))
            for axis in (ax.xaxis, ax.yaxis):
                axis.set_major_formatter(lambda value, _: plain(value, 4))
            ax.tick_params(labelsize=7)
            if i < size - 1:
                ax.tick_params(labelbottom=False)
            if j > 0 or i == j:
                ax.tick_params(labelleft=False)
    handles = [
        Line2D([], [], color=INK, linewidth=4, alpha=0.6, label="posterior"),
        Line2D([], [], color=GOT, label="prior"),
    ]
    legend(figure, handles, loc="upper right")
    figure.suptitle(f"{name_of(result.model)}: posterior of the parameters", fontsize=9)
    figure.tight_layout()
    return figure


def contacts(found: Identified) -> Figure:
    """Returns the plot of all touch-downs: measured force, force of the model, and residuals in
    standard deviations of the noise."""
    problem = found.problem
    touches = problem.data.touches
    figure, every = plt.subplots(
        2, len(touches), figsize=(1.2 + 2.6 * len(touches), 4.2), squeeze=False, sharex="col",
        sharey="row", height_ratios=(2, 1),
    )  # fmt: skip
    points = found.best[None]
    if found.sampled is not None:
        chosen = np.linspace(0, len(found.sampled.points) - 1, BAND_PLANTS).astype(int)
        points = np.concatenate([points, found.sampled.points[chosen]])
    force = problem.predict(points).force
    residuals = problem.force.scaled(force[:1])[0]
    for touch, begin, end in problem.force.parts:
        upper, lower = every[0][touch], every[1][touch]
        ms = 1e3 * touches[touch].force.at / problem.data.rate_hz
        own = force[:, begin:end]
        if len(points) > 1:
            low, high = np.quantile(own, (0.025, 0.975), axis=0)
            upper.fill_between(ms, low, high, color=GOT, alpha=0.3, linewidth=0, label="95 % band")
        upper.plot(
            ms, problem.force.values[begin:end], ".", color=INK, markersize=2.5, label="measured"
        )
        upper.plot(ms, own[0], color=GOT, linewidth=0.9, label="model")
        lower.plot(ms, residuals[begin:end], color=COLORS[2], linewidth=0.7)
        lower.axhline(0, color=FAINT, linewidth=0.6)
        start = 1e3 * touches[touch].onset / problem.data.rate_hz
        upper.set_xlim(max(0.0, start - 10), ms[-1])
        upper.set_title(touches[touch].name, fontsize=8, parse_math=False)
        lower.set_xlabel("time, ms", fontsize=8)
    every[0][0].set_ylabel("force, N", fontsize=8)
    every[1][0].set_ylabel("residual,\nstandard deviations", fontsize=8)
    for ax in every.flat:
        style(ax)
    legend(every[0][0], loc="lower right")
    figure.tight_layout()
    return figure
