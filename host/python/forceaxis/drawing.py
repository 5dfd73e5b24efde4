"""The common style of all plots and pages (colours, axes, legends, titles, numbers), and functions
that write plots to files."""

import base64
import io
import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Literal, TypedDict, Unpack

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import matplotlib.ticker
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.legend import Legend

from forceaxis.errors import ParameterError
from forceaxis.words import plain

INK = "#1b3a5b"
WANTED, GOT = "#3f7f5f", "#c0562b"
COLORS = [INK, GOT, WANTED, "#8a5fa8", "#b08a00", "#5d6874"]
DASHES = ["-", "--", "-.", (0, (1, 1.5)), (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2))]
FAINT = "#8a95a0"
GRID = "#c8d0d8"
THIN = {"linewidth": 0.9}

# VERDICT has the colour of lines and marks for each verdict. AREA has the colours of areas.
VERDICT = {
    "stable": "#2f8f78",
    "unstable": GOT,
    "not_met": "#b08a00",
    "not_held": "#b08a00",
    "never_in_contact": "#8a8a8a",
    "": "#777777",
}
AREA = {
    "stable": "#b9d8cf",
    "unstable": "#f0c3a8",
    "not_met": "#ecd98f",
    "not_held": "#ecd98f",
    "never_in_contact": "#f6e6c9",
    "failed": "#c9c9c9",
}

SUFFIXES = (".png", ".svg", ".pdf")
DPI = 150
# Largest size in bytes of an SVG image in a page. A plot with a larger one is written as PNG.
SVG_BYTES_MAX = 400_000
# Replacements for characters with a special meaning in an HTML attribute or a data URI.
URI_ESCAPES = str.maketrans({"%": "%25", "#": "%23", '"': "%22", "&": "%26", "\n": " ", "\r": " "})


def style(ax: Axes) -> None:
    """Sets the style of the axes of a plot: light grid, no frame, small characters."""
    ax.set_axisbelow(True)
    ax.grid(True, linewidth=0.3, color=GRID)
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(which="both", labelsize=8)
    for axis in (ax.xaxis, ax.yaxis):
        axis.label.set_fontsize(8)
        axis.label.set_parse_math(False)
    ax.set_prop_cycle(color=COLORS)


class LineStyle(TypedDict, total=False):
    """Arguments of Matplotlib for the style of a curve."""

    color: str
    linewidth: float
    linestyle: Literal["--"]
    alpha: float
    marker: str
    markersize: float
    label: str
    zorder: float


class LegendOptions(TypedDict, total=False):
    """Arguments of Matplotlib for the layout of the legend of a plot."""

    loc: Literal[
        "best", "lower left", "lower right", "outside lower center", "upper left", "upper right"
    ]
    bbox_to_anchor: tuple[float, float]
    ncols: int
    columnspacing: float
    handletextpad: float
    markerscale: float


def legend(
    where: Axes | Figure, handles: Sequence[Artist] | None = None, **layout: Unpack[LegendOptions]
) -> Legend:
    """Adds a small legend without a frame to axes or to a Matplotlib figure. `handles`: the drawn
    objects that the legend lists. By default, the legend lists all drawn objects with a label."""
    if handles is None:
        return where.legend(fontsize=7, frameon=False, **layout)
    return where.legend(handles=handles, fontsize=7, frameon=False, **layout)


def plain_ticks(axis: Axis) -> None:
    """Labels a logarithmic axis of a plot with plain numbers, not with powers of ten. An axis of
    less than two decades has labels at 1, 2 and 5 of each decade."""
    low, high = sorted(axis.get_view_interval())
    short = high < 100 * low
    axis.set_major_locator(matplotlib.ticker.LogLocator(subs=(1, 2, 5) if short else (1,)))
    axis.set_major_formatter(lambda value, _: plain(value))
    axis.set_minor_formatter(matplotlib.ticker.NullFormatter())


def decibels(ax: Axes, unit: str = "") -> Axes:
    """Adds a scale in dB on the right side of a plot with a logarithmic axis. 0 dB is 1 `unit`. The
    limits of the axis must not change after this call."""
    right = ax.twinx()
    low, high = (20 * np.log10(edge) for edge in ax.get_ylim())
    right.set_ylim(low, high)
    step = next(s for s in (2, 5, 10, 20, 40, 80, 160) if (high - low) / s <= 6 or s == 160)
    right.set_yticks(np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step)
    right.spines[["top", "left", "bottom"]].set_visible(False)
    right.tick_params(which="both", labelsize=8)
    right.set_ylabel(f"dB re 1 {unit}" if unit else "dB", fontsize=8, parse_math=False)
    return right


def name_of(file: Path | str) -> str:
    """Returns the name under which a plot shows a model file. This is the name of the file, or the
    name of its folder if the file is called "model"."""
    file = Path(file)
    return file.resolve().parent.name if file.stem == "model" else file.stem


