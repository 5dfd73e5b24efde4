"""Texts that the verbs for linear models print: poles, bode, modes, linearise and beam."""

from collections.abc import Iterator

import numpy as np

from forceaxis.cli.text_loops import describe_limit, law_text
from forceaxis.linear import working
from forceaxis.linear.limits import Summary
from forceaxis.linear.system import System
from forceaxis.linear.working import Working


def describe_poles(summary: Summary) -> str:
    """Return the text of `forceaxis poles`: a line for each pole and each zero."""

    def lines(kind: str) -> Iterator[str]:
        for root in summary[kind]:
            s = [root["re_per_s"], root["im_per_s"]]
            text = "at -infinity" if None in s else f"{s[0]:11.6g} {s[1]:+11.6g}j 1/s"
            if None not in s:
                text += f" {root['hz']:8.5g} Hz"
            if None not in s and root.get("damping_ratio") is not None:
                text += f" zeta {root['damping_ratio']:<8.4g}"
            if "re_z" in root:
                text += f" z {root['re_z']:+.5f}{root['im_z']:+.5f}j"
            yield f"{kind[:-1]} {text.rstrip()}"

    head = f"from         {summary['input']} to {summary['output']}, {summary['timing']}"
    if "closed" in summary:
        closed = summary["closed"]
        head += f", closed with {law_text(summary)} at {closed['gain']:.6g} {closed['unit']}"
    return "\n".join([head, *working.lines(summary), *lines("poles"), *lines("zeros")])


ABOUT_ONE_GAIN = ("at ", "gain ", "phase ", "|S|", "|T|", "Ms")  # lines about one gain


def describe_bode(summary: Summary) -> str:
    """Return the text of `forceaxis bode`: for each curve its lowest and highest frequency, and the
    frequencies at which the phase is -180 degrees."""
    lines = working.lines(summary)
    for c in summary["curves"]:
        frequency, phase = np.array(c["frequency_hz"]), np.array(c["phase_deg"])
        lines.append(f"{c['output']:12} {c['label']}".rstrip())
        unit = f" {c['unit']}" if c["unit"] else ""
        for i in (0, -1):
            lines.append(
                f"{'':12} {c['magnitude'][i]:.4g}{unit}, {phase[i]:.4g} degrees at "
                f"{frequency[i]:.4g} Hz"
            )
        for j in np.flatnonzero((phase[:-1] + 180) * (phase[1:] + 180) < 0):
            share = (phase[j] + 180) / (phase[j] - phase[j + 1])
            at = frequency[j] + share * (frequency[j + 1] - frequency[j])
            size = np.interp(at, frequency, c["magnitude"])
            lines.append(f"{'':12} -180 degrees at {at:.4g} Hz, {size:.4g}{unit}")
        if c.get("loop", {}).get("at"):
            text = describe_limit(c["loop"]).splitlines()
            lines += [line for line in text if line.startswith(ABOUT_ONE_GAIN)]
    return "\n".join(lines)


def describe_measured(summary: Summary) -> str:
    """Return the text of `forceaxis bode --measured`: the curves, and whether the model explains
    each measurement."""
    lines = [describe_bode(summary)]
    for row in summary["measured"]:
        inside = "-" if row["inside"] is None else f"{100 * row['inside']:.1f} %"
        verdict = "the model fits" if row["fits"] else "the model does not fit"
        lines.append(
            f"measured     {row['folder']}: {inside} of {row['coherent']} coherent points within "
            f"the 95 % band; {verdict} (p = {row['p_value']:.3g})"
        )
    return "\n".join(lines)


def describe_modes(result: Summary) -> str:
    """Return the text of `forceaxis modes`: a row for each mode of vibration, and its shape."""
    lines = [
        f"{result['model']}, contact {result['contact'] or 'none'}: "
        f"{result['input']} to {result['output']}",
        *working.lines(result),
        f"{'':4}{'undamped, drive removed':>24}  {'with drive':>18}",
        f"{'mode':4}{'Hz':>12}{'damping':>12}  {'Hz':>9}{'damping':>9}  label",
    ]
    for i, mode in enumerate(result["modes"], 1):
        label = mode["label"]
        if mode["against_below"] != label:
            label += f" (against the mode below: {mode['against_below']})"
        elif mode["reference"]:
            label += ", the reference"
        elif mode["residue"] == 0 and label == "colocated":
            label += " (zeros on the poles but for damping)"
        driven = mode["driven"] or {"frequency_hz": None, "damping_ratio": None}
        undamped = f"{_number(mode['frequency_hz']):>12}{_number(mode['damping_ratio']):>12}"
        with_drive = f"{_number(driven['frequency_hz']):>9}{_number(driven['damping_ratio']):>9}"
        lines.append(f"{i:<4}{undamped}  {with_drive}  {label}")
        shape = ", ".join(f"{body} {value + 0.0:.3g}" for body, value in mode["shape"].items())
        lines.append(f"{'':16}{shape}")
    if not result["path"]:
        lines.append("no path from input to output in this mode: no labels (--mode ELEMENT=STATE)")
    if result["other_poles"]:
        poles = ", ".join(f"{p['frequency_hz']:.4g} Hz" for p in result["other_poles"])
        lines.append(f"other poles with drive: {poles}")
    return "\n".join(lines)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def describe_system(system: System, mode: Working | None = None) -> str:
    """Return the text of `forceaxis linearise`: one row of the matrices for each state and
    output."""
    kind = "continuous" if system.dt is None else f"sampled every {system.dt:.6g} s"
    lines = [f"system       {kind}, inputs {', '.join(system.inputs)}"]
    lines += working.lines({"mode_text": mode.text} if mode else {})
    for name, rows in (("A B", system.states), ("C D", system.outputs)):
        left, right = (getattr(system, part) for part in name.split())
        for label, values in zip(rows, np.hstack([left, right]), strict=True):
            lines.append(f"{name}   {label:20} " + " ".join(f"{v + 0.0:11.5g}" for v in values))
    return "\n".join(lines)


def describe_beam(result: Summary) -> str:
    """Return the text of `forceaxis beam`: poles and zeros, and the errors of the approximation."""
    lines = [f"{'mode':4}{'b l':>16}{'pole':>18}{'actuator zero':>20}{'tip zero':>18}"]
    for k, mode in enumerate(result["modes"], 1):
        lines.append(
            f"{k:<4}{mode['b_l']:16.12f}{mode['pole_rad_per_s']:15.8g} j"
            f"{mode['actuator_zero_rad_per_s']:18.8g} j{mode['tip_zero_per_s']:13.8g} +-"
        )
    lines.append("poles and zeros in 1/s; all in pairs, the tip's zeros real")
    lines.append("\nerror of the approximation through mode 4 with the first n modes")
    lines.append(f"{'n':4}{'actuator':>12}{'tip':>12}")
    for row in result["approximation_errors"]:
        lines.append(f"{row['modes']:<4}{100 * row['actuator']:10.3g} %{100 * row['tip']:10.3g} %")
    return "\n".join(lines)
