"""The page of a design: one HTML file with its tables and figures."""

import base64
from importlib import resources
from pathlib import Path

import jinja2
import matplotlib.pyplot as plt
import numpy as np

from forceaxis import _core, drawing, objects
from forceaxis.design import files
from forceaxis.design import outcome as outcomes
from forceaxis.drawing import FAINT, GOT, INK, WANTED, legend, style
from forceaxis.experiments import run as runs
from forceaxis.linear.system import TICK_S

RANDOM = 4  # choices of values drawn beside nominal and corners
ROWS = (
    ("fS, Hz", "fS_Hz"),
    ("fT, Hz", "fT_Hz"),
    ("Ms", "Ms"),
    ("Ms, a tick late", "Ms_late"),
    ("gain margin", "gain_margin"),
    ("phase margin, degrees", "phase_margin_deg"),
    ("gain, DAC codes per count of force", "force_gain"),
)


def image(figure):
    return "data:image/png;base64," + base64.b64encode(drawing.small_png(figure, 110)).decode()


def responses(outcome, bank, frequency_hz):
    """[(L at the frequencies, whether the member is nominal)] over the set and its latencies."""
    plants = outcome.plants
    members = [(m, True) for m in plants.nominal()]
    members += [(m, False) for m in plants.corners() + plants.random(RANDOM)]
    found = []
    for latency in outcomes.LATENCIES[outcome.order.latency]:
        for member, nominal in members:
            loop = plants.loop(member, outcomes.TIMINGS[latency], law="bank", bank=bank)
            gain = loop.gain_of(bank.force_gain)
            found.append((gain * loop.open.response(frequency_hz), nominal))
    return found


def laws(outcome):
    """[(name, bank)] of what is drawn side by side; P only where one meets the margins."""
    p = [("P", outcome.p_bank)] if outcome.p_bank.force_gain else []
    return [*p, (outcome.chosen, outcome.bank)]


def sensitivity(outcome, frequency_hz, loops):
    """|S| and |T| in dB; columns: P, the design."""
    shown = laws(outcome)
    figure, axes = plt.subplots(
        2, len(shown), figsize=(9.2, 5.2), sharex=True, sharey="row", squeeze=False
    )
    for column, (name, _) in enumerate(shown):
        for L, nominal in loops[column]:
            look = {"color": INK, "linewidth": 1.3, "zorder": 3} if nominal else {
                "color": GOT, "linewidth": 0.5, "alpha": 0.5
            }  # fmt: skip
            for ax, value in zip(axes[:, column], (1 / (1 + L), L / (1 + L)), strict=True):
                ax.semilogx(frequency_hz, 20 * np.log10(np.abs(value)), **look)
        axes[0, column].axhline(20 * np.log10(outcome.order.ms), color=WANTED, linewidth=0.9)
        axes[0, column].set_title(name, fontsize=9, loc="left", color=INK)
        for ax in axes[:, column]:
            style(ax)
            ax.axhline(-3.01, color=FAINT, linewidth=0.8, linestyle=":")
            ax.set_xlim(frequency_hz[0], frequency_hz[-1])
            ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes[1, column].set_xlabel("frequency, Hz")
    axes[0, 0].set_ylabel("|S|, dB")
    axes[1, 0].set_ylabel("|T|, dB")
    axes[0, 0].set_ylim(-40, 12)
    axes[1, 0].set_ylim(-40, 12)
    legend(
        axes[0, -1],
        handles=[
            plt.Line2D([], [], color=INK, label="nominal"),
            plt.Line2D([], [], color=GOT, linewidth=0.7, label="corners and random members"),
            plt.Line2D([], [], color=WANTED, label="Ms"),
            plt.Line2D([], [], color=FAINT, linestyle=":", label="-3 dB"),
        ],
        loc="lower right",
    )
    figure.tight_layout()
    plt.close(figure)
    return figure


