"""Soft contact or low gain (6.2.1): what the stiffness of one element is worth.

A softer pad, sensor or workpiece lets the gain rise and takes the loop gain, and the axis has to
move further for its force. For each stiffness: the bandwidth over the set of P and of a bank
designed for it (`reduced`), at the same margins; the static error of P; the way from touch to the
set-point; the hardest strike on the contact that either law survives with the firmware.
"""

import os
import textwrap
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import LogFormatter

from forceaxis import paths, progress, toml
from forceaxis._core import InputError
from forceaxis.design import changes, friction, reduced, sets, simulate
from forceaxis.design.search import Goal
from forceaxis.drawing import FAINT, GOT, INK, WANTED, finish, legend, name_of, style
from forceaxis.linear import system as linear
from forceaxis.linear import working
from forceaxis.linear.bank import Bank

SPAN = (1 / 20, 4.0)  # of the model's own stiffness
POINTS_MAX = 40
STRIKES = np.geomspace(0.25, 64.0, 9)  # times the strike of simulate's cases
SLOW_HZ = 0.01  # static, also where the axis integrates


def element_of(model, overrides):
    """The stiffness of the contact, a parameter."""
    contact = changes.contact_of(toml.read(linear.find_model(model)))
    name = contact.get("stiffness") if contact else None
    if name not in linear.facts(model, overrides).parameters:
        raise InputError(
            f"{model}: --element: expected the name of a stiffness, the contact's is no parameter"
        )
    return name


def compliance(
    text, element=None, overrides=None, over=None, span=None, points=9, bits=None, threads=None,
    states=None,
):  # fmt: skip
    """What `forceaxis compliance --json` prints.

    text: MODEL or EXPERIMENT; element: a parameter in N/m, by default the contact's stiffness;
    over: texts as --over, by default `sets.workpiece`; span: (lowest, highest) N/m; states:
    {element: state} of all plants. Raises InputError.
    """
    with changes.Design(text, overrides, states=states) as design:
        if design.facts.reading is None:
            raise InputError(
                f"{design.model}: adc: expected one on channel 0 that reads a force, there is none"
            )
        element = element or element_of(design.model, design.overrides)
        known = design.facts.parameters
        if element not in known or known[element][1] != "N/m":
            stiff = sorted(n for n, (_, unit) in known.items() if unit == "N/m")
            raise InputError(f"--element: expected one of {', '.join(stiff)}, got {element}")
        own = known[element][0]
        low, high = span or (own * SPAN[0], own * SPAN[1])
        if not (0 < low < high and 2 <= points <= POINTS_MAX):
            raise InputError(
                f"--from, --to: expected 0 < from < to and 2 to {POINTS_MAX} points, got {low:g}, "
                f"{high:g} and {points}"
            )
        over = tuple(sets.workpiece(design.model, design.overrides) if over is None else over)
        bits = bits or design.facts.required_reading.bits
        bench = simulate.Bench(design, bits)
        setpoint, hardest = bench.setpoints_N[1], _strikes(bench)[1][-1]
        overrides, mode = design.overrides, design.working()
    rows = [
        _point(text, element, float(value), overrides, over, bits, setpoint, threads, states)
        for value in progress.each(np.geomspace(low, high, points), "stiffnesses")
    ]
    return {
        "model": paths.display(design.model),
        "element": element,
        "unit": "N/m",
        "present": own,
        "over": list(over),
        **working.summary(mode),
        "adc_bits": bits,
        "setpoint_N": setpoint,
        "strike_max_N_s": hardest,
        "rows": rows,
    }


def _point(text, element, value, overrides, over, bits, setpoint, threads, states):
    row = {"stiffness": value, **dict.fromkeys(COLUMNS)}
    with changes.Design(text, overrides | {element: value}, states=states) as design:
        plants = sets.plant_set(design.model, design.overrides, over, fixed=design.states)
        row["motion_m"] = setpoint * motion(design)
        try:
            problem = reduced.Problem(plants, Goal(adc_bits=bits), random=0)
        except InputError as error:  # no small gain keeps a member stable
            return row | {"refused": str(error)}
        p, found = problem.worst(Bank(1.0)), problem.designed()
        for prefix, law in (("p_", p), ("", found)):
            if law["worst"] is None:
                continue
            row[prefix + "fS_Hz"] = law["worst"]["fS_Hz"]
            row[prefix + "static_error"] = law["worst"]["static_error"]
            row[prefix + "bank"] = law["bank"].keys()
            row[prefix + "strike_N_s"] = _strike(design, bits, law["bank"], threads)
    return row


def motion(design):
    """Way of the drive's body for a newton of the reading, m/N, at rest."""
    body = design.facts.required_drive.body
    plants = (
        linear.linearise(
            design.model, outputs=(output,), overrides=design.overrides, modes=design.states
        )
        for output in (f"{body}.position", "reading")
    )
    way, force = (abs(plant.response(SLOW_HZ)) for plant in plants)
    return float(way / force)


