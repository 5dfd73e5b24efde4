"""Bode, Nyquist and root-locus plots, pole-zero arrays and mode shapes, in the thesis's form.

Every plot is made of data that can be looked at without drawing: `Curve`, `Locus`, `Array`. The
verbs print them with --json; `thesis_figures` lists what the text defines.
"""

import io
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D

from forceaxis._core import InputError
from forceaxis.experiments.plots import GOT, INK, style
from forceaxis.linear import limits as loop_verbs
from forceaxis.linear import loops
from forceaxis.linear import system as linear

COLORS = [INK, GOT, "#3f7f5f", "#8a5fa8", "#b08a00", "#5d6874"]
DASHES = ["-", "--", "-.", (0, (1, 1.5)), (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2))]
FAINT = "#8a95a0"
NYQUIST_HZ = (0.05, 2000.0)
SUFFIXES = (".png", ".svg", ".pdf")


def check_name(path):
    """Refuse a file that no figure can be written to, before the work."""
    if path is not None and Path(path).suffix not in SUFFIXES:
        raise InputError(f"--out: {path}: expected a file ending in {', '.join(SUFFIXES)}")


def save(figure, path):
    """Write a figure as .png, .svg or .pdf, by the name of `path`; the same one, the same bytes."""
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


# --- frequency responses -------------------------------------------------------------------------


def phase_deg(frequency_hz, response):
    """Phase in degrees without jumps of 360, starting where the low-frequency slope puts it.

    A gain that is flat at the lowest frequencies starts at 0 (-180 if negative), one with an
    integrator at -90, one that rises with the frequency at +90.
    """
    phase = np.degrees(np.unwrap(np.angle(response)))
    if len(phase) < 2:
        return phase
    size = np.log(np.maximum(np.abs(response[:2]), 1e-300))
    slope = (size[1] - size[0]) / np.log(frequency_hz[1] / frequency_hz[0])
    turns = (90 * round(slope) - phase[0]) / 360
    return phase + 360 * np.ceil(turns - 0.55)  # a negative gain, nearly a tie, counts as lag


def grid_hz(low_hz, high_hz, roots=(), points=400):
    """Frequencies, Hz: evenly in the logarithm, and closer together beside lightly damped roots.

    roots: poles and zeros in 1/s. The refinement is in units of each root's own width, so that
    neither a peak nor a turn of the phase falls between two frequencies.
    """
    grid = [np.geomspace(low_hz, high_hz, points)]
    widths = np.concatenate([[0.0], np.geomspace(0.1, 60, 32)])
    widths = np.concatenate([-widths[::-1], widths])
    for root in roots:
        natural, width = abs(root.imag) / (2 * np.pi), max(abs(root.real), 1e-6 * abs(root))
        if low_hz < natural < high_hz and width < 0.3 * abs(root):
            grid.append(natural + widths * width / (2 * np.pi))
    every = np.unique(np.concatenate(grid))
    return every[(every >= low_hz) & (every <= high_hz)]


@dataclass(frozen=True)
class Curve:
    """A frequency response: complex `response` at `frequency_hz`."""

    label: str
    frequency_hz: np.ndarray
    response: np.ndarray
    unit: str = ""  # of the response

    @property
    def magnitude(self):
        """Amplitude ratio, in `unit`."""
        return np.abs(self.response)

    @property
    def phase_deg(self):
        """Unwrapped phase; see `phase_deg`."""
        return phase_deg(self.frequency_hz, self.response)

    def summary(self):
        """What --json prints."""
        return {
            "label": self.label,
            "unit": self.unit,
            "frequency_hz": self.frequency_hz.tolist(),
            "magnitude": self.magnitude.tolist(),
            "phase_deg": self.phase_deg.tolist(),
        }


def curve(system, label, span_hz, unit="", points=400):
    """The response of a one-input, one-output System over span_hz = (low, high)."""
    low, high = span_hz
    if system.dt is not None:
        high = min(high, 0.5 / system.dt)
    roots = poles_s(system)
    if system.has_path():
        zeros = system.zeros()
        if system.dt is not None:
            zeros = logarithm(zeros, system.dt)
        roots = np.concatenate([roots, zeros])
    roots = roots[np.isfinite(roots)]
    frequency = grid_hz(low, high, roots, points)
    return Curve(label, frequency, system.response(frequency), unit)


