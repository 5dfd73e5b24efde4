"""Shared by all figures: colours, axes in the thesis's form, writing to files."""

import io
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt

from forceaxis._core import InputError

INK = "#1b3a5b"


WANTED, GOT = "#3f7f5f", "#c0562b"


THIN = {"linewidth": 0.9}


def style(ax):
    """Light grid, no box."""
    ax.grid(True, linewidth=0.3, color="#c8d0d8")
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(which="both", labelsize=8)
    ax.set_prop_cycle(color=[INK, "#c0562b", "#3f7f5f", "#8a5fa8"])


COLORS = [INK, GOT, "#3f7f5f", "#8a5fa8", "#b08a00", "#5d6874"]


DASHES = ["-", "--", "-.", (0, (1, 1.5)), (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2))]


FAINT = "#8a95a0"


SUFFIXES = (".png", ".svg", ".pdf")


def check_name(path):
    """Refuse a file to which no figure can be written; to be called before the computation."""
    if path is not None and Path(path).suffix not in SUFFIXES:
        raise InputError(f"--out: {path}: expected a file ending in {', '.join(SUFFIXES)}")


def save(figure, path):
    """Write a figure as .png, .svg or .pdf, by the suffix of `path`; equal figures, equal bytes."""
    check_name(path)
    metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(Path(path).suffix)
    with plt.rc_context({"svg.hashsalt": "forceaxis"}):
        figure.savefig(path, dpi=130, metadata=metadata)


def small_png(figure, dpi=85):
    """The figure as the bytes of a PNG with a palette of 48 colours: a few kB."""
    from PIL import Image

    full, small = io.BytesIO(), io.BytesIO()
    figure.savefig(full, format="png", dpi=dpi)
    image = Image.open(full).convert("RGB")
    image.quantize(48, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
        small, "PNG", optimize=True
    )
    return small.getvalue()


def finish(figure, ax, title):
    """Title, layout; the figure leaves pyplot's list."""
    ax.set_title(title, fontsize=9, loc="left", color=INK, parse_math=False)
    figure.tight_layout()
    plt.close(figure)
