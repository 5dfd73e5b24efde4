"""Writes the page of a design: an HTML file with tables and plots about a designed force law."""

from collections.abc import Iterable
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from forceaxis import _core, drawing, objects
from forceaxis.design import outcome as outcomes
from forceaxis.design.cases import ContactCase
from forceaxis.design.certificate import FIGURES
from forceaxis.design.files import NewFolder
from forceaxis.design.grid import Response, Samples
from forceaxis.design.outcome import DesignOutcome
from forceaxis.design.simulate import ContactBench
from forceaxis.drawing import FAINT, GOT, INK, WANTED, LineStyle, legend, style
from forceaxis.experiments import run as runs
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.periodic import FreeLoop, PeriodicLoop
from forceaxis.linear.stability import Loop
from forceaxis.linear.system import TICK_S
from forceaxis.pages.template import template
from forceaxis.words import plain

# Width of a plot in inches. A row of the page has two plots on a screen, and one on a telephone.
WIDE_IN = 4.4
LOOP_GAIN_DRAWN = 20.0  # largest magnitude of the loop gain that the plots show
RANDOM_PLANTS = (
    # number of random plants in the plots, besides the nominal plant and the corner plants
    4
)

# [(loop gain L over the frequencies, key of LOOKS)], one entry for each curve of a plot.
Loops = list[tuple[Response, str]]


def responses(outcome: DesignOutcome, bank: Bank, frequency_hz: Samples) -> Loops:
    """Returns the loop gain of a filter bank as frequency responses, one for each plant of the set
    and each latency."""
    plants = outcome.plants
    members = [(m, True) for m in plants.nominal()]
    members += [(m, False) for m in plants.corners() + plants.random(RANDOM_PLANTS)]
    found: Loops = []
    for latency in outcome.order.latencies:
        for member, nominal in members:
            loop = plants.loop(member, outcomes.TIMINGS[latency], LoopSpec("bank", bank=bank))
            gain = loop.gain_of(bank.force_gain)
            kind = "members" if not nominal else "late" if latency else "nominal"
            found.append((loop_gain(loop, gain, frequency_hz), kind))
    return found


def loop_gain(loop: Loop, gain: float, frequency_hz: Samples) -> Response:
    """Returns the loop gain L as a frequency response. If the phase of the sensor's samples is not
    known, L is computed with the oldest readings. For a loop with several codes in the period of
    its ticks, L is computed from the component of S at the frequency of the disturbance."""
    oldest = loop.each[0] if isinstance(loop, FreeLoop) else loop
    if isinstance(oldest, PeriodicLoop):
        return np.asarray(1 / oldest.sensitivity_at(gain, frequency_hz) - 1, complex)
    return np.asarray(gain * oldest.open.response(frequency_hz), complex)


# {key of a curve in a plot: (line style, name in the legend)}
LOOKS: dict[str, tuple[LineStyle, str]] = {
    "nominal": ({"color": INK, "linewidth": 1.3, "zorder": 3}, "nominal"),
    "late": ({"color": INK, "linewidth": 1.3, "zorder": 3, "linestyle": "--"},
             "nominal, one tick of latency"),
    "members": ({"color": GOT, "linewidth": 0.5, "alpha": 0.5, "zorder": 2},
                "corners and random members"),
}  # fmt: skip


def keys(loops: Iterable[tuple[Response | None, str]]) -> list[Artist]:
    """Returns the entries for the legend of a plot, one for each line style in `loops`."""
    met = {kind for _, kind in loops}
    return [plt.Line2D([], [], label=name, **look)
            for kind, (look, name) in LOOKS.items() if kind in met]  # fmt: skip


def laws(outcome: DesignOutcome) -> list[tuple[str, Bank]]:
    """Returns [(name, filter bank)] of the control laws that the plots compare: the designed law,
    and law P if a P gain keeps the margins."""
    p = [("P", outcome.p_bank)] if outcome.p_bank.force_gain else []
    return [*p, (outcome.chosen, outcome.bank)]


def sensitivity(outcome: DesignOutcome, name: str, frequency_hz: Samples, loops: Loops) -> Figure:
    """Returns a plot of |S| and |T| in dB over the frequency, for one control law and all plants of
    the set."""
    figure, axes = plt.subplots(2, 1, figsize=(WIDE_IN, 4.6), sharex=True)
    for L, kind in loops:
        for ax, value in zip(axes, (1 / (1 + L), L / (1 + L)), strict=True):
            ax.semilogx(frequency_hz, 20 * np.log10(np.abs(value)), **LOOKS[kind][0])
    axes[0].axhline(20 * np.log10(outcome.order.ms), color=WANTED, linewidth=0.9)
    for ax, what in zip(axes, "ST", strict=True):
        style(ax)
        ax.axhline(-3.01, color=FAINT, linewidth=0.8, linestyle=":")
        ax.set(xlim=(frequency_hz[0], frequency_hz[-1]), ylim=(-40, 12), ylabel=f"|{what}|, dB")
    drawing.plain_ticks(axes[1].xaxis)
    axes[1].set_xlabel("frequency, Hz")
    legend(
        axes[1],
        handles=[
            *keys(loops),
            plt.Line2D([], [], color=WANTED, label="largest permitted |S|"),
            plt.Line2D([], [], color=FAINT, linestyle=":", label="-3 dB"),
        ],
        loc="lower left",
    )
    drawing.finish(figure, axes[0], name)
    return figure