def model_curve(
    model, label, output="reading", input="drive.command", span_hz=(0.5, 500.0), settings=None,
    timing="continuous", drive=True, free=False, modes=None,
):  # fmt: skip
    """A model's open-loop response from an input to an output, in SI units, as a Curve."""
    input = "drive.force" if not drive and input == "drive.command" else input
    system = linear.linearise(model, (input,), (output,), settings, modes, free, drive)
    if not system.has_path():
        raise InputError(
            f"{linear.find_model(model)}: expected a path from {input} to {output}; there is none"
        )
    if timing != "continuous":
        system = system.sampled(loops.TIMINGS.index(timing) - 1)
    return curve(system, label, span_hz, unit_of(model, input, output, settings))


def unit_of(model, input, output, settings=None):
    """Unit of output over input, "N/V"."""
    facts = linear.facts(model, settings)
    if output == "reading":
        output = facts["reading"]["signal"]
    above = facts["signals"].get(output, "count")  # else an ADC or the encoder
    below = "V" if input in ("drive.command", "drive.tach") else "N"
    return "" if above == below else f"{above}/{below}"


def bode(curves, title="", ylabel="amplitude", phase_only=False, size=(5.6, 4.4)):
    """Figure of amplitude and phase over frequency; `phase_only` leaves out the amplitude."""
    rows = 1 if phase_only else 2
    figure, axes = plt.subplots(rows, 1, sharex=True, figsize=size, squeeze=False)
    for i, c in enumerate(curves):
        look = {"color": COLORS[i % 6], "linestyle": DASHES[i % 6], "linewidth": 1.1}
        if not phase_only:
            axes[0, 0].loglog(c.frequency_hz, c.magnitude, label=c.label, **look)
        axes[-1, 0].semilogx(c.frequency_hz, c.phase_deg, label=c.label, **look)
    for ax in axes[:, 0]:
        style(ax)
        ax.margins(x=0)
    phase = axes[-1, 0]
    low, high = phase.get_ylim()
    middle, reach = (low + high) / 2, max(high - low, 60.0) / 2
    low, high = middle - reach, middle + reach
    step = next(s for s in (15, 30, 45, 90, 180, 360, 720) if 2 * reach / s <= 7 or s == 720)
    ticks = np.arange(np.floor(low / step), np.ceil(high / step) + 1) * step
    phase.set_yticks(ticks)
    phase.set_ylim(ticks[0], ticks[-1])
    if ticks[0] < -180 < ticks[-1]:
        phase.axhline(-180, color=FAINT, linewidth=0.8, linestyle=":", zorder=1)
    phase.set_ylabel("phase, degrees", fontsize=8)
    phase.set_xlabel("frequency, Hz", fontsize=8)
    phase.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    if not phase_only:
        low, high = axes[0, 0].get_ylim()
        if high < 10 * low:  # a decade at least, so that what is flat looks flat
            wider = np.sqrt(10 * low / high)
            axes[0, 0].set_ylim(low / wider, high * wider)
        axes[0, 0].yaxis.set_minor_formatter(plt.NullFormatter())
        units = dict.fromkeys(c.unit for c in curves)
        axes[0, 0].set_ylabel(f"{ylabel}, {' or '.join(units)}".rstrip(", "), fontsize=8)
    if len(curves) > 1:
        axes[0, 0].legend(fontsize=7, frameon=False, loc="best")
    axes[0, 0].set_title(title, fontsize=9, loc="left", color=INK, parse_math=False)
    tall = size[1]
    figure.subplots_adjust(0.125, 0.46 / tall, 0.965, 1 - 0.3 / tall, hspace=0.12)
    plt.close(figure)
    return figure


def finish(figure, ax, title):
    """Title, layout; the figure leaves pyplot's list."""
    ax.set_title(title, fontsize=9, loc="left", color=INK, parse_math=False)
    figure.tight_layout()
    plt.close(figure)


def nyquist(system, gain, title="", label="", size=(4.8, 4.6)):
    """Figure of gain x the open loop, both signs of frequency, around the point -1.

    system: the loop's `open`; gain in its unit. The frame shows the unit circle and as much of the
    curve as fits within 2.5.
    """
    plot = curve(system, label, NYQUIST_HZ, points=1200)
    values = gain * plot.response
    figure, ax = plt.subplots(figsize=size)
    style(ax)
    turn = np.linspace(0, 2 * np.pi, 200)
    ax.plot(np.cos(turn), np.sin(turn), color=FAINT, linewidth=0.7, linestyle=":")
    ax.plot(values.real, values.imag, color=INK, linewidth=1.1, label="f > 0")
    ax.plot(values.real, -values.imag, color=INK, linewidth=0.7, linestyle="--", label="f < 0")
    ax.plot([-1], [0], marker="+", color=GOT, markersize=10, markeredgewidth=1.6)
    ax.annotate(
        "-1", (-1, 0), (-4, 5), textcoords="offset points", fontsize=8, color=GOT, ha="right"
    )
    span = min(max(1.6, 1.1 * np.abs(values).max()), 2.5)
    for hz in decades(plot.frequency_hz, values, span):
        at = int(np.argmin(np.abs(plot.frequency_hz - hz)))
        point = values[at]
        ax.plot(point.real, point.imag, "o", color=INK, markersize=2.5)
        out = point / abs(point) * 9
        ax.annotate(
            f"{hz:g} Hz", (point.real, point.imag), (out.real, out.imag),
            textcoords="offset points", fontsize=7, color=INK, ha="center", va="center",
        )  # fmt: skip
    ax.set_xlim(-span, span)
    ax.set_ylim(-span, span)
    ax.set_aspect("equal")
    ax.set_xlabel("real part", fontsize=8)
    ax.set_ylabel("imaginary part", fontsize=8)
    ax.legend(fontsize=7, frameon=False, loc="upper left")
    finish(figure, ax, title)
    return figure