def check_name(path: Path | str | None) -> None:
    """Raises InputError if a plot cannot be written to a file with the name `path`, because of its
    suffix. A caller checks the name before the computation."""
    if path is not None and Path(path).suffix not in SUFFIXES:
        raise ParameterError("out", f"{path}: expected a file ending in {', '.join(SUFFIXES)}")


def save(figure: Figure, path: Path | str, kind: str | None = None, dpi: float = DPI) -> None:
    """Writes a plot to a file. `kind` is the file format, by default the suffix of `path`. Files of
    equal plots have equal bytes."""
    if kind is None:
        check_name(path)
        kind = Path(path).suffix[1:]
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    with plt.rc_context({"svg.hashsalt": "forceaxis"}):
        figure.savefig(path, format=kind, dpi=dpi, metadata=metadata)


def short_svg(svg: str) -> str:
    """Shortens the SVG text of a Matplotlib figure without a change of its appearance. The shorter
    text has no metadata, has short paths, and defines each style once, as a class."""
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r">\s+<", "><", svg)
    svg = re.sub(r' d="([MLz\d.\s-]+)"', lambda path: f' d="{short_path(path[1])}"', svg)
    used = set(re.findall(r"#([\w-]+)", svg))
    svg = re.sub(r' id="([^"]*)"', lambda name: name[0] if name[1] in used else "", svg)
    styles: dict[str, str] = {}
    svg = re.sub(
        r' style="([^"]*)"',
        lambda style: f' class="{styles.setdefault(style[1], f"s{len(styles)}")}"',
        svg,
    )
    rules = "".join(f".{name}{{{style}}}" for style, name in styles.items())
    svg = svg.replace("</style>", f"{rules}</style>", 1)
    return re.sub(
        r"=\"([^\"'<>]*)\"", r"='\1'", svg
    )  # a double quotation mark would become three characters in a data URI


def short_path(path: str) -> str:
    """Returns a shorter text of an SVG path that consists of the commands M, L and z. Coordinates
    are rounded to tenths of a point and are relative to the previous point. Rounding errors do not
    add up."""
    found: list[str] = []
    last = (0, 0)
    drawn = ""  # last drawing command in the shortened text of the SVG path
    for command, x, y in re.findall(r"([ML]) ([-.\d]+) ([-.\d]+)|z", path):
        if not command:
            found.append("z")
            drawn = ""
            continue
        point = (round(10 * float(x)), round(10 * float(y)))
        if command == "M":
            found.append("M" + _numbers(point))
        elif point != last:
            numbers = _numbers((point[0] - last[0], point[1] - last[1]))
            joined = drawn == "l" and numbers.startswith("-")
            found.append(numbers if joined else (" " if drawn == "l" else "l") + numbers)
        else:
            continue
        last, drawn = point, "l" if command == "L" else ""
    return "".join(found)


def _numbers(point: tuple[int, int]) -> str:
    """Returns the text of two coordinates for SVG, without unnecessary characters. The coordinates
    are in tenths of a point."""
    x, y = (f"{value / 10:.1f}".removesuffix(".0") for value in point)
    x, y = (re.sub(r"^(-?)0(?=\.)", r"\1", value) for value in (x, y))
    return x + ("" if y.startswith("-") else " ") + y


def uri(figure: Figure) -> str:
    """Returns a plot as a data URI for an HTML page, and closes the Matplotlib figure. The plot is
    transparent, so that it suits a page with a light or a dark background."""
    text, image = io.StringIO(), io.BytesIO()
    with plt.rc_context({"svg.hashsalt": "forceaxis", "svg.fonttype": "none"}):
        figure.savefig(text, format="svg", metadata={"Date": None}, transparent=True)
    plt.close(figure)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    # Coordinates in the SVG are rounded to a hundredth of a point.
    # Numbers in texts of the plot are not rounded.
    svg = re.sub(r"<[^>]*>", lambda tag: re.sub(r"(?<=\d\.\d\d)\d+", "", tag[0]), svg)
    svg = short_svg(svg)
    if len(svg) <= SVG_BYTES_MAX:
        return "data:image/svg+xml," + svg.translate(URI_ESCAPES)
    figure.savefig(image, format="png", dpi=DPI, transparent=True)
    return "data:image/png;base64," + base64.b64encode(image.getvalue()).decode()


def page_style() -> str:
    """Returns the style sheet (CSS) that all HTML pages of the package have in common."""
    return resources.files("forceaxis").joinpath("page.css").read_text(encoding="utf-8")


def finish(figure: Figure, ax: Axes, title: str) -> None:
    """Sets title and layout of a plot, and closes the plot in pyplot, which would otherwise keep
    it."""
    ax.set_title(title, fontsize=9, loc="left", color=INK, parse_math=False)
    figure.tight_layout()
    plt.close(figure)
