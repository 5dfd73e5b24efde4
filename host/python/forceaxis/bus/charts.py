"""Draws charts of curves in a terminal with braille characters. Each character has two by four
dots.

The chart widgets of other packages were not used: they need three text lines of each chart for the
time axis, so that three charts would not fit into a terminal of 24 lines.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from rich.text import Text

from forceaxis.bus.capture_assembly import Samples

Span = tuple[float, float]  # smallest and largest value of a range: (low, high)
Line = tuple[Samples, Samples, str]  # a curve: (x values, y values, colour)

# DOTS[row, column] is the bit that sets this dot of a braille character.
# The braille characters begin at U+2800.
DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], np.uint8)


def draw(
    width: int, height: int, lines: Sequence[Line], x_span: Span, y_span: Span
) -> list[list[tuple[str, str]]]:
    """Draws curves with braille characters. `lines` has a tuple (x, y, colour) for each curve. The
    result has one list for each row of characters, with a pair (character, colour) for each
    character. The first curve is drawn over all other curves.

    NaN interrupts a curve. Points outside `x_span` and `y_span` are not drawn.
    """
    dots = np.zeros((height, width), np.uint8)
    colours = np.zeros((height, width), np.int8)
    columns, rows = 2 * width, 4 * height
    for number in range(len(lines) - 1, -1, -1):
        x, y, _ = lines[number]
        px, py = _pixels(np.asarray(x, float), np.asarray(y, float), x_span, y_span, columns, rows)
        if not px.size:
            continue
        cell = (py // 4, px // 2)
        np.bitwise_or.at(dots, cell, DOTS[py % 4, px % 2])
        colours[cell] = number + 1
    palette = ["", *(colour for _, _, colour in lines)]
    return [
        [(chr(0x2800 + d) if d else " ", palette[c]) for d, c in zip(*row, strict=True)]
        for row in zip(dots.tolist(), colours.tolist(), strict=True)
    ]


def _pixels(
    x: Samples, y: Samples, x_span: Span, y_span: Span, columns: int, rows: int
) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Returns the columns and the rows of the dots of one curve, which is drawn through the
    samples. Dots outside the chart are left out."""
    if not x.size:
        return np.zeros(0, int), np.zeros(0, int)
    fx = (x - x_span[0]) / (x_span[1] - x_span[0]) * (columns - 1)
    fy = (y_span[1] - y) / (y_span[1] - y_span[0]) * (rows - 1)
    good = np.isfinite(fx) & np.isfinite(fy)
    # Values far outside the chart are limited, because a line to them would need millions of dots.
    fx, fy = np.clip(fx, -columns, 2 * columns), np.clip(fy, -rows, 2 * rows)
    px = np.rint(np.where(good, fx, 0)).astype(int)
    py = np.rint(np.where(good, fy, 0)).astype(int)
    joined = good[:-1] & good[1:]
    steps = np.where(joined, np.maximum(abs(np.diff(px)), abs(np.diff(py))), 0)
    # The dots that connect the samples are computed first, and then the dots of the samples.
    which = np.repeat(np.arange(len(steps)), steps)
    part = np.arange(len(which)) - np.repeat(np.cumsum(steps) - steps, steps)
    share = part / np.maximum(steps[which], 1)
    lx = np.rint(px[which] + share * (px[which + 1] - px[which])).astype(int)
    ly = np.rint(py[which] + share * (py[which + 1] - py[which])).astype(int)
    ax, ay = np.concatenate([lx, px[good]]), np.concatenate([ly, py[good]])
    inside = (ax >= 0) & (ax < columns) & (ay >= 0) & (ay < rows)
    return ax[inside], ay[inside]


def span(arrays: Iterable[Samples], least: float = 1.0) -> Span:
    """Returns two round numbers (low, high). All finite values of the arrays are between them, and
    their difference is at least `least`."""
    values = [a[np.isfinite(a)] for a in arrays]
    values = [v for v in values if v.size]
    low = min((float(v.min()) for v in values), default=0.0)
    high = max((float(v.max()) for v in values), default=0.0)
    if high - low < least:
        middle = (low + high) / 2
        low, high = middle - least / 2, middle + least / 2
    step = _step((high - low) / 4)
    return float(np.floor(low / step) * step), float(np.ceil(high / step) * step)


def _step(rough: float) -> float:
    """Returns the smallest number of the sequence 1, 2, 5, 10, ... that is at least `rough`."""
    ten = 10.0 ** np.floor(np.log10(rough))
    return float(next(ten * k for k in (1, 2, 5, 10) if ten * k >= rough * 0.999))


def number(value: float, digits: int = 6) -> str:
    """Returns a number as a short text for a label of a chart."""
    return f"{value:.{digits}g}"


SCALE_WIDTH = 9  # width of the scale to the left of a chart, in characters


def panel(
    width: int,
    height: int,
    title: Text,
    lines: Sequence[Line],
    x_span: Span,
    style: str = "",
    least: float = 1.0,
) -> Text:
    """Returns a chart as a Text of `height` text lines. To the left of the chart are the title and
    the two end values of the scale. `lines`: curves as in draw(), which all have the same scale."""
    inner, rows = max(1, width - SCALE_WIDTH), max(1, height - 1)
    y_span = span([np.asarray(y, float) for _, y, _ in lines], least)
    text = title.copy()
    text.truncate(width, overflow="ellipsis")
    picture = draw(inner, rows, lines, x_span, y_span)
    for i, row in enumerate(picture):
        label = number(y_span[1]) if i == 0 else number(y_span[0]) if i == rows - 1 else ""
        text.append(f"\n{label:>{SCALE_WIDTH - 2}} ", style="dim")
        text.append("┤" if label else "│", style="dim")
        at = 0
        while at < len(row):
            end = at
            while end < len(row) and row[end][1] == row[at][1]:
                end += 1
            text.append("".join(c for c, _ in row[at:end]), style=row[at][1] or style)
            at = end
    return text


def time_axis(width: int, seconds: float, right: str = "now") -> Text:
    """Returns the text line below a chart. It states the times at the left end and in the middle of
    the chart, and the text `right` at the right end."""
    inner = max(1, width - SCALE_WIDTH)
    left = f"-{seconds:g} s"
    middle = f"-{seconds / 2:g} s"
    line = [" "] * inner
    for start, label in ((0, left), (inner // 2 - len(middle) // 2, middle)):
        line[start : start + len(label)] = label
    line[inner - len(right) :] = right
    return Text(" " * SCALE_WIDTH + "".join(line)[:inner], style="dim")