def decades(frequency_hz, values, span):
    """Frequencies to write beside a Nyquist curve: round ones, inside the frame, apart."""
    shown = []
    for hz in (1, 2, 5, 10, 20, 30, 50, 70, 100, 200, 500):
        if not frequency_hz[0] < hz < frequency_hz[-1]:
            continue
        value = np.interp(hz, frequency_hz, values.real) + 1j * np.interp(
            hz, frequency_hz, values.imag
        )
        far = all(abs(value - other) > 0.16 * span for _, other in shown)
        if 0.08 * span < abs(value) and max(abs(value.real), abs(value.imag)) < 0.92 * span and far:
            shown.append((hz, value))
    return [hz for hz, _ in shown]


# --- root loci and pole-zero arrays --------------------------------------------------------------


@dataclass(frozen=True)
class Array:
    """Poles and zeros, 1/s, of one transfer function."""

    label: str
    poles: np.ndarray
    zeros: np.ndarray

    def summary(self):
        """What --json prints: 1/s."""
        return {
            "label": self.label,
            "poles": pairs(self.poles),
            "zeros": pairs(self.zeros),
        }


def pairs(roots):
    """Roots as [real, imaginary] for JSON, null for one at infinity."""
    return [[float(s.real), float(s.imag)] if np.isfinite(s) else None for s in roots]


def array(system, label=""):
    """Poles and zeros of a one-input, one-output System, in 1/s."""
    zeros = system.zeros().astype(complex)
    if system.dt is not None:
        zeros = logarithm(zeros, system.dt)
    poles = poles_s(system)
    return Array(label, poles[np.isfinite(poles)], zeros[np.isfinite(zeros)])