def _strike(design, bits, bank, threads):
    """N s, the largest of a ladder up to which all are survived; 0: not even the first."""
    bench = simulate.Bench(design, bits)
    bench.wait_for(bank)
    case, strikes = _strikes(bench)
    plants = [{}, *friction.members(bench.frictions)]
    jobs = [bench.job(replace(case, strike_N_s=s), bank, m, 0) for s in strikes for m in plants]
    outcomes = simulate.run(jobs, threads or os.cpu_count() or 1)
    good = [o["verdict"] == "stable" and o["fault"] == "none" for o in outcomes]
    borne = 0.0
    for i, strike in enumerate(strikes):
        if not all(good[i * len(plants) : (i + 1) * len(plants)]):
            break
        borne = strike
    return borne


def _strikes(bench):
    """(a case at the middle set-point, the strikes on it in N s)."""
    case = next(c for c in bench.cases if c.strike_N_s and c.setpoint_N == bench.setpoints_N[1])
    return case, [float(s) * case.strike_N_s for s in STRIKES]


COLUMNS = (
    *("p_fS_Hz", "fS_Hz", "p_static_error", "static_error", "motion_m", "p_strike_N_s"),
    *("strike_N_s", "p_bank", "bank"),
)


def describe(result):
    """The map for a terminal."""

    def number(value, scale=1.0):
        return "-" if value is None else f"{scale * value:.3g}"

    def strike(value):
        return (">= " if value == result["strike_max_N_s"] else "") + number(value)

    lines = [
        f"model        {result['model']}, {result['element']} = {result['present']:.6g} N/m",
        f"set          {', '.join(result['over']) or 'this plant alone'}",
        *working.lines(result),
        f"set-point    {result['setpoint_N']:.4g} N",
    ]
    table = [["", "P fS", "bank fS", "P error", "motion", "P strike", "bank strike"],
             ["N/m", "Hz", "Hz", "%", "mm", "N s", "N s"]]  # fmt: skip
    for row in result["rows"]:
        table.append([
            f"{row['stiffness']:.4g}", number(row["p_fS_Hz"]), number(row["fS_Hz"]),
            number(row["p_static_error"], 100), number(row["motion_m"], 1e3),
            strike(row["p_strike_N_s"]), strike(row["strike_N_s"]),
        ])  # fmt: skip
    wide = [max(len(r[i]) for r in table) for i in range(len(table[0]))]
    lines += ["  ".join(c.rjust(w) for c, w in zip(r, wide, strict=True)) for r in table]
    lines += textwrap.wrap(
        "fS: lowest frequency at which |S| reaches -3 dB, of the set's worst member; error: of the "
        "force held; motion: of the drive, from touch to the set-point; strike: the hardest "
        "survived in simulation; -: no gain at the margins",
        80,
    )
    return "\n".join(lines)


def figure(result):
    """The map as a figure."""
    rows = result["rows"]
    k = [r["stiffness"] for r in rows]
    drawn, axes = plt.subplots(3, 1, sharex=True, figsize=(5.8, 6.2))
    panels = (
        ("bandwidth over the set, Hz", 1.0, ("P", "p_fS_Hz", GOT), ("bank", "fS_Hz", INK)),
        ("error of P, %; motion, mm", None, ("error of P", "p_static_error", GOT),
         ("motion", "motion_m", WANTED)),
        ("strike survived, N s", 1.0, ("P", "p_strike_N_s", GOT), ("bank", "strike_N_s", INK)),
    )  # fmt: skip
    scales = {"p_static_error": 100.0, "motion_m": 1e3}
    strikes = ("p_strike_N_s", "strike_N_s")
    for ax, (label, _, *curves) in zip(axes, panels, strict=True):
        style(ax)
        ax.set_xscale("log")
        struck = curves[0][1] in strikes  # 0 is a result: not even the weakest strike
        if not struck:
            ax.set_yscale("log")
        for name, key, colour in curves:
            y = [np.nan if r[key] is None else scales.get(key, 1.0) * r[key] for r in rows]
            y = [np.nan if value <= 0 and not struck else value for value in y]
            ax.plot(k, y, "o-", color=colour, markersize=3, linewidth=1.1, label=name)
        ax.axvline(result["present"], color=FAINT, linewidth=0.8, linestyle=":")
        ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        if not struck:
            ax.yaxis.set_minor_formatter(LogFormatter(minor_thresholds=(1, 0.4)))
        elif all(r[key] in (None, 0.0) for r in rows for key in strikes):
            ax.set_ylim(-0.05, 1)
            known = any(r[key] is not None for r in rows for key in strikes)
            text = "no strike of the ladder is survived" if known else "no gain at the margins"
            ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", color=FAINT, fontsize=8)
        else:
            ax.set_ylim(bottom=0)
        ax.set_ylabel(label)
        legend(ax)
    axes[-1].set_xlabel(f"{result['element']}, N/m (dotted: present)")
    name, over = name_of(result["model"]), ", ".join(result["over"])
    finish(drawn, axes[0], f"{name}: soft contact or low gain, over {over}")
    return drawn