def nyquist(outcome: DesignOutcome, name: str, loops: Loops) -> Figure:
    """Returns a Nyquist plot near the point -1, for one control law and all plants of the set."""
    figure, ax = plt.subplots(figsize=(WIDE_IN, 4.2))
    turn = np.linspace(0, 2 * np.pi, 200)
    style(ax)
    ax.plot(np.cos(turn), np.sin(turn), color=FAINT, linewidth=0.7, linestyle=":")
    radius = 1 / outcome.order.ms
    ax.fill(-1 + radius * np.cos(turn), radius * np.sin(turn), color=WANTED, alpha=0.18)
    for L, kind in loops:
        near = np.where(np.abs(L) < LOOP_GAIN_DRAWN, L, np.nan)
        ax.plot(near.real, near.imag, **LOOKS[kind][0])
    legend(ax, handles=keys(loops), loc="upper left")
    ax.plot([-1], [0], marker="+", color=INK, markersize=9, zorder=4)
    ax.set(xlim=(-2.2, 1.6), ylim=(-2.2, 1.6), xlabel="real part", ylabel="imaginary part")
    ax.set_aspect("equal")
    drawing.finish(figure, ax, name)
    return figure


def contact(bench: ContactBench, outcome: DesignOutcome, case: ContactCase) -> Figure:
    """Returns a plot of the force over time in a simulated contact. It has one curve with law P and
    one with the designed law."""
    figure, ax = plt.subplots(figsize=(WIDE_IN, 3.0))
    style(ax)
    latency = outcome.order.latencies[0]
    start = bench.touch_s(case) + bench.settle_s if case.strike_N_s else 0.0
    for name, bank in laws(outcome):
        color = INK if bank is outcome.bank else GOT
        own = outcome.loss_objects if bank is outcome.bank else None
        file, texts = bench.job(case, bank, {}, latency, own)
        done = runs.run(Path(file), texts)
        force = done.columns[bench.facts.contacts[0].name + ".force"]
        time_s = done.columns["time_s"]
        if not case.strike_N_s:  # the plot begins shortly before the first contact
            touched = np.flatnonzero(force > 0)
            start = time_s[touched[0]] - 0.05 if len(touched) else 0.0
        inside = (time_s >= start - 0.05) & (time_s <= start + (1.0 if case.strike_N_s else 0.6))
        ax.plot(time_s[inside], force[inside], color=color, linewidth=1.0, label=name)
    ax.axhline(case.setpoint_N, color=WANTED, linestyle="--", linewidth=0.8, label="set-point")
    ax.set(xlabel="time, s", ylabel="force, N")
    legend(ax, loc="best")
    drawing.finish(figure, ax, case.name)
    return figure


def shown(value: float | str) -> str:
    """Returns text that shows the value of a parameter or the state of an element."""
    return plain(value, 4) if isinstance(value, float) else str(value)


def figure_rows(outcome: DesignOutcome) -> list[tuple[str, str, str]]:
    """Returns a table with the rows (name of a margin or bandwidth, value with law P, value with
    the designed law)."""
    names = [*FIGURES, "gain, DAC codes per count of force"]
    p = (*outcome.p.row, outcome.p.force_gain)
    own = (*outcome.worst.row, outcome.bank.force_gain)
    number = outcomes.number
    return [(name, number(a), number(b)) for name, a, b in zip(names, p, own, strict=True)]


def structure_rows(outcome: DesignOutcome) -> list[list[str]]:
    """Returns a table with one row for each structure of the force law: name, bandwidth fS, Ms,
    gain margin, gain, and gain at high frequency."""
    rows = []
    for one in outcome.structures:
        figures = (*one.row, one.bank.force_gain, one.bank.hf_gain)
        rows.append([one.name, *map(outcomes.number, figures)])
    return rows


def write(folder: NewFolder, bench: ContactBench, outcome: DesignOutcome, run: str) -> None:
    """Writes the page index.html about a design into a folder. `run`: path of the experiment that
    the page recommends to run."""
    frequency_hz = np.geomspace(0.3, 0.499 / TICK_S, 2000)
    loops = [responses(outcome, bank, frequency_hz) for _, bank in laws(outcome)]
    html = template("design").render(
        o=outcome,
        title=drawing.name_of(bench.design.model),
        ranges=", ".join(f"{n} {plain(r[1], 4)} to {plain(r[2], 4)} {outcome.units[n]}"
                         for n, r in outcome.ranges.items()),
        latencies=" and ".join(map(str, outcome.order.latencies)),
        figures=figure_rows(outcome),
        worst_member=", ".join(
            f"{n} = {shown(v)} {outcome.units.get(n, '')}".rstrip()
            for n, v in outcome.worst.member.items()
        ),
        structures=structure_rows(outcome),
        sensitivity=[
            (name, drawing.uri(sensitivity(outcome, name, frequency_hz, found)))
            for (name, _), found in zip(laws(outcome), loops, strict=True)
        ],
        nyquist=[
            (name, drawing.uri(nyquist(outcome, name, found)))
            for (name, _), found in zip(laws(outcome), loops, strict=True)
        ],
        contact=[
            (case.name, drawing.uri(contact(bench, outcome, case)))
            for case in ((bench.shown, bench.cases[-1]) if outcome.rows else ())
        ],
        case_head=outcomes.CASE_HEAD,
        cases=[[case, {"p": "P", "design": outcome.chosen}[law], *cells]
               for case, law, *cells in outcomes.cases(outcome.rows)],
        unsettled=lambda cell: len(set(cell.split(" of "))) > 1,
        members=outcomes.MEMBERS,
        run=run,
        firmware_hash=_core.FIRMWARE_HASH,
        objects_hash=objects.OBJECTS_HASH,
    )  # fmt: skip
    folder.write("index.html", html)