def logarithm(z, dt):
    """log(z) / dt, 1/s; not finite for z = 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(z.astype(complex)) / dt


def poles_s(system):
    """Poles in 1/s; of z = 0 not finite."""
    return system.poles() if system.dt is None else logarithm(system.poles(), system.dt)


@dataclass(frozen=True)
class Locus:
    """Closed-loop poles over the gain: `branches` (gains, poles) in 1/s, and where they cross."""

    label: str
    gains: np.ndarray
    branches: np.ndarray
    ends: Array  # open-loop poles and zeros
    crossings: list  # loops.Crossing of every gain at which a pole is on the boundary
    limit: object  # loops.Limit
    unit: str  # of the gain
    codes: float | None  # firmware gain of one unit
    span_hz: float
    at_gain: np.ndarray = ()  # closed-loop poles at a gain asked for, 1/s

    def summary(self):
        """What --json prints: roots in 1/s as [real, imaginary], not finite ones as null."""
        return {
            "label": self.label,
            "unit": self.unit,
            "gains": self.gains.tolist(),
            "branches": [pairs(branch) for branch in self.branches.T],
            **{k: v for k, v in self.ends.summary().items() if k != "label"},
            "critical_gain": self.limit.gain,
            "frequency_hz": self.limit.frequency_hz,
            "crossings": [
                {"gain": c.gain, "frequency_hz": c.frequency_hz, "direction": c.direction}
                for c in self.crossings
            ],
        }


def span_of(ends, critical_hz):
    """Half-width, Hz, of a frame that accentuates the structural dynamics.

    It holds the crossing and the lightly damped (below .3) poles and zeros up to three times its
    frequency; the motor's electrical poles are beyond it, as in 4.3.
    """
    roots = np.concatenate([ends.poles, ends.zeros])
    light = roots[(np.abs(roots.real) < 0.3 * np.abs(roots)) & (np.abs(roots) > 0)]
    natural = np.abs(light) / (2 * np.pi)
    if critical_hz:
        return 1.35 * max([critical_hz, *natural[natural < 3 * critical_hz]])
    natural = natural if len(natural) else np.abs(roots) / (2 * np.pi)
    return 1.35 * float(natural.max(initial=1.0))


@np.errstate(divide="ignore", invalid="ignore")  # a branch from z = 0 starts at -infinity
def locus(loop, label="", span_hz=None, gain=None):
    """The root locus of a `loops.Loop`, drawn finely inside a frame of span_hz (default: span_of).

    gain: where to mark the closed-loop poles, in the loop's unit.
    """
    if span_hz is not None and not (np.isfinite(span_hz) and span_hz > 0):
        raise InputError(f"--span-hz: expected a number > 0, got {span_hz:g}")
    ends = array(loop.open, label)
    limit, crossings = loop.limit(), loop.crossings()
    span = span_hz or span_of(ends, limit.frequency_hz)
    # Inside the frame the largest gain is that of the frame's edge: 1 / |L| on it.
    edge = 2 * np.pi * span
    side = np.linspace(0, 1, 24)
    around = np.concatenate(
        [edge * (0.5 + 1j * side), edge * (-1 + 1j * side), edge * (-1 + 1.5 * side + 1j)]
    )
    at = around if loop.open.dt is None else np.exp(around * loop.open.dt)
    with np.errstate(divide="ignore"):
        needed = 1 / np.abs(loop.open.at(at))
    high = 1.5 * float(np.sort(needed[np.isfinite(needed)])[-3])
    shown = [c.gain for c in crossings if c.frequency_hz is not None and c.frequency_hz < span]
    high = max([high, 3 * (limit.gain or 0), *(1.2 * k for k in shown if k < 1e6 * high)])
    low = 1e-5 * min([high, *shown])
    gains = np.concatenate([[0.0], np.geomspace(low, high, 150), shown])
    gains = np.unique(gains[gains <= high])
    for _ in range(4):  # finer where a branch moves far
        branches = loop.locus(gains)
        inside = np.abs(branches) < 1.6 * edge
        moved = np.abs(np.diff(branches, axis=0))
        far = (moved > edge / 45) & (inside[1:] | inside[:-1])
        rough = np.flatnonzero(far.any(axis=1))
        if not len(rough) or len(gains) > 1500:
            break
        middle = (gains[rough] + gains[rough + 1]) / 2
        gains = np.sort(np.concatenate([gains, middle]))
    branches = loop.locus(gains)
    marked = loop.closed_poles(gain) if gain is not None else np.zeros(0)
    return Locus(
        label, gains, branches, ends, crossings, limit, loop.unit, loop.codes_per_gain, span, marked
    )


def loci(found, labels, span_hz=None, gains=None):
    """A locus for each loop, all in one frame: span_hz, or the widest that one of them wants."""
    if span_hz is None:
        span_hz = max(span_of(array(loop.open), loop.limit().frequency_hz) for loop in found)
    gains = gains or [None] * len(found)
    return [
        locus(loop, label, span_hz, gain)
        for loop, label, gain in zip(found, labels, gains, strict=True)
    ]


def hz(roots):
    """Real and imaginary part over 2 pi."""
    roots = np.asarray(roots) / (2 * np.pi)
    return roots.real, roots.imag


def mark(ax, ends, size=5.5):
    """x at the poles and o at the zeros."""
    ax.plot(*hz(ends.poles), "x", color=INK, markersize=size, markeredgewidth=1.3, zorder=4)
    ax.plot(
        *hz(ends.zeros), "o", color=GOT, markersize=size, markerfacecolor="none",
        markeredgewidth=1.2, zorder=4,
    )  # fmt: skip


def panels(count, wide, tall):
    """A figure and `count` axes side by side, each wide x tall inches."""
    left, right, gap, low, high = 0.74, 0.15, 0.4, 0.48, 0.55
    size = left + count * wide + (count - 1) * gap + right, low + tall + high
    figure = plt.figure(figsize=size)
    axes = [
        figure.add_axes(
            ((left + i * (wide + gap)) / size[0], low / size[1], wide / size[0], tall / size[1])
        )
        for i in range(count)
    ]
    for ax in axes:
        style(ax)
        ax.axvline(0, color=FAINT, linewidth=0.8)
        ax.axhline(0, color=FAINT, linewidth=0.8)
    axes[0].set_ylabel("imaginary part / 2\u03c0, Hz", fontsize=8)
    return figure, axes


def headline(figure, title):
    """The title above panels; the figure leaves pyplot's list."""
    figure.suptitle(
        title, fontsize=9, color=INK, parse_math=False, x=0.02, ha="left", va="top", y=0.985
    )
    plt.close(figure)


