"""Images inside an HTML page. Plots are data URIs, and small plots are inline SVG."""

import itertools

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from forceaxis import drawing
from forceaxis.experiments.run import Run

WIDTH, HEIGHT = 160, 56  # size of a thumbnail in pixels
# Number of steps along the line of a small plot. Each step shows its lowest and highest value.
STEPS = 80


def figure(drawn: Figure) -> Markup:
    """Returns a Matplotlib figure as a data URI, and closes the figure."""
    return Markup(drawing.uri(drawn))


def thumbnail(done: Run) -> Markup:
    """Returns a small plot of the main signal of a run as inline SVG. If the model has a force, the
    main signal is a force."""
    name = _shown(done)
    values = np.asarray(done.columns[name], float)[done.in_plot]
    held = done.result.metrics.held_force
    setpoint = held.setpoint_N if held and name.rpartition(".")[2] in FORCES else None
    low, high = values.min(), values.max()
    if setpoint is not None:
        low, high = min(low, setpoint), max(high, setpoint)

    def height(value: float) -> float:
        return float(HEIGHT - 3 - (HEIGHT - 6) * (value - low) / ((high - low) or 1))

    edges = np.unique(np.linspace(0, len(values), STEPS + 1).astype(int))
    points = []
    for i, (a, b) in enumerate(itertools.pairwise(edges)):
        x = WIDTH * i / max(len(edges) - 2, 1)
        part = values[a:b]
        ends = {part.argmin(): part.min(), part.argmax(): part.max()}
        points += [f"{x:.0f},{height(ends[k]):.1f}" for k in sorted(ends)]
    line = ""
    if setpoint is not None:
        y = f"{height(setpoint):.1f}"
        line = f'<path class="setpoint" d="M0 {y}H{WIDTH}"/>'
    return Markup(
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" preserveAspectRatio="none">'
        f"<title>{{}} over time</title>{line}"
        f'<polyline points="{" ".join(points)}"/></svg>'
    ).format(name)


FORCES = ("force", "spring_force")  # Signals whose names have these endings are forces in N.


def _shown(done: Run) -> str:
    """Returns the trace column of the signal that the small plot of a run shows."""
    there = [n for row in done.plot.rows for n in row if n in done.columns]
    forces = [n for n in there if n.rpartition(".")[2] in FORCES]
    return next(iter([*forces, *(n for n in there if n == "adc0"), *there]), "adc0")
