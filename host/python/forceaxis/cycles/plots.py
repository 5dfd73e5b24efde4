"""Draws the plot of one pressed part: force over travel and over time. The plot also shows the
phases, and the windows, envelopes and bounds of the evaluation elements."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from forceaxis.cycles.part import Curve, PartPicture, PartRun, phase_samples, short
from forceaxis.cycles.program import Element
from forceaxis.drawing import AREA, COLORS, FAINT, INK, VERDICT, legend, style
from forceaxis.words import plain

MM = 1e3
GOOD_COLOUR, BAD_COLOUR = VERDICT["stable"], VERDICT["unstable"]


def part(done: PartRun) -> Figure:
    """Returns the plot of a simulated part, whose simulation must have a curve."""
    assert done.curve is not None
    found = done.result
    return draw(
        PartPicture(
            found.title, found.state, done.program, found.elements, found.phases, done.curve
        )
    )


def draw(done: PartPicture) -> Figure:
    """Returns the plot of a part with two diagrams. The upper one shows the evaluation elements
    over travel, and the lower one those over time."""
    figure, (over_travel, over_time) = plt.subplots(2, 1, figsize=(7.2, 6.4), height_ratios=(3, 2))
    for ax, unit in ((over_travel, "travel, mm"), (over_time, "time, s")):
        style(ax)
        ax.set_xlabel(unit)
        ax.set_ylabel("force, N")
    _draw_curve(over_travel, done)
    _draw_phases(over_time, done)
    verdicts = {figure.name: figure.verdict for figure in done.elements}
    for element in done.program.elements:
        ax = over_time if element.over == "time" else over_travel
        _draw_element(ax, done, element, verdicts.get(element.name, ""))
    for ax in (over_travel, over_time):
        ax.margins(y=0.12)
    legend(over_travel, loc="upper left")
    figure.suptitle(
        f"{done.title}: {done.state}", fontsize=10, x=0.02, ha="left",
        color=GOOD_COLOUR if done.state == "good" else BAD_COLOUR, parse_math=False,
    )  # fmt: skip
    figure.tight_layout(rect=(0, 0, 1, 0.98))
    plt.close(figure)
    return figure


def _colour(phase: int) -> str:
    return COLORS[phase % len(COLORS)]


def _draw_curve(ax: Axes, done: PartPicture) -> None:
    """Draws force over travel, beginning shortly before the contact. Each phase has its own
    colour."""
    curve = done.curve
    for number, phase in enumerate(done.program.phases):
        inside = curve.phase == number
        if inside.any():
            # The line of a phase ends at the first sample of the next phase, without a gap.
            inside[1:] |= inside[:-1]
            force = np.where(inside, curve.force_N, np.nan)
            ax.plot(
                curve.travel_m * MM, force, color=_colour(number), linewidth=1.2,
                label=short(phase.name), zorder=3,
            )  # fmt: skip
    last = float(curve.travel_m.max()) * MM
    ax.set_xlim(-0.15 * max(last, 1e-3), 1.08 * max(last, 1e-3))


def _draw_phases(ax: Axes, done: PartPicture) -> None:
    """Draws force over time. The phases are coloured areas."""
    curve = done.curve
    ax.plot(curve.time_s, curve.force_N, color=INK, linewidth=1.0, zorder=3)
    numbers = {phase.name: i for i, phase in enumerate(done.program.phases)}
    for span in done.phases:
        colour = _colour(numbers[span.name])
        ax.axvspan(span.begin_s, span.end_s, color=colour, alpha=0.12, linewidth=0)
        ax.text(
            (span.begin_s + span.end_s) / 2, 1.02, short(span.name), fontsize=7, color=colour,
            ha="center", va="bottom", transform=ax.get_xaxis_transform(), parse_math=False,
        )  # fmt: skip
    ax.set_xlim(float(curve.time_s[0]), float(curve.time_s[-1]))


def _draw_element(ax: Axes, done: PartPicture, element: Element, verdict: str) -> None:
    """Draws the window, the limit curves or the bounds of one evaluation element, with its name and
    verdict."""
    curve = done.curve
    inside = phase_samples(element, done.program, curve)
    if not inside.any() and element.over == "time":
        return
    over_time = element.over == "time"
    begin = float(curve.time_s[inside][0]) if over_time else 0.0
    scale = 1.0 if over_time else MM
    colour = GOOD_COLOUR if verdict == "good" else BAD_COLOUR
    x_all = curve.time_s if over_time else curve.travel_m
    x = (x_all[inside] if inside.any() else x_all) - begin
    x_from = float(x.min()) if element.x_from is None else element.x_from
    x_to = float(x.max()) if element.x_to is None else element.x_to
    left, right = (begin + x_from) * scale, (begin + x_to) * scale
    if element.kind == "window" and element.least is not None and element.most is not None:
        height = element.most - element.least
        ax.add_patch(
            Rectangle((left, element.least), right - left, height, facecolor=AREA["stable"],
                      edgecolor=colour, alpha=0.6, zorder=1)
        )  # fmt: skip
        _label(ax, (left, right), element.most, element, verdict, colour)
    elif element.kind == "envelope":
        for points in (element.lower, element.upper):
            at = np.linspace(x_from, x_to, 200)
            force = np.interp(at, [p[0] for p in points], [p[1] for p in points])
            ax.plot((begin + at) * scale, force, color=colour, linewidth=1.4, zorder=4)
        _label(ax, (left, right), float(force[0]), element, verdict, colour)
    elif element.unit in ("m", "s") and element.level is not None:
        _draw_crossing(ax, element, begin, scale, verdict, colour)
    elif element.unit == "N":
        for bound in (element.least, element.most):
            if bound is not None:
                ax.plot([left, right], [bound, bound], color=colour, linewidth=1.4, zorder=4)
        top_bound = element.most if element.most is not None else element.least
        if top_bound is not None:
            _label(ax, (left, right), top_bound, element, verdict, colour)
    else:
        _shade(ax, curve, element, inside, verdict, colour)


def _draw_crossing(
    ax: Axes, element: Element, begin: float, scale: float, verdict: str, colour: str
) -> None:
    """Draws a bar between the two bounds of a crossing. The curve must cross a level of force
    within this bar."""
    level = element.level
    assert level is not None
    edges = [e for e in (element.least, element.most) if e is not None]
    places = [(begin + edge) * scale for edge in edges]
    ax.plot(places, [level] * len(places), color=colour, linewidth=1.4, marker="|", markersize=11,
            zorder=4)  # fmt: skip
    if places:
        _label(ax, (places[0], places[-1]), level, element, verdict, colour, -6)


def _shade(
    ax: Axes, curve: Curve, element: Element, inside: np.ndarray, verdict: str, colour: str
) -> None:
    """Shades the area below the curve for an evaluation element of the kind "work", and writes the
    name of this element. Does nothing for an element of another kind."""
    if element.kind != "work" or not inside.any():
        return
    x = curve.travel_m[inside] * MM if element.over != "time" else curve.time_s[inside]
    force = curve.force_N[inside]
    ax.fill_between(x, 0, force, color=FAINT, alpha=0.25, linewidth=0, zorder=0)
    middle = len(x) // 2
    at = float(x[middle])
    _label(ax, (at, at), float(force[middle]) / 3, element, verdict, colour)


def _label(
    ax: Axes,
    ends_x: tuple[float, float],
    y: float,
    element: Element,
    verdict: str,
    colour: str,
    offset: float = 3,
) -> None:
    """Writes name, bounds and verdict of an evaluation element above a mark in the plot. With a
    negative `offset`, in points, the text is below the mark. `ends_x`: both ends of the mark."""
    text = short(element.name)
    if not element.is_shape:
        scale, unit = (MM, "mm") if element.unit == "m" else (1.0, element.unit)
        ends = [b for b in (element.least, element.most) if b is not None]
        if ends:
            text += f" {' to '.join(plain(b * scale, 4) for b in ends)} {unit}"
    if verdict and verdict != "good":
        text += f": {verdict}"
    low, high = ax.get_xlim()
    is_right = ends_x[0] > low + 0.6 * (high - low)
    ax.annotate(
        text, (ends_x[1] if is_right else ends_x[0], y), xytext=(-2 if is_right else 2, offset),
        textcoords="offset points", fontsize=7, color=colour, ha="right" if is_right else "left",
        va="bottom" if offset > 0 else "top", parse_math=False, zorder=5,
    )  # fmt: skip