def rlocus(loci, title="", wide=2.7):
    """Figure of root loci side by side, upper half-planes in Hz; the critical gain is marked."""
    span = max(one.span_hz for one in loci)
    figure, axes = panels(len(loci), wide, 1.05 * wide)  # equal scales on both axes
    for ax, one in zip(axes, loci, strict=True):
        x, y = hz(np.where(one.branches.imag >= 0, one.branches, np.nan))
        ax.plot(x, y, color="#3f7f5f", linewidth=1.1)
        upper = [
            roots[roots.imag > -1e-6 * 2 * np.pi * span]
            for roots in (one.ends.poles, one.ends.zeros)
        ]
        mark(ax, Array("", *upper))
        if len(one.at_gain):
            closed = one.at_gain[one.at_gain.imag > -1e-6]
            ax.plot(*hz(closed), "s", color=INK, markersize=3.5, zorder=5)
        ax.set_xlim(-0.57 * span, 0.43 * span)  # what lies beyond is not drawn
        ax.set_ylim(-0.05 * span, span)
        ax.set_xlabel("real part / 2\u03c0, Hz", fontsize=8)
        label_crossings(ax, one, span)
        ax.set_title(one.label, fontsize=8, color=INK, parse_math=False)
    headline(figure, title)
    return figure


def gain_text(gain, one):
    """A gain with its unit, and the firmware's number for it where it has one."""
    text = f"k = {gain:.3g} {one.unit}".rstrip()
    return text + (f"\n(k_f = {gain * one.codes:.3g})" if one.codes else "")


def label_crossings(ax, one, span):
    """Marks where branches cross, the critical gain with its frequency and the firmware's gain."""
    limit = one.limit
    if not limit.gain:
        note = limit.reason.replace(" at ", "\nat ")
    elif limit.frequency_hz is None or limit.frequency_hz > span:
        where = "infinite" if limit.frequency_hz is None else f"{limit.frequency_hz:.3g}"
        note = f"{gain_text(limit.gain, one)}\nat {where} Hz, beyond"
    else:
        note = ""
    ax.text(
        0.97, 0.97, note, transform=ax.transAxes, fontsize=7, ha="right", va="top",
        color="#3f7f5f" if limit.gain is None else GOT,
    )  # fmt: skip
    taken = []  # (height, half of it)
    own = one.limit.frequency_hz or 0.0
    inside = [c for c in one.crossings if c.frequency_hz is not None and c.frequency_hz < span]
    for crossing in sorted(inside, key=lambda c: abs(c.frequency_hz - own)):
        height = crossing.frequency_hz
        first = crossing.gain == one.limit.gain
        face = GOT if first else "white"
        ax.plot(0, height, "D", color=GOT, markerfacecolor=face, markersize=4.5, zorder=5)
        text = f"{gain_text(crossing.gain, one)}\n{height:.3g} Hz"
        if not first:
            text = f"{'back ' * (crossing.direction < 0)}{crossing.gain:.3g}, {height:.3g} Hz"
        half = (0.09 if first else 0.03) * span
        up = 1 if height >= own else -1
        at = height
        while any(abs(at - other) < half + room for other, room in taken):
            at += up * 0.01 * span
        if not 0 < at < span:
            continue
        taken.append((at, half))
        ax.annotate(
            text, (0, height), (0.05 * span, at), fontsize=7, color=GOT, va="center",
            bbox={"facecolor": "white", "alpha": 0.5, "linewidth": 0, "pad": 0.2}, zorder=6,
            arrowprops={"arrowstyle": "-", "color": GOT, "linewidth": 0.6, "shrinkB": 3},
        )  # fmt: skip


def pole_zero(arrays, title="", span_hz=None, wide=2.9):
    """Figure of pole-zero arrays side by side, in Hz: x poles, o zeros.

    span_hz: half-width of the frame; by default a frame that accentuates the structural dynamics,
    as 4.3.1 does. What is beyond is counted below.
    """
    figure, axes = panels(len(arrays), wide, wide)
    for ax, one in zip(axes, arrays, strict=True):
        roots = np.concatenate([one.poles, one.zeros])
        # Light and nonminimum-phase roots; real ones in the left half are mostly the drive's.
        light = np.abs(roots.real) < 0.3 * np.abs(roots)
        structural = roots[light | (roots.real > np.abs(roots.imag))]
        span = span_hz or frame(np.abs(structural if structural.any() else roots)) / (2 * np.pi)
        mark(ax, one)
        ax.set_xlim(-span, span)
        ax.set_ylim(-span, span)
        beyond = [
            f"{count} {name}" + "s" * (count > 1)
            for name, some in (("pole", one.poles), ("zero", one.zeros))
            if (count := int((np.max(np.abs(hz(some)), axis=0) > span).sum()))
        ]
        note = f"; beyond: {', '.join(beyond)}" if beyond else ""
        ax.set_xlabel(f"real part / 2\u03c0, Hz{note}", fontsize=8)
        ax.set_title(one.label, fontsize=8, color=INK, parse_math=False)
    headline(figure, title)
    return figure