def nyquist(outcome, loops):
    """Loop gains around -1; columns: P, the design."""
    shown = laws(outcome)
    figure, axes = plt.subplots(
        1, len(shown), figsize=(9.2, 4.6), sharex=True, sharey=True, squeeze=False
    )
    axes = axes[0]
    turn = np.linspace(0, 2 * np.pi, 200)
    for ax, (name, _), found in zip(axes, shown, loops, strict=True):
        style(ax)
        ax.plot(np.cos(turn), np.sin(turn), color=FAINT, linewidth=0.7, linestyle=":")
        radius = 1 / outcome.order.ms
        ax.fill(-1 + radius * np.cos(turn), radius * np.sin(turn), color=WANTED, alpha=0.18)
        for L, nominal in found:
            ax.plot(
                L.real, L.imag, color=INK if nominal else GOT,
                linewidth=1.3 if nominal else 0.5, alpha=1 if nominal else 0.5,
                zorder=3 if nominal else 2,
            )  # fmt: skip
        ax.plot([-1], [0], marker="+", color=INK, markersize=9, zorder=4)
        ax.set_xlim(-2.2, 1.6)
        ax.set_ylim(-2.2, 1.6)
        ax.set_aspect("equal")
        ax.set_title(name, fontsize=9, loc="left", color=INK)
        ax.set_xlabel("real part")
    axes[0].set_ylabel("imaginary part")
    figure.tight_layout()
    plt.close(figure)
    return figure


def contact(bench, outcome):
    """Force over time, P and design: the middle set-point, and a strike there."""
    middle, struck = bench.cases[1], bench.cases[-1]
    figure, axes = plt.subplots(1, 2, figsize=(9.2, 3.4))
    latency = outcomes.LATENCIES[outcome.order.latency][0]
    loss = {name: outcome.loss[name] for name in files.LOSS if name in outcome.loss}
    for ax, case in zip(axes, (middle, struck), strict=True):
        style(ax)
        start = bench.touch_s(case) + bench.settle_s if case.strike_N_s else 0.0
        for name, bank in laws(outcome):
            color = INK if bank is outcome.bank else GOT
            own = loss if bank is outcome.bank else None
            file, texts = bench.job(case, bank, {}, latency, own)
            done = runs.run(Path(file), texts)
            force = done.columns[bench.facts["contacts"][0]["name"] + ".force"]
            time_s = done.columns["time_s"]
            if not case.strike_N_s:  # from a little before the first touch
                touched = np.flatnonzero(force > 0)
                start = time_s[touched[0]] - 0.05 if len(touched) else 0.0
            shown = (time_s >= start - 0.05) & (time_s <= start + (1.0 if case.strike_N_s else 0.6))
            ax.plot(time_s[shown], force[shown], color=color, linewidth=1.0, label=name)
        ax.axhline(case.setpoint_N, color=WANTED, linestyle="--", linewidth=0.8)
        ax.set_title(case.name, fontsize=9, loc="left", color=INK)
        ax.set_xlabel("time, s")
    axes[0].set_ylabel("force, N")
    legend(axes[0], loc="lower right")
    figure.tight_layout()
    plt.close(figure)
    return figure


def structure_rows(outcome):
    number = outcomes.number
    rows = []
    for s in outcome.structures:
        worst, bank = s["worst"] or {}, s["bank"]
        rows.append([
            s["name"], *(number(worst.get(key)) for key in ("fS_Hz", "Ms", "gain_margin")),
            number(bank["force_gain"]), number(bank["hf_gain"]),
        ])  # fmt: skip
    return rows


def write(folder, bench, outcome, run):
    """index.html into a files.Folder. run: the experiment that it names."""
    frequency_hz = np.geomspace(0.3, 0.499 / TICK_S, 2000)
    loops = [responses(outcome, bank, frequency_hz) for _, bank in laws(outcome)]
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    text = resources.files("forceaxis.design").joinpath("page.html.jinja").read_text("utf-8")
    number = outcomes.number
    html = environment.from_string(text).render(
        o=outcome,
        title=bench.design.model.stem,
        ranges=", ".join(f"{n} {r[1]:.4g} to {r[2]:.4g} {outcome.units[n]}"
                         for n, r in outcome.ranges.items()),
        latencies=" and ".join(map(str, outcomes.LATENCIES[outcome.order.latency])),
        figures=[(n, number(outcome.p.get(k)),
                  number(outcome.bank.force_gain if k == "force_gain" else outcome.worst.get(k)))
                 for n, k in ROWS],
        worst_member=", ".join(
            f"{n} = {outcomes.shown(v)}" for n, v in outcome.worst["member"].items()
        ),
        structures=structure_rows(outcome),
        sensitivity=image(sensitivity(outcome, frequency_hz, loops)),
        nyquist=image(nyquist(outcome, loops)),
        contact=image(contact(bench, outcome)) if outcome.rows else None,
        case_head=outcomes.CASE_HEAD,
        cases=outcomes.cases(outcome.rows),
        unsettled=lambda cell: len(set(cell.split(" of "))) > 1,
        members=outcomes.MEMBERS,
        run=run,
        firmware_hash=_core.FIRMWARE_HASH,
        objects_hash=objects.OBJECTS_HASH,
    )  # fmt: skip
    folder.write("index.html", html)