def frame(sizes):
    """A frame, 1/s, around all roots but outer ones that a gap of six sets apart."""
    ordered = np.sort(sizes[sizes > 0])
    if not len(ordered):
        return 2 * np.pi
    gaps = np.flatnonzero(ordered[1:] > 6 * ordered[:-1])
    gaps = gaps[gaps >= len(ordered) // 3]
    return 1.18 * float(ordered[gaps[0]] if len(gaps) else ordered[-1])


# --- modes ---------------------------------------------------------------------------------------


def mode_shapes(result, title=""):
    """Figure of `modes.modes()`: a row a mode, each body at rest (dashed) and displaced.

    Bodies stand in the model's order, one beside the other; displacements are along the axis, the
    largest of a mode drawn equally long in each.
    """
    rows = result["modes"]
    bodies = list(rows[0]["shape"]) if rows else []
    figure, ax = plt.subplots(figsize=(2.6 + 1.15 * len(bodies), 0.8 + 0.72 * len(rows)))
    ax.set_axis_off()
    wide, tall, reach = 0.3, 0.4, 0.33
    for row, mode in enumerate(rows):
        y = -row
        ax.plot([-0.5, len(bodies) - 0.5], [y, y], color="#d8dee4", linewidth=0.8, zorder=0)
        for x, body in enumerate(bodies):
            value = mode["shape"][body]
            moved = x + reach * value
            box = {"width": wide, "height": tall, "linewidth": 0.9}
            ax.add_patch(
                plt.Rectangle((x - wide / 2, y - tall / 2), **box, fill=False, edgecolor=FAINT,
                              linestyle=":")
            )  # fmt: skip
            ax.add_patch(
                plt.Rectangle((moved - wide / 2, y - tall / 2), **box, facecolor="#c9d6e3",
                              edgecolor=INK, alpha=0.85)
            )  # fmt: skip
            ax.annotate(
                f"{value:+.2f}" if abs(value) >= 0.005 else "0", (moved, y), fontsize=6,
                color=INK, ha="center", va="center",
            )  # fmt: skip
        zeta = mode["damping_ratio"]
        head = f"{mode['frequency_hz']:.3g} Hz" + ("" if zeta is None else f", \u03b6 {zeta:.2g}")
        label = mode["label"] + (", the reference" if mode["reference"] else "")
        ax.text(-0.65, y + 0.13, head, fontsize=8, color=INK, ha="right", va="center")
        colour = GOT if mode["label"] == "noncolocated" else "#3f7f5f"
        ax.text(-0.65, y - 0.17, label, fontsize=7, color=colour, ha="right", va="center")
    for x, body in enumerate(bodies):
        ax.text(x, 0.5, body.replace("_", " "), fontsize=8, color=INK, ha="center", va="bottom")
    ax.set_xlim(-2.35, len(bodies) - 0.4)
    ax.set_ylim(-len(rows) + 0.5, 0.85)
    finish(figure, ax, title)
    return figure


# --- design advice -------------------------------------------------------------------------------


def step_response(result):
    """Figure of `loop_verbs.step_summary()`."""
    figure, ax = plt.subplots(figsize=(5.6, 3.0))
    style(ax)
    ax.plot(result["time_s"], result["value"], color=INK, linewidth=1.2)
    if result["final"] is not None:
        ax.axhline(result["final"], color=GOT, linewidth=0.8, linestyle=":")
    ax.set_xlabel("time, s")
    ax.set_ylabel(f"{result['output']}\nper unit step")
    name = f"{Path(result['model']).stem}, {result['law']}, {result['timing']}"
    finish(figure, ax, f"{name}, {result['gain']:.4g} {result['unit']}")
    return figure


def advice(result):
    """Figure of `advise.advise()`: what each change makes of critical gain and crossover."""
    rows = [r for r in result["rows"] if r["ratio"]["critical_gain"]]
    figure, ax = plt.subplots(figsize=(7.6, 0.9 + 0.21 * len(rows)))
    style(ax)
    ax.axvline(1, color=FAINT, linewidth=0.9)
    for y, row in enumerate(rows):
        gain, crossover = row["ratio"]["critical_gain"], row["ratio"]["crossover_hz"]
        if crossover:
            ax.plot([gain, crossover], [y, y], color="#d8dee4", linewidth=1.2, zorder=1)
            ax.plot(crossover, y, "o", color=INK, markersize=4.5)
        ax.plot(gain, y, "D", color=GOT, markersize=4, markerfacecolor="none")
    names = [r["change"] + (f" [{r['thesis']}]" if r["thesis"] else "") for r in rows]
    ax.set_yticks(range(len(rows)), names, fontsize=7)
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_xscale("log")
    ticks = [0.1, 0.2, 0.3, 0.5, 0.7, 1, 1.5, 2, 3, 5, 10, 20, 50]
    low, high = ax.get_xlim()
    ax.set_xticks([x for x in ticks if low <= x <= high])
    ax.minorticks_off()
    ax.xaxis.set_major_formatter(lambda value, _: f"x {value:g}")
    ax.set_xlabel("against the present design", fontsize=8)
    shown = [
        Line2D([], [], color=INK, marker="o", linestyle="", markersize=4.5,
               label=f"crossover at limit / {result['gain_margin']:g}"),
        Line2D([], [], color=GOT, marker="D", linestyle="", markersize=4, markerfacecolor="none",
               label="critical gain"),
    ]  # fmt: skip
    ax.legend(handles=shown, fontsize=7, frameon=False, loc="lower right")
    mode = result["limiting_mode"]
    note = (
        f" - limited by {mode['name']}, {mode['label']}" if mode and mode["name"] != "none" else ""
    )
    figure.tight_layout(rect=(0, 0, 1, 1 - 0.3 / figure.get_figheight()))
    headline(figure, f"{Path(result['model']).stem}, {result['timing']}{note}")
    return figure


# --- the verbs -----------------------------------------------------------------------------------


def varied(overrides, vary):
    """[(label, {parameter: value})] of --set and --vary NAME=VALUE,VALUE,..."""
    common = linear.overrides(overrides)
    runs = [("", common)]
    for text in vary:
        name, _, values = text.partition("=")
        try:
            settings = [linear.overrides([f"{name}={value}"]) for value in values.split(",")]
            texts = [v for s in settings for v in s.values() if isinstance(v, str)]
            if any(text[:1].isalpha() for text in texts):
                raise InputError("a name")
        except InputError:
            raise InputError(f"--vary: {text}: expected NAME=NUMBER,NUMBER,...") from None
        if name in runs[0][1] or len({s[name] for s in settings}) < len(settings):
            raise InputError(f"--vary: {text}: expected each parameter and each value once")
        runs = [
            (f"{label}, {name} = {linear.shown(s[name])}".removeprefix(", "), given | s)
            for label, given in runs
            for s in settings
        ]
    return runs


def loop_note(model, timing, law="p"):
    """What a figure of a loop is of, for its title."""
    return f"{Path(linear.find_model(model)).stem}, {law}, {timing}"


def bode_verb(
    model,
    overrides,
    vary,
    modes,
    free,
    input,
    outputs,
    timing,
    low_hz,
    high_hz,
    gain,
    firmware_gain,
):
    """(figure, summary) of `forceaxis bode`."""
    asked = gain is not None or firmware_gain is not None
    if asked and input != "drive.command":
        raise InputError("--gain: expected with --input drive.command, a loop acts there")
    highest = 1e6 if timing == "continuous" else 0.5 / linear.TICK_S
    if not (1e-6 <= low_hz < high_hz <= highest):
        raise InputError(
            f"--from-hz: expected FROM < TO, from 1e-6 to {highest:g} Hz, got {low_hz:g} and "
            f"{high_hz:g}"
        )
    linear.once("--output", outputs)
    states = linear.states(modes)
    curves, details = [], []
    for label, settings in varied(overrides, vary):
        for output in outputs:
            name = ", ".join(filter(None, [label, output if len(outputs) > 1 else ""]))
            curves.append(
                model_curve(
                    model,
                    name,
                    output,
                    input,
                    (low_hz, high_hz),
                    settings,
                    timing,
                    True,
                    free,
                    states,
                )
            )
            detail = {"output": output} | curves[-1].summary()
            if input == "drive.command":  # where a force loop would act
                loop = loops.force_loop(model, "p", timing, settings, states, output, free)
                k = loop_verbs.one_gain(loop, gain, firmware_gain)
                detail["loop"] = loop_verbs.limit_summary(loop, k)
            details.append(detail)
    path = linear.find_model(model)
    summary = {"model": str(path), "input": input, "timing": timing, "curves": details}
    label = outputs[0] if len(outputs) == 1 else "amplitude"
    figure = bode(curves, f"{path.stem}: {input} to {', '.join(outputs)}, {timing}", label)
    return figure, summary


def describe_bode(summary):
    """The text of `forceaxis bode`: the ends of each curve and where its phase crosses -180."""
    lines = []
    for c in summary["curves"]:
        frequency, phase = np.array(c["frequency_hz"]), np.array(c["phase_deg"])
        lines.append(f"{c['output']:12} {c['label']}".rstrip())
        for i in (0, -1):
            lines.append(
                f"{'':12} {c['magnitude'][i]:.4g} {c['unit']}, {phase[i]:.4g} degrees at "
                f"{frequency[i]:.4g} Hz"
            )
        for i in np.flatnonzero((phase[:-1] + 180) * (phase[1:] + 180) < 0):
            share = (phase[i] + 180) / (phase[i] - phase[i + 1])
            at = frequency[i] + share * (frequency[i + 1] - frequency[i])
            size = np.interp(at, frequency, c["magnitude"])
            lines.append(f"{'':12} -180 degrees at {at:.4g} Hz, {size:.4g} {c['unit']}")
        if c.get("loop", {}).get("at"):
            text = loop_verbs.describe_limit(c["loop"]).splitlines()
            lines += [line for line in text if line.startswith(("at ", "gain ", "phase "))]
    return "\n".join(lines)


def loop_of(model, settings, modes, law, timing, output, free, given):
    """The loop of the options that `forceaxis limit` has, with `settings` for its --set."""
    texts = [f"{name}={value!r}" for name, value in settings.items()]
    return loop_verbs.from_options(model, texts, modes, law, timing, output, free, **given)


def rlocus_verb(
    model, overrides, vary, modes, free, law, timing, output, span_hz, gain, firmware_gain, **given
):
    """(figure, summary) of `forceaxis rlocus`."""
    labels, found = [], []
    for label, settings in varied(overrides, vary):
        labels.append(label)
        found.append(loop_of(model, settings, modes, law, timing, output, free, given))
    gains = [loop_verbs.one_gain(loop, gain, firmware_gain) for loop in found]
    every = loci(found, labels, span_hz, gains)
    loop = found[-1]
    figure = rlocus(every, loop_note(model, timing, law))
    summary = loop_verbs.describe_loop(loop) | {"loci": [one.summary() for one in every]}
    return figure, summary


def describe_rlocus(summary):
    """The text of `forceaxis rlocus`: the limit of each locus."""
    lines = []
    for one in summary["loci"]:
        limit = one["critical_gain"]
        text = "stable at every gain" if limit is None else f"limit {limit:.6g} {one['unit']}"
        if one["frequency_hz"] is not None:
            text += f" at {one['frequency_hz']:.4g} Hz"
        lines.append(f"{one['label'] or summary['law']:12} {text}")
    return "\n".join(lines)


def nyquist_verb(model, overrides, modes, free, law, timing, output, gain, firmware_gain, **given):
    """(figure, summary) of `forceaxis nyquist`; without a gain at half the critical one, or 1."""
    loop = loop_of(model, linear.overrides(overrides), modes, law, timing, output, free, given)
    gain = loop_verbs.one_gain(loop, gain, firmware_gain)
    if gain is None:
        gain = (loop.limit().gain or 2.0) / 2
    own = f" (k_f = {gain * loop.codes_per_gain:.3g})" if loop.codes_per_gain else ""
    title = f"{loop_note(model, timing, law)}, k = {gain:.3g} {loop.unit}{own}"
    figure = nyquist(loop.open, gain, title)
    c = curve(loop.open, "", NYQUIST_HZ, points=1200)
    summary = loop_verbs.limit_summary(loop, gain) | {
        "frequency_hz_of_curve": c.frequency_hz.tolist(),
        "real": (gain * c.response.real).tolist(),
        "imag": (gain * c.response.imag).tolist(),
        "magnitude": (gain * c.magnitude).tolist(),
        "phase_deg": c.phase_deg.tolist(),
    }
    return figure, summary


def poles_figure(summary, span_hz=None):
    """Figure of what `forceaxis poles --json` prints."""

    def roots(kind):
        found = [r for r in summary[kind] if r["re_per_s"] is not None]
        return np.array([complex(r["re_per_s"], r["im_per_s"] or 0.0) for r in found], complex)

    stem = Path(summary["model"]).stem
    title = f"{stem}: {summary['input']} to {summary['output']}, {summary['timing']}"
    return pole_zero([Array("", roots("poles"), roots("zeros"))], title, span_hz)
